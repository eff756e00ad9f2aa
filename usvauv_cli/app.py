"""The `usvauv` command: exit codes, and one line on standard error if a command ends early.

0 done; 2 an error; 128 + n ended by signal n: 130 Ctrl-C, 143 SIGTERM, 129 the terminal
hung up, 141 the reader of standard output is gone.
Everything else is imported after signal handlers are set, so that Ctrl-C during imports gives no traceback either.
"""

from __future__ import annotations

import contextlib
import errno
import gc
import io
import os
import signal
import sys
import threading
from typing import TYPE_CHECKING, Any, NoReturn

from usvauv.kernels.errors import TRACEBACK, UserError, in_words, text_of
from usvauv.kernels.interruption import PATIENCE, SIGNALS, SIGPIPE, Interrupted, Interruption, in_thread

if TYPE_CHECKING:
    import typer

FAILED = 2
COLLECTION = 100_000, 20, 20  # thresholds of `gc`: imports leave hardly any cycles, and searching for them takes long


class _Output(io.FileIO):
    """Standard output; its failures are distinguished from those of files and raised once: later output is dropped."""

    _failed = False

    def write(self, data: Any) -> int | None:
        if self._failed:
            return len(data)
        try:
            return super().write(data)
        except OSError as error:
            self._failed = True
            if error.errno in (errno.EPIPE, errno.EIO):  # of a pipe, of a terminal
                raise Interrupted(SIGPIPE) from None
            raise UserError(f"standard output: cannot be written: {error.strerror or error}") from None


def main() -> NoReturn:
    """Entry point of the installed command."""
    gc.set_threshold(*COLLECTION)
    interruption = Interruption()
    interruption.install()
    threading.excepthook, sys.unraisablehook = in_thread, _in_callback
    if sys.stdout:
        raw = _Output(sys.stdout.fileno(), "w", closefd=False)
        stream = io.TextIOWrapper(io.BufferedWriter(raw), sys.stdout.encoding, "replace", None, raw.isatty())
        sys.stdout = sys.__stdout__ = stream  # Taichi compares the two
    if not sys.stderr:  # closed, as by `2>&-`; text printed to None would go to standard output
        sys.stderr = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8")
    if isinstance(sys.stderr, io.TextIOWrapper):
        sys.stderr.reconfigure(errors="replace")
    code = run(interruption)
    for signum in SIGNALS:  # all is done; a traceback from the interpreter's end would be noise
        signal.signal(signum, signal.SIG_IGN)
    if (runtime := sys.modules.get("usvauv.kernels.runtime")) is not None:
        runtime.stop()  # now, because Taichi writes no cache at exit when the objects below are not collected
    gc.freeze()  # all objects, which the interpreter would search for cycles at exit
    sys.exit(code)


def run(interruption: Interruption | None = None) -> int:
    """Run the command that `sys.argv` names, in this process; returns the exit code."""
    try:
        code = _command()
        if sys.stdout:
            sys.stdout.flush()
    except BaseException as error:
        signum = SIGPIPE if isinstance(error, BrokenPipeError) else _signal(error, interruption)
        if signum is not None:
            if signum != SIGPIPE:
                _say("stopped")
            return 128 + signum
        if isinstance(error, SystemExit):
            return error.code if isinstance(error.code, int) else FAILED if error.code else 0
        if os.environ.get(TRACEBACK):
            raise
        message = _message(error)
        if message:  # without a message no command was given, and help was shown
            _say("\n".join(f"error: {line}" for line in message.split("\n")))
        return FAILED
    return code


def _command() -> int:
    import typer
    from typer.core import TyperGroup

    from usvauv.cli.usage import check_command

    command, given = typer.main.get_command(parser()), sys.argv[1:]
    assert isinstance(command, TyperGroup)
    if given[:1] == ["help"]:
        given = [*given[1:], "--help"]
    if given and not given[0].startswith("-"):
        check_command(given[0], command.commands)
    try:
        # Not `app()`: it handles Ctrl-C and a closed pipe itself.
        with command.make_context("usvauv", given) as context:
            return command.invoke(context) or 0
    except typer.Exit as done:
        return done.exit_code


def parser() -> typer.Typer:
    """The commands and their common options.

    Each command's module imports what it needs when it runs, so that `--help` answers at once.
    """
    import typer

    from usvauv.cli.commands import evaluate, export, inspect, plan, sea, simulate, sweep, train
    from usvauv.cli.usage import HELP, Command, Commands

    app = typer.Typer(
        name="usvauv",
        help="USV–AUV collaboration under extreme seas: simulate to a video, train policies, evaluate to a table.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode="markdown",
        context_settings=HELP,
        cls=Commands,
    )
    groups = {
        "Simulate": (simulate.simulate, simulate.replay, simulate.live),
        "Learn and compare": (train.train, evaluate.evaluate, sweep.sweep, sweep.reproduce),
        "Plan, sea, other programs": (plan.plan, sea.sea, export.export),
        "What there is": (inspect.scenarios, inspect.policies, inspect.boats, inspect.targets, inspect.doctor),
    }
    for group, commands in groups.items():
        for command in commands:
            name = "eval" if command is evaluate.evaluate else None
            app.command(name, cls=Command, rich_help_panel=group)(command)

    def print_version(wanted: bool) -> None:
        if wanted:
            from importlib import metadata

            typer.echo(f"usvauv {metadata.version('usvauv')}")
            raise typer.Exit

    @app.callback()
    def options(
        version: bool = typer.Option(
            False, "--version", metavar="", callback=print_version, is_eager=True, help="Show the version and exit."
        ),
    ) -> None:
        """The options of `usvauv` itself; the app's help text stands above."""

    return app


def _signal(error: BaseException, interruption: Interruption | None) -> int | None:
    """The signal that ended a command; libraries convert a signal's exception into their own errors."""
    if isinstance(error, Interrupted):
        return error.signum
    received = interruption.received if interruption else None
    if isinstance(error, KeyboardInterrupt):
        return received or signal.SIGINT
    return None if isinstance(error, UserError) else received


def _message(error: BaseException) -> str:
    """An error in words, a line for each problem."""
    if isinstance(error, UserError):
        return text_of(error) or in_words(error)
    # Usage errors of the command-line library, whichever copy of it typer includes.
    explain = getattr(error, "format_message", None)
    if explain is not None:
        return " ".join(explain().split())
    refusal: BaseException | None = error  # an error of the system that does not concern a file being written
    while refusal is not None and not isinstance(refusal, OSError):
        refusal = refusal.__cause__  # a library may have converted it into its own error
    if refusal is not None:
        return ": ".join(str(part) for part in (refusal.filename, refusal.strerror or refusal) if part)
    return f"unexpected {in_words(error)} (set {TRACEBACK}=1 to see where)"


def _say(line: str) -> None:
    with contextlib.suppress(OSError):
        print(line, file=sys.stderr, flush=True)


def _in_callback(about: sys.UnraisableHookArgs) -> None:
    """Deliver again a signal that arrived while Python could not raise, as in a destructor."""
    if not isinstance(about.exc_value, Interrupted):
        sys.__unraisablehook__(about)
        return
    again = threading.Timer(1.1 * PATIENCE, signal.raise_signal, (about.exc_value.signum,))
    again.daemon = True
    again.start()
