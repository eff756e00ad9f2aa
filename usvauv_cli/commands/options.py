"""Options that several commands share, declared once and checked before long work; a refusal is a `UserError`."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import sys
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from usvauv.cli.terminal import counted
from usvauv.cli.usage import expect
from usvauv.kernels.errors import UserError, choices

if TYPE_CHECKING:
    from usvauv.env.record.trace import Trace
    from usvauv.env.render.video import Video
    from usvauv.env.scenario import Scenario

LONGEST = 10_000_000  # s, of what a command simulates, as of mission.duration


def bounded(least: float, most: float = math.inf) -> Callable[[typer.CallbackParam, float | None], float | None]:
    """A callback of an option that refuses a number outside these bounds, or not finite, before the command begins."""

    def check(parameter: typer.CallbackParam, value: float | None) -> float | None:
        if value is not None and not (least <= value <= most and math.isfinite(value)):
            allowed = f"from {least} to {most}" if math.isfinite(most) else f"at least {least}, and finite"
            raise UserError(f"{parameter.opts[0]} {value}: must be {allowed}")
        return value

    return check


def of_kind(kind: str) -> Callable[[Any], Any]:
    """A callback of an argument or option that refuses files of another kind; a shipped name is no file."""

    def check(value: Any) -> Any:
        from usvauv.env.scenario import Scenario

        for name in value if isinstance(value, list) else [value]:
            if name is not None and name not in Scenario.shipped():
                expect(kind, name)
        return value

    return check


def _known_arch(value: str) -> str:
    from usvauv.kernels.limits import ARCHITECTURES

    return choice("--arch", value, ARCHITECTURES)


ScenarioName = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO", callback=of_kind("scenario"), help="A name from `usvauv scenarios`, or path of a TOML file."
    ),
]
Seed = Annotated[
    int,
    typer.Option(callback=bounded(0, 2**64 - 1), help="Random seed, 0 or more; the same seed gives the same result."),
]
Arch = Annotated[str, typer.Option(callback=_known_arch, help="Device for the kernels; vulkan is experimental.")]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="SECTION.FIELD=VALUE", help="Change one field of the scenario; may be repeated."),
]
POLICIES = (
    "Policy of the AUVs: a name from `usvauv policies`, a checkpoint, the folder of a run, or your own MODULE:CLASS"
)
Policy = Annotated[
    str | None,
    typer.Option(callback=of_kind("policy"), help=f"{POLICIES}. Default: the one listed for the scenario."),
]
BOATS = "Boat strategy: a name from `usvauv boats`, such as fim or hold:X,Y"
Usv = Annotated[str | None, typer.Option(help=f"{BOATS}. Default: the scenario's.")]

TARGETS = "Rule for the next node: a name from `usvauv targets`, such as tour or rate:20"
Targets = Annotated[str | None, typer.Option(help=f"{TARGETS}. Default: the scenario's.")]

VideoOut = Annotated[
    Path | None,
    typer.Option(help="Video (.mp4, .webm, .gif, .webp) or picture (.png) to write; default usvauv-SCENARIO.mp4."),
]
Size = Annotated[
    str | None, typer.Option(metavar="WxH", help="Frame size in pixels; default 1280x720, of a GIF 640x360.")
]
Fps = Annotated[int | None, typer.Option(help="Frames a second; default 30, of a GIF 12.")]
Speedup = Annotated[
    float | None,
    typer.Option(
        help="Seconds of mission in a second of video, 1 is real time. Default: one mission step a frame; with"
        " --view sea 4, and one minute of video."
    ),
]
ViewOption = Annotated[str, typer.Option("--view", help="map (from above, with plots), sea (in perspective), or both.")]
ThemeOption = Annotated[str, typer.Option("--theme", help="Colours around the map.")]
At = Annotated[
    str | None,
    typer.Option(
        metavar="T|T1:T2",
        help="Time in the mission shown by a picture, s, default the end; for a video, begin and end.",
    ),
]
Follow = Annotated[
    str | None, typer.Option(metavar="usv|auv:N", help="Follow a vehicle, nearer; usv:N with several boats.")
]

Force = Annotated[bool, typer.Option("--force", help="Overwrite results that other arguments made.")]
Quiet = Annotated[
    bool,
    typer.Option("--quiet", "-q", is_eager=True, help="Print results, warnings and errors alone, and no progress."),
]
# Arguments that do not decide what a result is.
NOT_DECISIVE = ("out", "trace", "json_file", "report_folder", "onnx", "force", "resume", "quiet")
BRIEF = ("scenarios", "policies", "boats", "targets", "plan", "replay", "export")  # commands soon done
MADE_BY = "user.usvauv"  # extended attribute of a result: the JSON of `_decisive`


def load_libraries(brief: bool = False, quiet: bool = False) -> None:
    """Import torch and Taichi, which takes seconds, and say so on standard error; a terminal forgets it after.

    Args:
        brief: say so on a terminal alone. quiet: say nothing.
    """
    line, terminal = "loading torch and Taichi …", sys.stderr.isatty() and not quiet
    if "taichi" in sys.modules:
        return
    if terminal or not (brief or quiet):
        print(line, end="" if terminal else "\n", file=sys.stderr, flush=True)
    try:
        from usvauv.kernels import runtime  # noqa: F401  # Taichi before torch: it searches all modules imported so far
    finally:
        if terminal:
            print(f"\r{' ' * len(line)}\r", end="", file=sys.stderr, flush=True)


def scenario_of(name: str, overrides: Sequence[str] | None, brief: bool = False, quiet: bool = False) -> Scenario:
    """The scenario that a command runs. It is checked before torch and Taichi are imported, see `load_libraries`."""
    from usvauv.env.scenario import Scenario

    scenario = Scenario.load(name, overrides or ())
    load_libraries(brief, quiet)
    return scenario


def preparing(scenario: Scenario, arch: str, quiet: bool = False) -> None:
    """Start Taichi, and say that a world is made, which may take long: its kernels are compiled where in no cache."""
    from usvauv.kernels import runtime

    seconds = 6 if runtime.start(arch).on_cpu else 25
    line = f"preparing {scenario.name}; the first time some {seconds} s longer, to compile its kernels …"
    if not quiet:
        print(line, file=sys.stderr, flush=True)


def _load_plugins(context: typer.Context, files: list[Path] | None) -> list[Path] | None:
    """Import the plugins of installed distributions, then those named, before other arguments are processed.

    A command with a scenario checks that first, and imports what takes seconds after, see `scenario_of`.
    """
    from usvauv.env import plugins

    if files or all(parameter.name != "scenario" for parameter in context.command.params):
        load_libraries(context.command.name in BRIEF, context.params.get("quiet", False))
    plugins.load_installed()
    for file in files or ():
        plugins.load(file)
    return files


Plugins = Annotated[
    list[Path] | None,
    typer.Option(
        "--plugin",
        metavar="FILE",
        callback=_load_plugins,
        is_eager=True,
        help="Python file that adds tasks, boat strategies, policies and more; may be repeated.",
    ),
]


def check_policy(name: str, scenario: Scenario) -> None:
    """Refuse a policy that cannot act in a scenario; say so where one that ships was trained with another number of
    AUVs than the scenario has.
    """
    from usvauv.policies.loading import check, load_learned, shipped

    check(name, scenario)
    if name in shipped():
        count, trained = scenario.auv.count, load_learned(name).scenario.auv.count
        if count != trained:
            typer.echo(
                f"policy {name}: was trained with {counted(trained, 'AUV')}; scenario {scenario.name!r} has {count}",
                err=True,
            )


def check_regime(*scenarios: Scenario) -> None:
    """Refuse a scenario in which nothing can come of a mission; warn of what hardly occurs at sea, a line each."""
    from usvauv.env.world import regime

    lines: list[str] = []
    for scenario in scenarios:
        findings = regime.check(scenario)
        if errors := [f"{scenario.name}: {finding}" for finding in findings if finding.verdict == "error"]:
            raise UserError(*errors)
        lines += [f"warning: {finding}" for finding in findings if finding.verdict == "warning"]
    for line in dict.fromkeys(lines):
        typer.echo(line, err=True)


def choice(option: str, value: str, allowed: Collection[str]) -> str:
    """The value of an option, one of those allowed."""
    if value not in allowed:
        raise UserError(f"{option} {value!r}: {choices(value, allowed)}")
    return value


def writable(context: typer.Context, path: Path, option: str, endings: Sequence[str]) -> Path:
    """The path of a result given by an option: a file with one of some endings (in lower case) can be created there, or
    may be replaced, see `keep_others`. Where nobody gave it, it gets the first number with which that is so.
    """
    from usvauv.env.storage.files import OutputError, check_place

    if os.path.isdir(path):
        raise UserError(f"{option} {path}: is a folder, expected a file name")
    if path.suffix.lower() not in endings:
        allowed = "allowed endings are" if len(endings) > 1 else "the ending must be"
        raise UserError(f"{option} {path}: {allowed} {', '.join(endings)}")
    if not os.path.isdir(path.parent):
        raise UserError(f"{option} {path}: the folder {path.parent} does not exist")
    try:
        check_place(path)
    except OutputError as error:
        raise UserError(f"{option} {error}") from None
    source = context.get_parameter_source(option.lstrip("-"))
    if source is not None and source.name.startswith("DEFAULT"):
        path = _numbered(context, path)
    keep_others(context, path, option)
    return path


def _numbered(context: typer.Context, path: Path) -> Path:
    """The first of a path, PATH-2, PATH-3 and so on that the command may write; with --resume that is begun."""
    from usvauv.env.storage.result_tables import begun

    arguments, resume, found = _decisive(context), context.params.get("resume"), path
    number = 1
    while _occupied(found) or resume:
        if begun(found).exists() if resume else context.params["force"] or _made_by(found) == arguments:
            return found
        if not _occupied(found):
            return path  # nothing is begun
        number += 1
        found = path.with_stem(f"{path.stem}-{number}")
    return found


def _occupied(path: Path) -> bool:
    return os.path.exists(path) and not (os.path.isdir(path) and not os.listdir(path))


def keep_others(context: typer.Context, path: Path, option: str) -> None:
    """Let a command replace a result, a file or folder, only if its arguments made it, with --force, or with --resume,
    which goes on with what has passed.

    What it writes says by an extended attribute what made it. Nothing is known where the system has no such attributes,
    nor of a copy that was made without them.
    """
    arguments, before = _decisive(context), _identity(path)
    goes_on = context.params["force"] or context.params.get("resume")
    if _occupied(path) and not goes_on and (known := _made_by(path)) != arguments:
        from usvauv.cli.evaluation.batches import first_difference

        how = f"made with {first_difference(known, arguments)}" if known else "perhaps made with other arguments"
        raise UserError(f"{option} {path}: exists, {how}; --force replaces it, or choose another name")

    def mark() -> None:
        with suppress(OSError, AttributeError):
            if _identity(path) not in (None, before):
                os.setxattr(path, MADE_BY, json.dumps(arguments).encode())

    context.call_on_close(mark)


def _decisive(context: typer.Context) -> dict[str, Any]:
    """What decides the results of a command, as JSON has it: its name and arguments, named as users do. One that is a
    file's name has a digest of the content beside it, of a scenario's with that of its bases."""
    names = {parameter.name: parameter.opts[0] for parameter in context.command.params}
    given = {names[name]: value for name, value in context.params.items() if name not in NOT_DECISIVE}
    whole = json.loads(json.dumps({"command": context.info_name, **given}, default=str))
    return {name: [*map(_told, value)] if isinstance(value, list) else _told(value) for name, value in whole.items()}


def _told(value: Any) -> Any:
    if isinstance(value, str) and os.path.isfile(value):
        from usvauv.env.scenario.fields import layers_of

        digest = hashlib.sha256()
        with suppress(OSError, UserError):
            names = [layer.source for layer in layers_of(value)] if value.endswith(".toml") else [value]
            for name in filter(os.path.isfile, names):  # a scenario's bases, but for those that ship
                with open(name, "rb") as file:
                    hashlib.file_digest(file, lambda: digest)
            return f"{value} (SHA-256 {digest.hexdigest()[:12]})"
    return value


def _made_by(path: Path) -> dict[str, Any] | None:
    """`_decisive` of the command that wrote a file; None: not known."""
    from usvauv.env.storage.files import parse_text

    with suppress(OSError, AttributeError, ValueError):
        return parse_text(os.getxattr(path, MADE_BY).decode(), "JSON")
    return None


def _identity(path: Path) -> tuple[int, int] | None:
    with suppress(OSError):
        about = path.stat()
        return about.st_ino, about.st_mtime_ns
    return None


def make_folder(path: Path, option: str = "--out") -> None:
    """Create the folder given by an option, where it is missing."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"{option} {path}: cannot be made a folder: {error.strerror}") from None


