"""The model's sea beside a record: two storms at a wave buoy, hour by hour.

    python -m benchmarks.studies.buoy --out docs/buoy.png

The record is that of station 44005 of NOAA's National Data Buoy Center in the Gulf of Maine, a discus buoy of 3 m in
water that is deep for these waves; it is `ndbc-44005-2012.csv` beside this file. For each hour a sea is drawn from a
JONSWAP spectrum with the hour's Hs and Tp and the γ that DNV-RP-C205, 3.5.5.5, gives them; nothing is fitted. Set
beside the record are the mean period √(m0/m2) of the drawn component waves up to 0.485 Hz, where the buoy's spectrum
ends, and the wind that `sonar` gives such a sea. The buoy's wind is converted from its anemometer's height to 10 m by
the logarithmic profile with the same drag.
"""

from __future__ import annotations

import argparse
import csv
import math
from datetime import datetime
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from usvauv.env.render.figures import write_pair
from usvauv.env.render.style import Ground
from usvauv.env.scenario import Scenario
from usvauv.env.scenario.environment import Storm
from usvauv.env.sea.storm import draw_storm
from usvauv.kernels.positioning import sonar

RECORD = Path(__file__).with_name("ndbc-44005-2012.csv")
ANEMOMETER = 5.0  # m, height on a 3 m discus buoy
SPECTRUM_END = 0.485  # Hz
LEAST_PERIOD = 4.2  # s, of the peak; shorter waves have much of their spectrum beyond its end
GRAVITY = 9.81
ROUGH = 3.0  # m, significant height from which the storms are counted as such
SEAS = 16  # drawn for each hour


def read() -> tuple[list[datetime], np.ndarray]:
    """Times, and rows of wind at the anemometer (m/s), Hs (m), Tp (s) and mean period (s), from `LEAST_PERIOD` on."""
    with RECORD.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    rows = [row for row in rows if float(row["DPD"]) >= LEAST_PERIOD]
    numbers = np.array([[float(row[name]) for name in ("WSPD", "WVHT", "DPD", "APD")] for row in rows])
    return [datetime.fromisoformat(row["time"]) for row in rows], numbers


def peak_enhancement(significant_height: float, peak_period: float) -> float:
    """γ of DNV-RP-C205, 3.5.5.5."""
    return min(max(math.exp(5.75 - 1.15 * peak_period / math.sqrt(significant_height)), 1.0), 5.0)


def mean_period(storm: Storm, shortest_wave: float) -> float:
    """√(m0/m2) of drawn component waves, s."""
    storm = storm.model_copy(update={"spectrum": "jonswap", "shortest_wave": shortest_wave})
    seas = [(2026, index) for index in range(SEAS)]
    amplitude, omega, _, _ = draw_storm(storm, storm.systems, seas, depth=200.0, gravity=GRAVITY)
    energy = amplitude**2
    return 2 * math.pi * math.sqrt(energy.sum() / (energy * omega**2).sum())


def at_ten_metres(wind: float) -> float:
    """Wind at 10 m from that at the anemometer, m/s: U(z) = U10 (1 + √C_D/κ ln(z/10 m))."""
    at_ten = wind
    for _ in range(8):
        at_ten = wind / (1 + math.sqrt(sonar.drag(at_ten)) / sonar.KARMAN * math.log(ANEMOMETER / 10.0))
    return at_ten


def draw(times: list[datetime], panels: dict[str, tuple[np.ndarray, np.ndarray]], ground: Ground) -> Figure:
    """Measured points and the model's line over time, one panel each, without the days between the storms."""
    hours = np.array([(time - times[0]).total_seconds() / 3600 for time in times])
    pause = int(np.argmax(np.diff(hours))) + 1
    hours[pause:] -= hours[pause] - hours[pause - 1] - 4
    figure = Figure(figsize=(9.6, 5), layout="constrained")
    for panel, (title, (measured, modelled)) in zip(figure.subplots(2, 1, sharex=True), panels.items(), strict=True):
        panel.plot(hours, measured, "o", ms=3, color=ground.text, label="buoy 44005")
        for part, label in ((slice(pause), "model"), (slice(pause, None), None)):
            panel.plot(hours[part], modelled[part], color=ground.colours[0], lw=1.4, label=label)
        panel.set(ylabel=title, ylim=(0, None))
    panel.set(xlabel="hours from 28 October 2012 12:50 UTC, then from 7 November 08:50 UTC")
    figure.legend(*panel.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="X.png: figures X-light.png and X-dark.png to write")
    out = parser.parse_args().out
    times, numbers = read()
    wave = GRAVITY / (2 * math.pi * SPECTRUM_END**2)
    hours = [
        {"significant_height": H, "peak_period": T, "gamma": peak_enhancement(H, T)} for _, H, T, _ in numbers.tolist()
    ]
    periods = np.array([mean_period(Storm.model_validate(hour), wave) for hour in hours])
    winds = np.array([sonar.wind_of_growing_sea(H, T) for _, H, T, _ in numbers])
    measured = np.array([at_ten_metres(wind) for wind in numbers[:, 0]])
    rough = numbers[:, 1] >= ROUGH
    print(f"{len(numbers)} hours, {rough.sum()} with Hs ≥ {ROUGH:g} m; model over buoy, median (5 to 95 %) in these:")
    for name, ratio in (("mean period", periods / numbers[:, 3]), ("wind at 10 m", winds / measured)):
        low, middle, high = np.quantile(ratio[rough], (0.05, 0.5, 0.95))
        print(f"  {name}: {middle:.2f} ({low:.2f} to {high:.2f})")
    storm = Scenario.load("extreme").storm
    height = storm.significant_height
    near = abs(numbers[:, 1] - height) < 0.5
    model_wind = sonar.wind_of_growing_sea(height, storm.peak_period)
    print(f"{near.sum()} hours with Hs within 0.5 m of the {height:g} m of `extreme`; median there, and of `extreme`:")
    print(f"  peak period: {np.median(numbers[near, 2]):.1f} s, {storm.peak_period:.1f} s")
    print(f"  mean period: {np.median(numbers[near, 3]):.1f} s, {mean_period(storm, wave):.1f} s")
    print(f"  wind at 10 m: {np.median(measured[near]):.1f} m/s, {model_wind:.1f} m/s")
    moving = mean_period(storm, storm.shortest_wave)
    print(f"  mean period of waves of {storm.shortest_wave:g} m and longer, which move the boat: {moving:.1f} s")
    if out:
        panels = {"mean period, s": (numbers[:, 3], periods), "wind at 10 m, m/s": (measured, winds)}
        write_pair(out, partial(draw, times, panels))


if __name__ == "__main__":
    main()
