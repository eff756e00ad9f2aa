"""Which command takes what: kinds of files by their names, and refusals of commands, options and arguments that there
are not, with what is likely meant.
"""

from __future__ import annotations

import inspect
import os
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from usvauv.kernels.errors import UserError, choices
from usvauv.kernels.limits import ARCHITECTURES


class Kind(NamedTuple):
    """A kind of file; `found` is what a name says of one, `taken` which command takes one, {} being its name."""

    name: str
    found: str
    taken: str


KINDS = {  # by the option that takes one, where there is one
    "scenario": Kind("a scenario", "a scenario", "usvauv simulate {} runs it"),
    "study": Kind("a study", "a study", "usvauv sweep {} runs it"),
    "trace": Kind("a trace", "a NetCDF file", "usvauv replay {} draws a trace"),
    "policy": Kind("a trained policy", "a trained policy", "usvauv simulate --policy {} runs it"),
    "log": Kind("a log of fixes", "a CSV file", "usvauv plan --log {} reads a log of fixes"),
    "plugin": Kind("a plugin", "a Python file", "--plugin {} loads a plugin, --policy MODULE:CLASS a policy in it"),
    "result": Kind("a result", "a picture, a video or an export", "no command of usvauv reads it"),
}
ENDINGS = {
    ".nc": "trace",
    ".safetensors": "policy",
    ".csv": "log",
    ".py": "plugin",
    **dict.fromkeys((".mp4", ".webm", ".gif", ".webp", ".png", ".pdf", ".svg"), "result"),
    **dict.fromkeys((".json", ".geojson", ".onnx", ".mcap", ".rrd", ".parquet", ".html"), "result"),
}


def kind_of(name: str | Path) -> str:
    """The kind of a file or folder, a key of `KINDS`; empty where it is not there or of no known kind."""
    path = Path(name)
    if os.path.isdir(path):
        return "policy" if any(next(path.glob(f"{place}*.safetensors"), None) for place in ("", "seed-*/")) else ""
    if not os.path.isfile(path):
        return ""
    ending = path.suffix.lower()
    return _of_toml(path) if ending == ".toml" else ENDINGS.get(ending, "")


def _of_toml(path: Path) -> str:
    from usvauv.env.scenario import Scenario
    from usvauv.env.scenario.fields import BASE
    from usvauv.env.storage.files import TextFileError, read_text

    try:
        names = read_text(path, "TOML").keys()
    except (OSError, TextFileError):
        return ""
    return "study" if "runs" in names else "scenario" if names and names <= {BASE, *Scenario.model_fields} else ""


def expect(kind: str, name: str | Path) -> None:
    """Refuse a file of another kind, naming the command that takes it.

    Raises:
        UserError: the name says that it is of another kind.
    """
    found = kind_of(name)
    if found not in ("", kind):
        raise UserError(f"{name}: is {KINDS[found].found}, not {KINDS[kind].name}; {KINDS[found].taken.format(name)}")


# What a help text says that an option takes, by its name, else by its type; options say no more of what they are.
TAKEN = {
    "--policy": "NAME",
    "--usv": "BOAT",
    "--targets": "RULE",
    "--arch": "|".join(ARCHITECTURES),
    "--view": "map|sea|both",
    "--theme": "dark|light",
    "--log": "tensorboard|wandb",
    "--algorithm": "sac|td3|ddpg|ppo",
    "int": "N",
    "float": "X",
    "Path": "PATH",
    "bool": "",
}
GROUPS = {  # of the options in a help text; those of a command itself stand first, without a group
    "Mission": ("--policy", "--usv", "--targets", "--seed", "--set", "--plugin"),
    "Picture": ("--view", "--theme", "--size", "--fps", "--speedup", "--at", "--follow"),
    "Result": ("--out", "--trace", "--report", "--onnx", "--json", "--force", "--resume"),
    "Machine": ("--arch", "--ray", "--slurm", "--jobs", "--port", "--open", "--quiet", "--help"),
}
GROUP = {option: group for group, options in GROUPS.items() for option in options}
SHORT = {"--out": "-o"}
QUIET = "--quiet", "-q"
HELP = {"help_option_names": ["--help", "-h"]}


NARROW = 64  # columns of a terminal in which names and choices of options leave no room for words beside them


class Helpful:
    """A command whose option `--help` takes nothing, and stands in a group where there are groups.

    In a narrow terminal what an option or command does stands below its name, not beside it.
    """

    help: str | None
    help_group: str | None = None

    def get_help_option(self, ctx: Any) -> Any:
        """The option `--help`."""
        option = super().get_help_option(ctx)  # type: ignore[misc]
        if option is not None:
            option.metavar, option.rich_help_panel = "", self.help_group
        return option

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help text, in a width of at least 20 columns."""
        columns = shutil.get_terminal_size().columns
        if columns < NARROW:
            self.rich_markup_mode, formatter.width = None, max(columns, 20)

            def below_each_other(rows: Iterable[tuple[str, str]], *shape: int) -> None:
                for name, words in rows:
                    formatter.write_text(name)
                    with formatter.indentation():
                        formatter.write_text(words.replace("`", ""))

            formatter.write_dl = below_each_other
        super().format_help(ctx, formatter)  # type: ignore[misc]

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        """Write what the command does, without marks of emphasis."""
        formatter.write_paragraph()
        formatter.write_text(inspect.cleandoc(self.help or "").replace("`", "").replace("**", ""))


class Commands(Helpful, TyperGroup):
    """All commands."""


class Command(Helpful, TyperCommand):
    """A command whose help has groups, and that says what is likely meant by an option or argument it does not have."""

    help_group = GROUP["--help"]

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self.context_settings = {**self.context_settings, **HELP}
        for each in self.params:
            if isinstance(each, TyperArgument):
                each.display_type_rich = lambda ctx: None  # its name says what it is
            elif isinstance(each, TyperOption):
                name = each.opts[0]
                each.metavar = TAKEN.get(name, TAKEN.get(each.bare_type())) if each.metavar is None else each.metavar
                each.rich_help_panel = GROUP.get(name)
                each.opts += [SHORT[name]] if name in SHORT else []

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help text, with the groups of all commands in one order."""
        order = [None, *dict.fromkeys(GROUP.values())]
        self.params.sort(key=lambda each: order.index(getattr(each, "rich_help_panel", None)))
        super().format_help(ctx, formatter)

    def get_short_help_str(self, limit: int = 0) -> str:
        """The first paragraph of the help text, whole, whatever the limit."""
        return " ".join(inspect.cleandoc(self.help or "").split("\n\n")[0].split())

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Process the arguments of the command line.

        Raises:
            UserError: an option or argument that the command does not have.
        """
        ctx.allow_extra_args = True  # they are refused below
        args = sorted(args, key=lambda each: each not in QUIET)  # first, so that plugins are loaded without a word
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