def parse_size(text: str) -> tuple[int, int]:
    """Read WIDTHxHEIGHT, each from `SMALLEST` to `LARGEST`."""
    from usvauv.env.render.video import LARGEST, SMALLEST

    found = re.fullmatch(r"([0-9]{3,4})[xX]([0-9]{3,4})", text)
    width, height = map(int, found.groups()) if found else (0, 0)
    if not all(SMALLEST <= side <= LARGEST for side in (width, height)):
        allowed = f"each from {SMALLEST} to {LARGEST}, like 1280x720"
        raise UserError(f"--size {text!r}: expected WIDTHxHEIGHT in pixels, {allowed}")
    return width, height


def checked_video(context: typer.Context, out: Path) -> Video:
    """What the options of a command about pictures ask for."""
    from usvauv.env.render.video import ENDINGS, Video, usual

    given, path = context.params, writable(context, out, "--out", ENDINGS)
    pixels, most = usual(path)
    moment = _parse_at(given["at"]) if given["at"] else None
    pixels = parse_size(given["size"]) if given["size"] else pixels
    most = most if given["fps"] is None else given["fps"]
    try:
        follow = given["follow"] or ""
        return Video(path, given["view"], given["theme"], pixels, most, given["speedup"], moment, follow)
    except UserError as error:
        raise UserError(f"--{error}") from None  # it begins with the option's name


