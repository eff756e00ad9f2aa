"""Every figure and table of the docs anew: what makes which, by the commands that the pages name.

    python -m benchmarks.artefacts --list
    python -m benchmarks.artefacts --only front --only validation

Without `--only` all are made, one after the other: most take minutes, `reproduction` and `generalisation` hours.
Pictures are written over those in `docs/`. What a command prints is kept in the folder of `--work` as NAME.txt, for the
page's tables.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from usvauv.env.render.style import THEMES

ROOT = Path(__file__).parents[1]
USVAUV = (sys.executable, "-c", "from usvauv.cli.app import main; main()")


class Artefact(NamedTuple):
    """What is made by commands, one after the other.

    Attributes:
        page: in `docs/`, or README.md, that shows it.
        commands: with WORK for the folder of `--work`.
        pictures: file in `docs/` → where a command leaves it; nothing where it is written in place.
    """

    page: str
    commands: tuple[str, ...]
    pictures: dict[str, str] = {}  # noqa: RUF012 (never changed)


def _pair(stem: str) -> list[str]:
    return [f"{stem}-{theme}.png" for theme in THEMES]


def _study(page: str, module: str, *options: str, picture: str = "") -> Artefact:
    """A study's command; `picture` is the stem of those that it writes."""
    command = " ".join(
        [f"python -m benchmarks.{module}", *options, *([f"--out docs/{picture}.png"] if picture else [])]
    )
    return Artefact(page, (command,), dict.fromkeys(_pair(picture), "") if picture else {})


_PAPER = [name for figure in ("table2", "fig3", "fig4a", "fig4b") for name in _pair(figure)]
_PAPER += [f"{figure}.csv" for figure in ("table2", "fig3", "fig4b")]
_POLICIES = ("sac-extreme", "clear", "pace", "straight", "crab", "zermelo", "random")
_LEARNED = [(f"--seed {seed}", f"v{seed}.json") for seed in range(3)]
_LEARNED.append(("--set nodes.information=own-visits", "o.json"))

