"""Errors that a user can cause and correct, each a message of one line, or of one for each problem."""

import re
import sysconfig
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

TRACEBACK = "USVAUV_TRACEBACK"  # environment variable: show where an error comes from
INSTALLED = tuple(sysconfig.get_paths()[kind] for kind in ("stdlib", "purelib", "platlib"))  # folders
LONGEST = 2000  # characters of a message
SHOWN = 400  # characters of a message that is quoted
PLACE = re.compile(r"(?:TypeError when calling `\w+`: )?(File \".*)")  # of what Taichi's compiler reports


class UserError(Exception):
    """A request cannot be carried out; the message has a line for each problem, with what is allowed.

    The command line prints it without a traceback and exits with code 2. What a message quotes can be of any length
    and hold line breaks and control characters: these are written as Python writes them, and the middle is left out.
    """

    def __init__(self, *problems: str) -> None:
        super().__init__(*map(_line, problems))

    def __str__(self) -> str:
        return "\n".join(self.args)


def _line(problem: str) -> str:
    if len(problem) > LONGEST:
        problem = f"{problem[: LONGEST // 2]} … {problem[-LONGEST // 2 :]}"
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in problem)


class DivergenceError(UserError, ArithmeticError):
    """A simulation or a training run diverged: a number is not finite, or outside its physical range."""


def choices(value: object, names: Iterable[str], others: str = "") -> str:
    """Say which names are allowed in place of a value, and which of them it most resembles.

    Args:
        value: that is none of them, with or without what follows a colon.
        names: may have their arguments behind them, as in "hold:X,Y" and "greedy[:ALPHA]".
        others: what else is allowed, in words.
    """
    import difflib  # seldom needed

    names = list(names)
    bare = {re.split(r"[:\[]", name)[0]: name for name in reversed(names)}
    given = str(value).partition(":")[0].strip().lower()
    begin = [name for name in bare if given and name.startswith(given)]
    close = difflib.get_close_matches(given, begin or bare, 1, 0.0 if begin else 0.5)
    close = close or [name for name in bare if name.partition(".")[2] == given]
    guess = f"; did you mean {close[0]!r}?" if close else ""
    return f"allowed are {', '.join(names)}{others}{guess}"


def text_of(value: object, form: Callable[[object], str] = str) -> str | None:
    """The text of an object from outside the packages by its own method; None: the method fails."""
    try:
        return form(value)
    except KeyboardInterrupt:
        raise
    except BaseException:
        return None


def in_words(error: BaseException) -> str:
    """Kind and message of an exception of any kind, in one line.

    Taichi's messages name the functions that were being compiled, the outermost first, and quote all their arguments:
    kept are the last place and the start of the reason.
    """
    if (message := text_of(error)) is None:
        return f"{type(error).__name__}, whose text cannot be made"
    lines = message.split("\n")
    places = [(i, found[1]) for i, line in enumerate(lines) if (found := PLACE.match(line))]
    if places:
        last, place = places[-1]
        reasons = [line.rstrip(".") for line in lines[last + 1 :] if line.strip(" ^~\t")]
        lines = [place, *reasons[-1:]]
    text = " ".join(" ".join(lines).split())
    return f"{type(error).__name__}: {text if len(text) <= SHOWN else text[:SHOWN] + ' …'}".removesuffix(": ")


def with_place(error: BaseException, item: str = "") -> str:
    """The message with the last line of foreign code that the exception went through, and how to see all of them.

    Args:
        error: that code from outside the packages raised.
        item: which code, in words. A file that it names is foreign even where it is installed.
    """
    place = ""
    for frame, line in traceback.walk_tb(error.__traceback__):
        file, module = frame.f_code.co_filename, frame.f_globals.get("__name__", "")
        if file in item or not (file.startswith(("<frozen ", *INSTALLED)) or module.partition(".")[0] == "usvauv"):
            place = f", in {file}, line {line}"
    return f"{in_words(error)}{place} (set {TRACEBACK}=1 to see where it comes from)"


@contextmanager
def blaming(item: str, error: Callable[[str], UserError]) -> Iterator[None]:
    """A context in which code from outside the packages runs: what it raises becomes one line that names `item`.

    Raises:
        error: instead of what that code raises; a UserError and Ctrl-C stay as they are.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise
    except BaseException as problem:
        if isinstance(problem, UserError) and text_of(problem) is not None:
            raise
        raise error(f"{item}: raised {with_place(problem, item)}") from problem


def wrong_return(item: str, returned: object, allowed: str) -> str:
    """The message about code from outside the packages that returned something that is not allowed."""
    shown = text_of(returned, repr) or f"a {type(returned).__name__}"
    return f"{item}: returned {' '.join(shown.split())[:200]}: must be {allowed}"
