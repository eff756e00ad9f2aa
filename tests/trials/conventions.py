"""The files of `usvauv sea` and of traces under the checker of the CF conventions, of places with and without a date.

    python -m tests.trials.conventions

The checker gets an environment of its own: it brings a second NetCDF library, which xarray would prefer wherever it is
installed. Only what CF requires counts, not what it recommends. A file without a date cannot meet one requirement: CF
has no time that is counted from no date.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import venv
from pathlib import Path

PLACE = ["water.longitude=114.02", "water.latitude=22.51"]
DATE = [*PLACE, "water.start=2026-11-01T06:00:00"]
UNDATED = ("time does not have correct time units", "should have standard_name='time'")
REQUIRED = "Errors"


def files(folder: Path) -> list[tuple[Path, bool]]:
    """Written files, and whether each has a date."""
    from usvauv import policies
    from usvauv.env import Scenario, World
    from usvauv.env.record.recorder import record
    from usvauv.env.sea.sea_file import SeaFile
    from usvauv.env.sea.simulation import SeaSimulation
    from usvauv.env.world.mission_parameters import first_vortices

    made = []
    for name, changes in (("nowhere", []), ("place", PLACE), ("date", DATE)):
        scenario = Scenario.load("extreme", changes)
        sea, trace = folder / f"sea-{name}.nc", folder / f"trace-{name}.nc"
        water = SeaSimulation(scenario, 0, (20, 20), 1.0, first_vortices(scenario, 0))
        with SeaFile(sea, water) as file:
            file.add(water)
        world = World(scenario, 2, 0)
        record(world, policies.load("straight", world).act, "straight", steps=3, surface=True).save(trace)
        made += [(sea, name == "date"), (trace, name == "date")]
    return made


def errors(checker: Path, path: Path) -> list[str]:
    """What the checker says is required and is not so."""
    command = [str(checker), "--test", "cf:1.11", "--criteria", "strict", str(path)]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    if "Compliance Checker Report" not in said:
        raise RuntimeError(f"{path.name}: the checker failed: {said[-500:]}")
    after = said.partition(REQUIRED)[2].partition("Warnings")[0]
    return sorted({line.removeprefix("* ") for line in after.splitlines() if line.startswith("* ")})


def main() -> None:
    wrong = 0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        venv.create(folder / "venv", with_pip=True)
        binaries = folder / "venv" / "bin"
        subprocess.run([binaries / "python", "-m", "pip", "install", "--quiet", "compliance-checker>=6"], check=True)
        for path, dated in files(folder):
            found = errors(binaries / "compliance-checker", path)
            found = [line for line in found if dated or not any(known in line for known in UNDATED)]
            print(f"{path.name}: {'; '.join(found) or 'nothing wrong'}", flush=True)
            wrong += len(found)
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