def check_shown(video: Video, length: float, *scenarios: Scenario) -> None:
    """Refuse a time beyond the mission, of some length, s, and a vehicle to go along with that a scenario has not."""
    from usvauv.env.render.mission import Vehicle

    if video.end is not None and video.end > length * (1 + 1e-9):
        raise UserError(f"--at {video.end:g}: the mission is from 0 to {length:g} s")
    try:
        for scenario in scenarios if video.follow else ():
            Vehicle.parse(video.follow, scenario)
    except UserError as error:
        raise UserError(f"--{error}") from None


def loaded(path: Path, episode: int) -> Trace:
    """The trace in a file, which must have an episode of that number."""
    from usvauv.env.record.trace import Trace

    trace = Trace.load(path)
    if not 0 <= episode < (count := trace.power.shape[1]):
        raise UserError(f"--episode {episode}: {path} has episodes 0 to {count - 1}")
    return trace


def _parse_at(text: str) -> float | tuple[float, float]:
    """Read a moment, or begin and end of a stretch, s."""
    try:
        begin, *end = map(float, text.split(":"))
    except ValueError:
        begin, end = 0.0, [0.0, 0.0]
    if len(end) > 1:
        raise UserError(f"--at {text!r}: expected seconds of mission, like 120, or a stretch of it, like 120:180")
    return (begin, end[0]) if end else begin
