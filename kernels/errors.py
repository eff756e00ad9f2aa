"""Errors that a user can cause and correct, each a message of one line."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

LONGEST = 2000  # characters of a message
SHOWN = 400  # characters of a message that is quoted


class UserError(Exception):
    """Something asked for cannot be done; the message is one line that says what, and what is allowed.

    The command line prints it without a traceback and exits with code 2. What a message quotes can be of any length
    and hold line breaks and control characters: these are written as Python writes them, and the middle is left out.
    """

    def __init__(self, message: str) -> None:
        if len(message) > LONGEST:
            message = f"{message[: LONGEST // 2]} … {message[-LONGEST // 2 :]}"
        super().__init__("".join(c if c.isprintable() else repr(c)[1:-1] for c in message))


class DivergenceError(UserError, ArithmeticError):
    """A simulation or a training run diverged: a number is not finite, or outside its physical range."""


def in_words(error: BaseException) -> str:
    """Kind and message of an exception of any kind, in one line.

    Taichi's messages name the functions that were being compiled, the outermost first, and quote all their arguments:
    kept are the last place and the start of the reason.
    """
    lines = str(error).split("\n")
    places = [i for i, line in enumerate(lines) if line.startswith('File "')]
    if places:
        reasons = [line for line in lines[places[-1] + 1 :] if line.strip(" ^~\t")]
        lines = [lines[places[-1]], *reasons[-1:]]
    text = " ".join(" ".join(lines).split())
    return f"{type(error).__name__}: {text if len(text) <= SHOWN else text[:SHOWN] + ' …'}"


@contextmanager
def blaming(item: str, error: Callable[[str], UserError]) -> Iterator[None]:
    """A context in which code from outside the packages runs: what it raises becomes one line that names `item`.

    Raises:
        error: instead of what that code raises; a UserError stays as it is.
    """
    try:
        yield
    except UserError:
        raise
    except (Exception, SystemExit) as problem:
        raise error(f"{item}: raised {in_words(problem)}") from problem


def wrong_return(item: str, returned: object, allowed: str) -> str:
    """The message about code from outside the packages that returned something that is not allowed."""
    return f"{item}: returned {' '.join(repr(returned).split())[:200]}: must be {allowed}"
