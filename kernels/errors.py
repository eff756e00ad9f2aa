"""The one kind of error that a user can cause and mend."""


class UserError(Exception):
    """Something asked for cannot be done; the message is one line that says what, and what is allowed.

    The command line prints it without a traceback and exits with code 2.
    """


class DivergenceError(UserError, ArithmeticError):
    """A simulation or a training run has left finite numbers, or those that mean something; it cannot go on."""
