"""Refusals of commands, options and arguments that there are not, with what is likely meant."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from typer.core import TyperCommand

from usvauv.cli.kinds import KINDS, kind_of
from usvauv.kernels.errors import UserError, choices


class Command(TyperCommand):
    """A command that says what is likely meant by an option or argument that it does not have."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Process the arguments of the command line.

        Raises:
            UserError: an option or argument that the command does not have.
        """
        ctx.allow_extra_args = True  # they are refused below
        parameters = self.get_params(ctx)
        options = [name for each in parameters for name in (*each.opts, *each.secondary_opts) if name.startswith("-")]
        try:
            super().parse_args(ctx, args)
        except Exception as error:
            if not hasattr(error, "possibilities"):  # of an unknown option, in whichever library typer includes
                raise
            name = getattr(error, "option_name", "")
            raise UserError(f"{ctx.info_name} has no option {name}: {choices(name, options)}") from None
        if ctx.args:
            raise UserError(f"{ctx.info_name} takes no argument {ctx.args[0]!r}{_place(ctx.args[0], options)}")
        return ctx.args


def check_command(name: str, commands: Iterable[str]) -> None:
    """Refuse a command that there is not.

    Raises:
        UserError: it is none of these.
    """
    if name not in commands:
        raise UserError(f"command {name!r}: {_place(name).removeprefix('; ') or choices(name, commands)}")


def _place(argument: str, options: Iterable[str] = ()) -> str:
    """Which of these options, or else which command, takes a file or the name of a scenario; empty for other texts."""
    from usvauv.env.scenario.fields import shipped

    kind = "scenario" if argument in shipped() else kind_of(argument)
    if f"--{kind}" in options:
        return f"; --{kind} {argument} does"
    return f"; {KINDS[kind].taken.format(argument)}" if kind else ""
