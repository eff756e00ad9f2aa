"""Files: written whole, by one process at a time, and TOML and JSON from any source, of bounded size and depth.

An error message is one line: for writing with the file's name, for reading as text to follow the name.
"""

from __future__ import annotations

import codecs
import errno
import fcntl
import json
import os
import platform
import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any

from usvauv.kernels.errors import UserError

# How libraries that do not raise OSError name the system's error number: HDF5, safetensors.
ERROR_NUMBER = re.compile(r"\b(?:errno = |os error |code: )(\d+)")
THIS_HOST = platform.node().replace("/", "_") or "host"
LOCK = ".lock"  # in a folder that a process has for itself
UNSUPPORTED = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)  # of a file system without locks
LARGEST = {"TOML": 2**20, "JSON": 2**26}  # bytes
DEEPEST = 32  # sections and lists in one another
PARSERS = {"TOML": tomllib.loads, "JSON": json.loads}


class OutputError(UserError, ValueError):
    """A file cannot be written as asked; the message is one line that names its path."""


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn the system's refusal to write `path`, by whichever library it is reported, into one line.

    Raises:
        OutputError: the system refused; other exceptions pass.
    """
    try:
        yield
    except Exception as error:
        reason = None if isinstance(error, UserError) else _reason(error)
        if reason is None:
            raise
        raise OutputError(f"{path}: cannot be written: {reason}") from None


def _reason(error: Exception) -> str | None:
    """The system's words for an error; None if it is not the system's."""
    number = error.errno if isinstance(error, OSError) else None
    if number is None and (found := ERROR_NUMBER.search(str(error))):
        number = int(found.group(1))
    if number is not None:
        return os.strerror(number)
    return next(iter(str(error).splitlines()), type(error).__name__) if isinstance(error, OSError) else None


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """An empty file beside `path` for the block to fill, which takes the place of `path` when the block succeeds.

    After an error or Ctrl-C it is removed, and what stood at `path` before stays as it was. What a killed process left
    is removed by the next one that writes `path` on the same host.

    Raises:
        OutputError: `path` is a folder, a device or a link to another folder, its folder is missing, or the system
            refuses to write; checked on entry, so before long work in the block.
    """
    with writing(path):
        target, partial = _claim(path)
        try:
            yield partial
            sync(partial)
            os.replace(partial, target)
        finally:
            partial.unlink(missing_ok=True)


def inside(folder: Path, path: Path) -> Path:
    """A path below a folder that another may have made, behind all links.

    Raises:
        OutputError: a link leads out of the folder.
    """
    real = Path(os.path.realpath(path))
    if not real.is_relative_to(os.path.realpath(folder)):
        raise OutputError(f"{path}: is a link out of its folder, to {real}; name that, or remove the link")
    return real


def check_place(path: Path) -> None:
    """Refuse a path that `atomic_write` would refuse, before long work.

    Raises:
        OutputError: as `atomic_write`.
    """
    with writing(path):
        _claim(path)[1].unlink()


def _claim(path: Path) -> tuple[Path, Path]:
    """The file to be written, behind links within its folder, and an empty file beside it."""
    if path.exists() and not path.is_file():
        number = errno.EISDIR if path.is_dir() else errno.EINVAL
        raise OSError(number, os.strerror(number))
    target = inside(path.parent, path)
    _remove_stale(target)
    partial = target.with_name(f"{target.name}.{THIS_HOST}-{os.getpid()}.partial")
    partial.unlink(missing_ok=True)  # of an earlier process of this number, or a link
    partial.touch(exist_ok=False)
    return target, partial


def _remove_stale(path: Path) -> None:
    """Remove what dead processes of this host left of `path`."""
    ours = re.compile(re.escape(f"{path.name}.{THIS_HOST}-") + r"(\d+)\.partial")
    for name in os.listdir(path.parent):
        if (match := ours.fullmatch(name)) and not _alive(int(match.group(1))):
            path.with_name(name).unlink(missing_ok=True)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        pass
    return True


def sync(path: Path) -> None:
    """Wait until a file or folder is on the disk, so that a power cut does not undo a later rename alone."""
    number = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(number)
    finally:
        os.close(number)


class HDF5File(FileIO):
    """A file to be written by HDF5, which crashes the process when it cannot close a file.

    Every write is reported to HDF5 as a success; `check` raises the first one that failed. Nor does HDF5 survive an
    exception while it calls these methods: use it within `usvauv.kernels.interruption.deferred`.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._error: OSError | None = None

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        length = len(view)
        try:
            while len(view) and self._error is None:
                view = view[super().write(view) or 0 :]
        except OSError as error:
            self._error = error
        return length

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self._error = self._error or error
            return self.tell() if size is None else size

    def check(self) -> None:
        """Raise the first error of writing.

        Raises:
            OSError: a write failed.
        """
        if self._error is not None:
            raise self._error


@contextmanager
def hdf5_file(path: Path) -> Iterator[HDF5File]:
    """A file for HDF5 in the place of `atomic_write`'s, which is to be closed by HDF5 before the block ends.

    Raises:
        OutputError: as `atomic_write`.
    """
    with atomic_write(path) as partial, HDF5File(partial) as file:
        yield file
        file.check()


