"""Figure of the sea alone: maps at four times, a section over time, elevation in the middle, spectrum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from usvauv.cli.sea_view.surface import LONG_WAVES, SHADED, LevelSurface, Section, land, thumbnail, weather
from usvauv.env.render import figures, style
from usvauv.env.render.figures import WrittenOut, log_ticks, save_figure, set_title, style_axes
from usvauv.env.render.layout import Rectangle
from usvauv.env.render.style import ON_DARK, clock, web
from usvauv.env.render.views.sea_surface import MapView
from usvauv.env.sea.simulation import SeaSimulation
from usvauv.env.sea.storm import System, cumulative, density, moment, total_height, wave_systems
from usvauv.env.site.site import Site
from usvauv.env.storage.memory import require

LEVELS = figures.LinearSegmentedColormap.from_list("levels", [web(colour) for colour in style.SEA])
MAPS = 4
PROBES = 12  # points a side at which the spectrum is measured
SEGMENT = 12.0  # length in peak periods of the segments whose spectra are averaged
RECORD_BYTES = 12288.0  # of memory: a section, the probes, what is drawn of them, and Python's own
LEAST_RANGE = 0.1  # m, of the axis of elevations
TARGET, AMBER = "#ff9d66", web(LONG_WAVES)
SHORTEST = 16  # least number of records for a spectrum


class SeaFigure:
    """A figure of a sea by records to come, of which those at `MAPS` evenly spaced times are shown as maps.

    A context manager: the figure is drawn when the context ends, and not at all after an error.

    Raises:
        MemoryNeeded: the records do not fit into memory.
    """

    def __init__(self, out: Path, sea: SeaSimulation, records: int) -> None:
        require(RECORD_BYTES * records, f"a figure of {records} records, by --duration and --interval")
        self._out, self._sea = out, sea
        self._section = Section(sea.site)
        self._wanted = {round(place) for place in np.linspace(0, records - 1, MAPS)}
        self._maps: list[tuple[float, np.ndarray]] = []
        self._last: tuple[float, np.ndarray]
        self._times: list[float] = []
        self._sections: list[np.ndarray] = []
        self._middle: list[tuple[float, float]] = []
        self._probes: list[np.ndarray] = []
        self._storm: list[np.ndarray] = []  # elevation of the storm's part and its slopes at the probes, (P, 3)
        rows, columns = (
            np.unique(np.linspace(0, count - 1, PROBES + 2).round().astype(int)[1:-1])
            for count in (len(sea.y), len(sea.x))
        )
        probed = np.zeros_like(sea.wet)
        probed[np.ix_(rows, columns)] = True
        self._at = np.nonzero(probed & sea.wet)
        self._systems = wave_systems(sea.site)

    def add(self, sea: SeaSimulation) -> None:
        """Record the present sea."""
        surface = sea.surface()
        small = thumbnail(surface.elevation)
        self._last = sea.time, small
        if len(self._times) in self._wanted:
            self._maps.append(self._last)
        self._times.append(sea.time)
        self._sections.append(self._section.along(small).astype(np.float32))
        self._probes.append(surface.elevation[self._at])
        if self._systems:
            self._storm.append(self._heave_and_slopes(surface.storm))
        middle = len(sea.y) // 2, len(sea.x) // 2
        self._middle.append((float(surface.elevation[middle]), float(surface.storm[middle])))

    def _heave_and_slopes(self, field: np.ndarray) -> np.ndarray:
        """Values of a field at the probes, and its slopes towards east and north, (P, 3)."""
        values = [field[self._at]]
        for axis, spacing in ((1, self._sea.spacing[0]), (0, self._sea.spacing[1])):
            low, high = list(self._at), list(self._at)
            low[axis], high[axis] = np.maximum(low[axis] - 1, 0), np.minimum(high[axis] + 1, field.shape[axis] - 1)
            values.append((field[tuple(high)] - field[tuple(low)]) / ((high[axis] - low[axis]) * spacing))
        return np.stack(values, axis=-1)

    def __enter__(self) -> SeaFigure:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None and self._times:
            if self._maps[-1][0] != self._last[0]:  # the simulation was stopped early
                self._maps.append(self._last)
            self._draw()

    @figures.plain()
    def _draw(self) -> None:
        scenario, duration = self._sea.scenario, self._times[-1]
        surface = self._relief()
        still, level = surface.limit == 0.0, surface.level
        ends = level - (surface.limit or 1.0), level + (surface.limit or 1.0)
        figure = figures.Figure(figsize=(13.6, 9.0), facecolor=ON_DARK.background)
        grid = {"left": 0.065, "right": 0.93, "wspace": 0.14}
        top = figure.add_gridspec(1, len(self._maps) + 1, width_ratios=[1] * len(self._maps) + [0.045], **grid)
        top.update(bottom=0.55, top=0.845)
        low = figure.add_gridspec(2, 2, left=0.065, right=0.965, bottom=0.075, top=0.465, wspace=0.2, hspace=0.32)
        low.set_width_ratios((1.55, 1))
        maps = [figure.add_subplot(top[0, place]) for place in range(len(self._maps))]
        for axes, (time, field) in zip(maps, self._maps, strict=True):
            relief = surface.relief(field)
            relief[land(self._sea, relief.shape[1], relief.shape[0])] = style.LAND
            self._draw_map(axes, relief)
            set_title(axes, f"t = {clock(time)}")
            if axes is not maps[0]:
                axes.set_yticklabels([])
        maps[0].set_ylabel("y (north), m")
        bar = figure.add_subplot(top[0, -1])
        shades = figures.ScalarMappable(figures.Normalize(*ends), LEVELS)
        figure.colorbar(shades, cax=bar, extend="both").outline.set_visible(False)
        bar.set_title("η, m", color=ON_DARK.muted, fontsize=9.5, loc="left", pad=8)
        section, middle = (figure.add_subplot(low[row, 0]) for row in (0, 1))
        right = low[:, 1].get_position(figure)
        spectrum = figure.add_axes((right.x0, right.y0, right.width, 0.43 - right.y0))
        self._draw_section(section, ends)
        self._draw_level(middle, level)
        self._draw_spectrum(spectrum, still)
        middle.set_facecolor(ON_DARK.card)
        spectrum.set_facecolor(ON_DARK.card)
        for axes in (*maps, bar, section, middle, spectrum):
            style_axes(axes)
        title = f"Sea of “{scenario.name}”" + (f" is {surface.stillness}" if still else "")
        cells = f"{len(self._sea.x)} × {len(self._sea.y)} cells of {self._sea.spacing[0]:.3g} m"
        about = f"{weather(self._sea)} · seed {self._sea.seed} · {clock(duration)} min · {cells}"
        figure.text(0.065, 0.955, title, color=ON_DARK.text, fontsize=16, fontweight="bold", va="center")
        figure.text(0.065, 0.92, about, color=ON_DARK.muted, fontsize=10, va="center")
        figure.text(0.065, 0.89, self._beside(), color=ON_DARK.muted, fontsize=10, va="center")
        save_figure(figure, self._out)

    def _beside(self) -> str:
        """What was measured of the storm beside what is wanted; empty without a storm."""
        if not self._systems:
            return ""
        records = np.array(self._storm)
        if len(records) < SHORTEST or not records.size:
            return f"too short to measure the storm: below {SHORTEST} records"
        found = measured(records, self._sea.interval, SEGMENT * self._systems[0].peak_period)
        goal = wanted(self._systems)
        long = f"{len(records) * self._sea.interval / self._systems[0].peak_period:.0f} peak periods"
        return (
            f"storm as measured in {long} (as wanted): Hs {found.height:.2f} m ({goal.height:.3g} m),"
            f" Tp {found.period:.1f} s ({goal.period:.3g} s), directional spread {math.degrees(found.spread):.0f}°"
            f" ({math.degrees(goal.spread):.0f}°)"
        )

    def _relief(self) -> LevelSurface:
        """The surface with the colours and shades of the video."""
        area = self._sea.scenario.area
        per_metre = SHADED / max(area.width, area.length)
        whole = Rectangle(0, 0, round(area.width * per_metre), round(area.length * per_metre))
        return LevelSurface(
            np.stack([field for _, field in self._maps]), MapView(area, whole), np.array(self._sections)
        )

    def _draw_map(self, axes: figures.Axes, relief: np.ndarray) -> None:
        area, (a, b) = self._sea.scenario.area, self._section.ends
        extent = (0, area.width, 0, area.length)
        axes.imshow(relief[..., ::-1], extent=extent, interpolation="bilinear")
        axes.plot(*zip(a, b, strict=True), color=ON_DARK.text, lw=0.9, ls=(0, (5, 4)), alpha=0.8)
        for name, place in (("A", a + 0.05 * (b - a)), ("B", b + 0.05 * (a - b))):
            label = axes.text(place[0], place[1], name, color=ON_DARK.text, fontsize=10, fontweight="bold", ha="center")
            label.set_path_effects([figures.withStroke(linewidth=2.5, foreground=web(style.OUTLINE))])
        axes.set_xlabel("x (east), m")
        axes.xaxis.set_major_locator(figures.MaxNLocator(4))
        axes.yaxis.set_major_locator(figures.MaxNLocator(4))

    def _draw_section(self, axes: figures.Axes, ends: tuple[float, float]) -> None:
        extent = (0, self._times[-1], 0, self._section.length)
        levels = np.array(self._sections).T
        axes.imshow(levels, LEVELS, vmin=ends[0], vmax=ends[1], origin="lower", extent=extent, aspect="auto")
        axes.set_ylabel("from A, m")
        set_title(axes, f"η from {self._section.words}")

    def _draw_level(self, axes: figures.Axes, level: float) -> None:
        everything, storm = np.array(self._middle).T
        axes.axhline(level, color=ON_DARK.muted, lw=0.6, alpha=0.6)
        if storm.any() and (everything != storm).any():
            axes.plot(self._times, everything - storm, color=AMBER, lw=1.4, label="long waves alone")
        axes.plot(self._times, everything, color=ON_DARK.water, lw=1.3, label="all")
        axes.set(xlim=(0, self._times[-1]), xlabel="time, s", ylabel="η, m")
        low, high = axes.get_ylim()
        middle, half = (low + high) / 2, max(high - low, LEAST_RANGE) / 2
        axes.set_ylim(middle - half, middle + half)
        set_title(axes, "η in the middle")
        if len(axes.lines) > 2:
            place = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.99), "ncols": 2, "borderpad": 0.2}
            axes.legend(frameon=False, labelcolor=ON_DARK.muted, fontsize=9, **place)

    def _draw_spectrum(self, axes: figures.Axes, still: bool) -> None:
        """Draw the mean spectrum over probes all over the area, and the one that the storm is drawn from."""
        scenario = self._sea.scenario
        axes.set(xlabel="frequency, Hz", ylabel="spectral density of η, m²/Hz")
        set_title(axes, "Spectrum, mean over the area", pad=26)
        if still or len(self._times) < SHORTEST:
            words = "nothing moves" if still else f"too short: below {SHORTEST} records"
            axes.text(0.5, 0.5, words, color=ON_DARK.muted, ha="center", transform=axes.transAxes)
            axes.set(xticks=[], yticks=[])
            return
        step = self._sea.interval
        piece = SEGMENT * self._systems[0].peak_period if self._systems else math.inf
        frequency, density = spectrum(np.array(self._probes), step, piece)
        axes.loglog(frequency, density, color=ON_DARK.water, lw=1.6, label="simulated")
        highest, last = density.max(), frequency[-1]
        if self._systems:
            f, target = target_spectrum(self._sea.site)
            axes.loglog(f, target, color=TARGET, lw=1.6, label=f"target, Hs {total_height(self._systems):.3g} m")
            highest, last = max(highest, target.max()), min(last, 1.5 * f[-1])
        ends = 1 / scenario.sea.irregular_period_max, 1 / scenario.sea.irregular_period_min
        if scenario.sea.irregular_rms != 0 and ends[1] > frequency[0]:
            axes.axvspan(*ends, color=AMBER, alpha=0.15, lw=0, label="forced long waves")
        axes.set(xlim=(frequency[0], last), ylim=(1e-5 * highest, 2 * highest))
        log_ticks(axes.xaxis)
        axes.yaxis.set_major_formatter(WrittenOut())
        axes.grid(color=ON_DARK.line, lw=0.6)
        place = {"loc": "lower left", "bbox_to_anchor": (-0.01, 0.99), "ncols": 3, "borderpad": 0.2}
        axes.legend(frameon=False, labelcolor=ON_DARK.muted, fontsize=9, **place)


class Waves(NamedTuple):
    """Significant height, m, peak period, s, and circular standard deviation of the direction of travel, rad."""

    height: float
    period: float
    spread: float


def spectrum(
    records: np.ndarray, step: float, piece: float, beside: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """One-sided spectral density of records (T, P), or the cross spectrum with others, by Welch's method: means over P
    and over segments that overlap by half, their means removed, in a window of Hann. Records are taken every `step` s,
    a segment is a piece of so many seconds, at most the whole record.

    Returns:
        Frequencies (F,) above 0, Hz, and density (F,), 1/Hz times the records' unit squared.
    """
    count = round(min(len(records), max(SHORTEST, piece / step)))
    window = np.hanning(count + 2)[1:-1]
    found = [
        figures.mlab.csd(one, other, count, 1 / step, figures.mlab.detrend_mean, window, count - max(1, count // 2))
        for one, other in zip(records.T, (records if beside is None else beside).T, strict=True)
    ]
    density = np.mean([np.asarray(each) for each, _ in found], axis=0)[1:]
    return np.asarray(found[0][1])[1:], density.real if beside is None else density


def measured(records: np.ndarray, step: float, piece: float) -> Waves:
    """Height, period and spread of waves from elevation and its slopes towards east and north, (T, P, 3).

    The spread is that of a buoy that heaves, pitches and rolls (Longuet-Higgins, Cartwright & Smith 1963): from the
    first moments of the direction in each frequency, weighted by its energy.
    """
    heave, *slopes = np.moveaxis(records, -1, 0)
    frequency, density = spectrum(heave, step, piece)
    steepness = sum(spectrum(slope, step, piece)[1] for slope in slopes)
    moment = np.array([-np.imag(spectrum(heave, step, piece, slope)[1]) for slope in slopes])  # (2, F)
    share = np.sqrt(density / np.maximum(steepness, 1e-30))
    length = np.hypot(*(moment * share).sum(1)) / density.sum()
    peak = slice(max(int(density.argmax()) - 1, 0), int(density.argmax()) + 2)
    period = density[peak].sum() / (density[peak] * frequency[peak]).sum()
    return Waves(4 * float(heave.std()), float(period), math.sqrt(2 * max(0.0, 1 - float(length))))


def wanted(systems: Sequence[System]) -> Waves:
    """What short waves are drawn from.

    Of several systems the period is that of the highest, and the spread that of all directions together.
    """
    height = total_height(systems)
    length = abs(sum(system.significant_height**2 * moment(system) for system in systems)) / height**2
    highest = max(systems, key=lambda system: system.significant_height)
    return Waves(height, highest.peak_period, math.sqrt(2 * (1 - length)))


def target_spectrum(site: Site) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (Hz) and spectral density (m²/Hz) of the spectrum that the short waves of a site are drawn from."""
    scenario, spectra = site.scenario, []
    for system in wave_systems(site):
        omega, S = density(system, scenario.shortest_wave, scenario.area.depth, scenario.sea.gravity)
        f = omega / (2 * math.pi)
        spectra.append((f, S * (system.significant_height / 4) ** 2 / cumulative(f, S)[-1]))
    if len(spectra) == 1:
        return spectra[0]
    f = np.unique(np.concatenate([f for f, _ in spectra]))
    return f, np.sum([np.interp(f, *spectrum, left=0, right=0) for spectrum in spectra], axis=0)
