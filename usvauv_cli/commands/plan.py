"""`usvauv plan`: the best place of the boat for given positions of its AUVs, as table, figure and JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from usvauv.cli import terminal
from usvauv.cli.commands import options
from usvauv.cli.commands.options import Arch, Force, Overrides, Plugins, ScenarioName, of_kind, writable
from usvauv.kernels.errors import UserError

if TYPE_CHECKING:
    from usvauv.cli.boat_placement.fix_log import Log, PositionEstimate
    from usvauv.env.accuracy.boat_place import BoatPlace, Plan
    from usvauv.env.scenario import Scenario

FORMATS = (".png", ".pdf", ".svg", ".geojson")
LONGEST_NAME = 16  # characters of a name in a table
MOST_DRAWN = 200  # places to compare with, each a row of the figure's legend


def plan(
    context: typer.Context,
    scenario: ScenarioName = "extreme",
    auv: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y,Z",
            help="An AUV: east, north and depth (positive down), m; up to 16 times. Where the scenario has a place on"
            " Earth also latitude and longitude, 22.5101N,114.0203E,100 or 22°30.6'N,114°1.2'E,100.",
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            callback=of_kind("log"),
            help="Fixes of a USBL instead of --auv: CSV with time, auv, depth and x, y or latitude, longitude; or its"
            " sentences $PSIMSSB, $PSONLLD, $PTSAG, USBLLONG, with $--GGA and $--HDT of the boat.",
        ),
    ] = None,
    beacon: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="A beacon of --log to plan for; may be repeated. Default: all under water."),
    ] = None,
    compare: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y",
            help="A place of the boat to compare with, m, or latitude and longitude as in --auv; may be repeated.",
        ),
    ] = None,
    slope: Annotated[
        str,
        typer.Option(
            metavar="SX,SY",
            help="Slope of the surface the array lies on, towards east and north, for the errors. Default: level.",
        ),
    ] = "0,0",
    out: Annotated[
        Path | None,
        typer.Option(
            help="Figure: .png, .pdf or .svg; or .geojson for a map, where the scenario has a place on Earth. Default"
            " plan.png; none with --json - alone."
        ),
    ] = None,
    json_file: Annotated[
        str | None, typer.Option("--json", metavar="FILE", help="Result as JSON; - is standard output.")
    ] = None,
    arch: Arch = "auto",
    overrides: Overrides = None,
    force: Force = False,
    plugins: Plugins = None,
) -> None:
    """Where should the boat be? Find the place from which a USBL locates its AUVs best, and the errors to expect.

    Nothing is learned or simulated: the place maximises the scenario's `planner.objective` of the fixes' Fisher
    information (in metres) over the whole area, each AUV's weighted by the probability of a good fix. The table gives
    the error of one good fix of each AUV from this place, from the AUVs' centroid and from every `--compare`: standard
    deviations along the axes of its horizontal error ellipse, and their geometric mean and rms over the located AUVs.
    They include all causes in the tables. The array is level; `--slope` tilts it for the errors. Objective d minimises
    the mean, a the rms; figures show the minimised one. "detected" is the probability that the tone of a fix is
    detected, "good" that in addition the fix is unambiguous (no phase has wrapped) and has a real depth. An AUV is
    located if at least 90 % of its fixes are good; a line on standard error lists the AUVs not located from the
    optimum, with the reason and a remedy.

    Numbers are metres from the area's south-west corner. A scenario has a place on Earth where `water.latitude` and
    `water.longitude` of that corner are set or `water` names a file; then positions can be latitudes and longitudes
    with N, S, E or W, and results have both.

    With `--log` the position of each AUV is estimated from its last seven fixes; a table has it with the scatter of the
    fixes, the age of the last one at the end of the log, and the uncertainty of the place since then, over which
    probabilities are averaged; an AUV that can be anywhere by now is left out. Fixes that the system marks as bad, the
    ship itself and beacons at the surface are left out; a line on standard error counts them. If the scenario has no
    place on Earth, a log in degrees becomes the centre of the area.

    **Examples:**

    `usvauv plan --auv 60,80,100 --auv 150,120,90 --compare 0,0`

    Array, sonar, noise and area of another scenario: `usvauv plan wide --auv 300,400,60 --auv 700,500,60`

    Your own USBL, a transponder in a 600 m wide area: `usvauv plan --auv 100,80,40 --auv 450,300,180
    --set area.width=600 --set area.length=400 --set area.depth=250 --set acoustics.path=transponder
    --set acoustics.source_level=170 --set usbl.spacing=0.025 --set usbl.attitude_error=0.003`

    From fixes: `usvauv plan --log fixes.csv`, `usvauv plan --log usbl.txt --beacon M03 --set area.depth=250`

    A place on Earth: `usvauv plan --set water.latitude=22.51 --set water.longitude=114.02
    --auv 22.5101N,114.0203E,100 --auv 22.5115N,114.0212E,90`

    For a script: `usvauv plan --auv 60,80,100 --auv 150,120,90 --json - | jq .optimum`

    The keys of the JSON are explained in `docs/export.md`.
    """
    import json
    from dataclasses import asdict, replace

    setting = scenario_of(scenario, overrides or ())

    from usvauv.env.accuracy.boat_place import solve
    from usvauv.env.exchange import geojson
    from usvauv.env.site.positions import DEGREES, auv_position, boat_position, look_geographic
    from usvauv.env.storage.files import atomic_write

    estimates: list[PositionEstimate] = []
    read: Log | None = None
    hint = DEGREES if look_geographic(auv or (), setting) else ""
    auvs = [auv_position(text, setting, hint) for text in auv or ()]
    if log:
        if auvs:
            raise UserError("--log: gives the AUVs; must go without --auv")
        from usvauv.cli.boat_placement.fix_log import auvs_of_log

        estimates, read = auvs_of_log(log, setting, beacon or ())
        setting = read.scenario
        auvs = [(found.x, found.y, found.depth) for found in estimates]
    elif beacon:
        raise UserError("--beacon: selects AUVs of a log; needs --log")
    if not auvs:
        raise UserError("--auv: give each AUV as X,Y,Z in metres, Z its depth, for example --auv 60,80,100")
    setting = with_team(setting, auvs)
    others = [boat_position(text, setting) for text in compare or ()]
    gradient = surface_slope(slope)
    to_stdout = json_file == "-"
    if out is None and not to_stdout:
        out = Path("plan.png")
    if out:
        out = writable(context, out, "--out", FORMATS)
        if out.suffix.lower() == geojson.ENDING:
            geojson.frame_of(setting)
        if len(others) > MOST_DRAWN:
            raise UserError(
                f"--compare: {len(others)} places given, at most {MOST_DRAWN} in a figure; --json - has none"
            )
    if json_file and not to_stdout:
        writable(context, Path(json_file), "--json", (".json",))

    uncertainty = [found.uncertainty for found in estimates]
    planner = setting.planner
    result, landscape = solve(
        setting, auvs, others, planner.objective, planner.measurement, gradient, arch, uncertainty, names_of(estimates)
    )
    first = read.warnings if read else [f"--auv: {hint}"] if hint else []
    result = replace(result, warnings=[*first, *result.warnings])
    for warning in result.warnings:
        typer.echo(f"warning: {warning}", err=True)
    if json_file:
        fields = asdict(result)
        if read:
            fields |= {"log": [found._asdict() for found in estimates], "left_out": read.left_out}
        text = json.dumps(fields, indent=1, allow_nan=False)
        if to_stdout:
            typer.echo(text)
        else:
            with atomic_write(Path(json_file)) as partial:
                partial.write_text(text + "\n", encoding="utf-8")
    if out and out.suffix.lower() == geojson.ENDING:
        geojson.write(out, geojson.of_plan(result, setting))
    elif out:
        from usvauv.cli.boat_placement import figure

        figure.draw(result, landscape, out)
    if not to_stdout:
        if read:
            print_estimates(estimates)
        print_table(result)
        for path in filter(None, (out, json_file)):
            typer.echo(f"written: {Path(path).resolve()}")


def scenario_of(name: str, overrides: Sequence[str]) -> Scenario:
    """The scenario, whose own `auv.depth` gives way where the water is not so deep: the AUVs given have theirs."""
    from usvauv.env.scenario import Scenario
    from usvauv.env.scenario.fields import layers_of, merged, parse_override

    usual = {section: {"depth": getattr(Scenario.from_dict({}), section).depth} for section in ("area", "auv")}
    data = merged([usual, *(layer.data for layer in layers_of(name)), *map(parse_override, overrides)])
    depths = [data[section]["depth"] for section in usual if isinstance(data[section], Mapping)]
    gives_way = len(depths) == 2 and all(isinstance(depth, int | float) for depth in depths) and depths[1] >= depths[0]
    return options.scenario_of(name, [*([f"auv.depth={0.9 * depths[0]}"] if gives_way else []), *overrides], True)


def surface_slope(text: str) -> tuple[float, float]:
    """Read SX,SY of the surface, each at most 1 (45°)."""
    from usvauv.env.site.positions import numbers

    x, y = numbers("--slope", text, "SX,SY", "")
    if not (abs(x) <= 1 and abs(y) <= 1):
        raise UserError(f"--slope {text!r}: each must be between -1 and 1")
    return x, y


def with_team(scenario: Scenario, auvs: list[tuple[float, float, float]]) -> Scenario:
    """The scenario with as many AUVs as are given, their mean depth being its cruise depth."""
    from usvauv.kernels.limits import MAX_AUVS

    if len(auvs) > MAX_AUVS:
        raise UserError(f"--auv: {len(auvs)} AUVs given, at most {MAX_AUVS} are possible")
    depth = sum(auv[2] for auv in auvs) / len(auvs)
    team = scenario.auv.model_copy(update={"count": len(auvs), "depth": depth, "separation": "geometry"})
    return scenario.model_copy(update={"auv": team})


def number(value: float | None, digits: int) -> str:
    """A number with so many digits after the point, or "none" where there is none, see `FixError` and `BoatPlace`."""
    return "none" if value is None else f"{value:.{digits}f}"


def metres(value: float | None) -> str:
    """A length to the millimetre, from 100 m on to the decimetre, from 100 km on to two digits; "none" as `number`."""
    if value is not None and value >= 1e5:
        return f"{value:.1e}"
    return number(value, 3 if value is None or value < 100 else 1)


def expectation(place: BoatPlace) -> str:
    """What to expect of fixes from a place, in words."""
    count = len(place.errors)
    if not place.located:
        return "no AUV is located from there" if count > 1 else "the AUV is not located from there"
    of = "" if place.located == count else f", {place.located} of {count} AUVs located"
    return f"the error of a fix is unbounded{of}" if place.rms is None else f"rms error of a fix {place.rms:.2f} m{of}"


def names_of(estimates: list[PositionEstimate]) -> list[str]:
    """The AUVs' names in the log, printable."""
    return ["".join(c if c.isprintable() else repr(c)[1:-1] for c in found.name) for found in estimates]