@contextmanager
def locked(place: Path) -> Iterator[None]:
    """Keep other processes that ask for the same lock away from a folder.

    The operating system holds the lock and drops it when this process ends, however it ends: a lock file left by a
    killed process locks nothing, even if its process id is in use again. Where the file system has no locks, nobody
    is kept out.

    Raises:
        OutputError: another process holds it, which is named, or the folder cannot be written.
    """
    path = place / LOCK
    with writing(place):
        file = open_locked(path, place)
        if not re.fullmatch(rb"[0-9]{0,20}", file.read(21)):
            file.close()
            raise OutputError(f"{path}: holds no process id; remove it")
    try:
        with writing(place):
            file.seek(0)
            file.truncate()
            file.write(str(os.getpid()).encode())
        yield
    finally:
        with suppress(OSError):  # the folder may be gone
            path.unlink()
        file.close()


def open_locked(path: Path, place: Path) -> FileIO:
    """A file, created where it is missing, that nobody else can open with this function before it is closed.

    Args:
        path: of the file; a process id in it is that of its holder.
        place: what is locked by it, for the message.

    Raises:
        OutputError: another process has it, or it is a link, or no file.
        OSError: the system's refusal.
    """
    while True:
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise OutputError(f"{path}: is not a regular file; remove it")
        file = FileIO(os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666), "r+")
        try:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(file.fileno()).st_ino == path.stat().st_ino:
                return file
        except FileNotFoundError:
            pass  # as below
        except OSError as error:
            if error.errno in UNSUPPORTED:
                return file
            file.seek(0)
            holder = file.read(20).decode(errors="replace").strip()
            file.close()
            if error.errno not in (errno.EAGAIN, errno.EACCES, errno.EDEADLK):
                raise
            by = f"process {holder}" if holder.isdecimal() else "another process"
            raise OutputError(f"{place}: {by} is writing there") from None
        file.close()  # its holder has removed it in the meantime


class TextFileError(ValueError):
    """Why a text file or its content cannot be used, in words that follow on the file's name."""


def read_text(path: str | Path, language: str) -> dict[str, Any]:
    """The content of a file of a language in `LARGEST`.

    Raises:
        FileNotFoundError: there is none.
        TextFileError: it cannot be read, is too large, or `parse_text` refuses it.
    """
    if not os.path.isfile(path):  # false, unlike an error, for paths that no system allows; a pipe would not end
        raise FileNotFoundError(f"{path}: is not a file")
    try:
        with open(path, "rb") as file:
            content = file.read(LARGEST[language] + 1)
        if len(content) > LARGEST[language]:
            raise TextFileError(f"has more than {LARGEST[language]:,} bytes")
    except OSError as error:
        raise TextFileError(f"cannot be read: {error.strerror}") from None
    return parse_text(decoded(content), language)


def decoded(content: bytes) -> str:
    """The text of a file in UTF-8, or in UTF-16 as PowerShell's `>` writes it, with or without a byte-order mark.

    Raises:
        TextFileError: it is in neither.
    """
    mark = content[:2]
    if mark in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        encoding = "utf-16"
    elif b"\0" in mark:  # beside a letter of ASCII, with which files begin
        encoding = "utf-16-be" if mark[:1] == b"\0" else "utf-16-le"
    else:
        encoding = "utf-8-sig"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        wrong = f"byte {content[error.start]:#04x} in line {line} is not {'UTF-16' if '16' in encoding else 'UTF-8'}"
        raise TextFileError(f"{wrong}; save the file as UTF-8") from None


def parse_text(text: str, language: str) -> dict[str, Any]:
    """The table that a text in a language of `LARGEST` stands for.

    Raises:
        TextFileError: it is not of the language, no table, or `check_plain` refuses it.
    """
    try:
        content = PARSERS[language](text.replace("\r\n", "\n"))
    except RecursionError:
        raise TextFileError(f"not valid {language}: nested too deep") from None
    except Exception as error:  # the parsers also raise ValueError of other kinds, for numbers of many digits
        raise TextFileError(f"not valid {language}: {error}") from None
    if not isinstance(content, dict):
        raise TextFileError(f"not a table of {language} but {type(content).__name__}")
    check_plain(content)
    return content


def check_plain(content: Any) -> None:
    """Refuse sections and lists nested deeper than `DEEPEST`, and text that cannot be written to a file.

    Raises:
        TextFileError: there is one.
    """
    level = [content]
    for _ in range(DEEPEST):
        inner: list[Any] = []
        for value in level:
            if isinstance(value, Mapping):
                inner += [*value, *value.values()]
            elif isinstance(value, list | tuple):
                inner += value
            elif isinstance(value, str) and not is_text(value):
                raise TextFileError(f"holds {value!r}, which is not text")
        level = inner
        if not level:
            return
    raise TextFileError("nested too deep")


def is_text(text: str) -> bool:
    """Whether a file in UTF-8 can hold it; names of files need not be such text."""
    return readable(text) == text


def readable(text: str) -> str:
    """The text, with bytes that are not text as Python writes them."""
    return text.encode("utf-8", "backslashreplace").decode()
