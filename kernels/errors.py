"""The one kind of error that a user can cause and mend."""

LONGEST = 2000  # characters of a message


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
    """A simulation or a training run has left finite numbers, or those that mean something; it cannot go on."""