ARTEFACTS = {
    "missions": Artefact(
        "video.md",
        (
            "usvauv simulate --duration 100 --at 64:100 --view sea --size 800x500 --fps 15 --out docs/mission.webp",
            "usvauv simulate --duration 641 --at 641 --out docs/mission.png",
            "usvauv simulate --duration 300 --at 300 --view both --theme dark --out docs/both-dark.png",
            "usvauv simulate --duration 300 --at 300 --view both --theme light --out docs/both-light.png",
        ),
        {"mission.webp": "", "mission.png": "", "both-light.png": "", "both-dark.png": ""},
    ),
    "wide": Artefact(
        "collaboration.md",
        (
            "usvauv simulate wide --duration 331 --at 331 --theme light --out docs/wide-light.png",
            "usvauv simulate wide --duration 331 --at 331 --out docs/wide-dark.png",
        ),
        {"wide-light.png": "", "wide-dark.png": ""},
    ),
    "report": Artefact(
        "report.md",
        (
            "usvauv eval wide --policy pace --usv fim --usv visit --usv belief --out WORK/report.csv"
            " --report WORK/comparison",
        ),
    ),
    "collaboration": Artefact(
        "collaboration.md",
        ("usvauv reproduce collaboration --out WORK/wide",),
        {name: f"wide/reproduction/{name}" for name in _pair("collaboration")},
    ),
    "clairvoyant": _study("collaboration.md", "studies.clairvoyant"),
    "hindsight": _study("decisions.md", "studies.hindsight", "--episodes 64"),
    "reproduction": Artefact(
        "reproduction.md",
        ("usvauv reproduce all --out WORK/paper",),
        {f"reproduction/{name}": f"paper/reproduction/{name}" for name in _PAPER},
    ),
    "errata": Artefact(
        "errata.md",
        (
            "usvauv eval paper-ideal --set reward.collaboration=0 --policy straight:1.2 --policy straight:1.45"
            " --policy straight:2.2 --episodes 200 --seed 2026 --out WORK/errata.csv",
        ),
    ),
    "policies": Artefact(
        "policies.md",
        (
            f"usvauv eval extreme --policy {' --policy '.join(_POLICIES)} --episodes 200 --seed 2026"
            " --out WORK/policies.csv",
        ),
    ),
    "policies-wide": Artefact(
        "policies.md",
        (
            "usvauv eval wide --policy sac-wide --policy clear --policy pace --policy straight --episodes 100"
            " --seed 2026 --out WORK/policies-wide.csv",
        ),
    ),
    "front": _study("policies.md", "studies.front", picture="front"),
    "algorithms": _study("algorithms.md", "studies.pendulum"),
    "generalisation": _study(
        "generalisation.md", "studies.generalisation", "--out WORK/generalisation --steps 200000 --episodes 50"
    ),
    "decisions": _study("decisions.md", "studies.decisions"),
    "decisions-knowledge": _study("decisions.md", "studies.decisions", "--part knowledge"),
    "decisions-survey": Artefact(
        "decisions.md",
        (
            *(f"usvauv train-targets survey {how} --out WORK/{file}" for how, file in _LEARNED),
            "python -m benchmarks.studies.decisions --part survey --episodes 200 --learned "
            + " --learned ".join(f"WORK/{file}" for _, file in _LEARNED),
        ),
    ),
    "fix-error": _study("fix-error.md", "studies.fix_error", picture="fix-error"),
    "vehicles": _study("vehicles.md", "vehicles"),
    "passing": Artefact(
        "vehicles.md",
        ("usvauv train wide-torpedo --algorithm ppo --steps 1000000 --seed 1 --out WORK/ppo-wide-torpedo",),
    ),
    "boats": _study("vehicles.md", "studies.boats"),
    "autopilot": _study("vehicles.md", "studies.autopilot", picture="autopilot"),
    "eddies": _study("model.md", "studies.eddies"),
    "record": _study("record.md", "studies.buoy", picture="buoy"),
    "refraction": _study("refraction.md", "studies.refraction", picture="refraction"),
    "wide-array": _study("positioning.md", "studies.wide_array"),
    "multipath": _study("positioning.md", "studies.multipath"),
    "fixes": _study("positioning.md", "usbl", "--json"),
    "validation": Artefact("validation.md", ("python -m tests.cases",)),
    "sea-rates": _study("performance.md", "sea", "--json"),
    "world-rates": _study("performance.md", "worlds"),
    "learning": _study("performance.md", "learning"),
    "start": _study("performance.md", "start"),
    "curves": _study("performance.md", "curves", picture="curves"),
    "step-profile": _study("performance.md", "step_profile", picture="step-profile"),
    "step-profile-wide": _study("performance.md", "step_profile", "wide", picture="step-profile-wide"),
    "planner": _study("performance.md", "plan", "--json"),
    "training": _study("performance.md", "train"),
    "scale": _study("scale.md", "scale"),
    "stream": _study("scale.md", "stream"),
    "seeds": Artefact(
        "scale.md",
        (
            "python -m benchmarks.seeds --seeds 8 --pairs 4 --updates 200",
            "python -m benchmarks.seeds --seeds 8 --pairs 2 --updates 200 --learn batch=64",
        ),
    ),
    "ranks": _study("scale.md", "ranks"),
    "video": _study("performance.md", "video"),
    "live": Artefact(
        "live.md", ("python -m benchmarks.live", "python -m benchmarks.live --out docs/live.png"), {"live.png": ""}
    ),
}


def make(name: str, work: Path) -> None:
    """Run the commands of an artefact and put its pictures in their places.

    Raises:
        CalledProcessError: a command failed.
    """
    artefact = ARTEFACTS[name]
    with (work / f"{name}.txt").open("w", encoding="utf-8") as printed:
        for command in artefact.commands:
            program, *arguments = shlex.split(command.replace("WORK", str(work)))
            start = USVAUV if program == "usvauv" else (sys.executable,)
            over = ["--force"] if arguments[0] == "simulate" else []  # a picture that other arguments made
            subprocess.run([*start, *arguments, *over], cwd=ROOT, stdout=printed, check=True)
    for picture, source in artefact.pictures.items():
        if source:
            (ROOT / "docs" / picture).write_bytes((work / source).read_bytes())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--list", action="store_true", help="print what is made by which command, and make nothing")
    parser.add_argument("--only", action="append", choices=list(ARTEFACTS), metavar="NAME", help="may be repeated")
    parser.add_argument("--work", type=Path, default=Path("runs/artefacts"), help="folder of what is not kept in docs/")
    arguments = parser.parse_args()
    for name in arguments.only or ARTEFACTS:
        artefact = ARTEFACTS[name]
        if arguments.list:
            print(f"{name}: {', '.join([artefact.page, *artefact.pictures])}")
            print(*(f"    {command}" for command in artefact.commands), sep="\n")
            continue
        print(name, flush=True)
        work = arguments.work.resolve()
        work.mkdir(parents=True, exist_ok=True)
        make(name, work)


if __name__ == "__main__":
    main()