def print_estimates(estimates: list[PositionEstimate]) -> None:
    """Print where each AUV is by its fixes, and how much they scatter."""
    short = terminal.shortened(names_of(estimates), LONGEST_NAME)
    rows = [
        (short[name], str(found.fixes), f"{found.x:.1f}", f"{found.y:.1f}", f"{found.depth:.1f}",
         metres(found.noise), f"{found.age:.0f}", metres(found.uncertainty))
        for found, name in zip(estimates, names_of(estimates), strict=True)
    ]  # fmt: skip
    headings = ("AUV", "fixes", "x m", "y m", "depth m", "noise rms m", "age s", "now ± m")
    terminal.print_table(headings, rows)
    typer.echo()


def print_table(result: Plan) -> None:
    """Print each place with ln of the objective and the fixes of each AUV to expect from there."""
    from usvauv.env.accuracy.boat_place import OBJECTIVE_NAMES
    from usvauv.env.accuracy.fix_errors import LEAST_GOOD
    from usvauv.env.site.positions import coordinates

    best = result.optimum
    short = terminal.shortened([auv.name for auv in result.auvs], LONGEST_NAME)
    places = [("optimum", best), ("centroid", result.centroid), *(("compare", p) for p in result.compare)]
    boats = [
        (
            name,
            *(number(value, 2) for value in (place.x, place.y, place.log_objective)),
            metres(place.mean),
            metres(place.rms),
        )
        for name, place in places
    ]
    fixes = [
        (name if k == 0 else "", short[auv.name], f"{error.range:.1f}", metres(error.major), metres(error.minor),
         f"{error.detected:.1%}", f"{error.good:.1%}")
        for name, place in places for k, (auv, error) in enumerate(zip(result.auvs, place.errors, strict=True))
    ]  # fmt: skip
    where = f"x = {best.x:.2f} m, y = {best.y:.2f} m"
    on_earth = [
        (name, coordinates(place.latitude, place.longitude))
        for name, place in (*places, *((f"AUV {short[auv.name]}", auv) for auv in result.auvs))
        if place.latitude is not None and place.longitude is not None
    ]
    if on_earth:
        where += f" ({on_earth[0][1]})"
    value = f"{OBJECTIVE_NAMES[result.objective]} = {number(best.log_objective, 3)}"
    typer.echo(terminal.wrapped(f"Boat at {where}: {value}, {expectation(best)}", 2))
    typer.echo(terminal.wrapped(f"Against the centroid: {result.verdict}", 2))
    array = "level array" if result.slope == (0, 0) else f"array on a slope of {', '.join(map(str, result.slope))}"
    about = (
        f"{result.scenario}, objective {result.objective}, measurement {result.measurement}, {array}; errors are 1 σ;"
        f" rms over the AUVs that are located, those with at least {LEAST_GOOD:.0%} good fixes"
    )
    typer.echo(f"{terminal.wrapped(about, 2)}\n")
    terminal.print_table(("boat", "x m", "y m", OBJECTIVE_NAMES[result.objective], "mean m", "rms m"), boats)
    typer.echo()
    terminal.print_table(("fixes from", "AUV", "range m", "major m", "minor m", "detected", "good"), fixes)
    for name, place in places:
        if name != "centroid":
            typer.echo()
            headings = [f"error by cause, {name}, rms m", *(f"AUV {short[auv.name]}" for auv in result.auvs)]
            causes = [(cause, *map(metres, values)) for cause, values in place.budget.items() if any(values)]
            terminal.print_table(headings, causes)
    for name, there in on_earth:
        typer.echo(f"{name:9s} {there}")
