"""Figure of the sea alone: maps at four times, a section over time, elevation in the middle, spectrum."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FormatStrFormatter, MaxNLocator, NullLocator

from usvauv_cli.figure_theme import (
    BACKGROUND,
    CARD,
    LINE,
    MUTED,
    OUTLINE,
    TEXT,
    WATER,
    save,
    set_title,
    style_axes,
    web,
)
from usvauv_cli.sea_view.section import Section
from usvauv_cli.sea_view.video import LONG_WAVES, SHADED, land, thumbnail, weather
from usvauv_env.memory import require
from usvauv_env.render import style
from usvauv_env.render.frame_layout import MapView, Rectangle
from usvauv_env.render.sea_layers import SeaSurface
from usvauv_env.render.text import clock
from usvauv_env.scenario import Scenario
from usvauv_env.sea.storm import band, cumulative
from usvauv_env.sea_alone.simulation import SeaSimulation

LEVELS = LinearSegmentedColormap.from_list("levels", [web(colour) for colour in style.SEA])
MAPS = 4
PROBES = 12  # points a side at which the spectrum is measured
SEGMENT = 12.0  # length in peak periods of the segments whose spectra are averaged
SHORTEST = 16  # least number of records for a spectrum
RECORD_BYTES = 4096.0  # of memory: a section, the probes, what is drawn of them, and Python's own
USUAL_BYTES = 800_000  # size of a figure; it hardly depends on the sea
TARGET, AMBER = "#ff9d66", web(LONG_WAVES)


class SeaFigure:
    """A figure of a sea. A context manager: the figure is drawn when the context ends, and not at all after an error.

    Args:
        out: file to write, the format by its suffix.
        sea: at its start.
        records: number of records to come; those at `MAPS` evenly spaced times are shown as maps.

    Raises:
        MemoryNeeded: they do not fit into memory.
    """

    def __init__(self, out: Path, sea: SeaSimulation, records: int) -> None:
        require(RECORD_BYTES * records, f"a figure of {records} records, by --duration and --interval")
        self._out, self._sea = out, sea
        self._section = Section(sea.scenario)
        self._wanted = {round(place) for place in np.linspace(0, records - 1, MAPS)}
        self._maps: list[tuple[float, np.ndarray]] = []
        self._last: tuple[float, np.ndarray]
        self._times: list[float] = []
        self._sections: list[np.ndarray] = []
        self._middle: list[tuple[float, float]] = []
        self._probes: list[np.ndarray] = []
        rows, columns = (
            np.unique(np.linspace(0, count - 1, PROBES + 2).round().astype(int)[1:-1])
            for count in (len(sea.y), len(sea.x))
        )
        probed = np.zeros_like(sea.wet)
        probed[np.ix_(rows, columns)] = True
        self._at = probed & sea.wet

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
        middle = len(sea.y) // 2, len(sea.x) // 2
        self._middle.append((float(surface.elevation[middle]), float(surface.storm[middle])))

    def expected_bytes(self, records: int) -> int:
        """Estimated size of the file."""
        return USUAL_BYTES

    def __enter__(self) -> SeaFigure:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None and self._times:
            if self._maps[-1][0] != self._last[0]:  # the simulation was stopped early
                self._maps.append(self._last)
            self._draw()

    def _draw(self) -> None:
        scenario, duration = self._sea.scenario, self._times[-1]
        surface = self._relief()
        still, limit = surface.limit == 0.0, surface.limit or 1.0
        figure = Figure(figsize=(13.6, 9.0), facecolor=BACKGROUND)
        grid = {"left": 0.065, "right": 0.93, "wspace": 0.14}
        top = figure.add_gridspec(1, len(self._maps) + 1, width_ratios=[1] * len(self._maps) + [0.045], **grid)
        top.update(bottom=0.56, top=0.87)
        low = figure.add_gridspec(2, 2, left=0.065, right=0.965, bottom=0.075, top=0.475, wspace=0.2, hspace=0.32)
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
        shades = ScalarMappable(Normalize(-limit, limit), LEVELS)
        figure.colorbar(shades, cax=bar, extend="both").outline.set_visible(False)
        bar.set_title("η, m", color=MUTED, fontsize=9.5, loc="left", pad=8)
        section, level, spectrum = (figure.add_subplot(low[place]) for place in ((0, 0), (1, 0), (slice(None), 1)))
        self._draw_section(section, limit)
        self._draw_level(level)
        self._draw_spectrum(spectrum, still)
        level.set_facecolor(CARD)
        spectrum.set_facecolor(CARD)
        for axes in (*maps, bar, section, level, spectrum):
            style_axes(axes)
        title = f"Sea of “{scenario.name}”" + (" is still: neither long waves nor a storm" if still else "")
        cells = f"{len(self._sea.x)} × {len(self._sea.y)} cells of {self._sea.spacing[0]:.3g} m"
        about = f"{weather(self._sea)} · seed {self._sea.seed} · {clock(duration)} min · {cells}"
        figure.text(0.065, 0.955, title, color=TEXT, fontsize=16, fontweight="bold", va="center")
        figure.text(0.065, 0.92, about, color=MUTED, fontsize=10, va="center")
        save(figure, self._out)

    def _relief(self) -> SeaSurface:
        """The surface with the colours and shades of the video."""
        area = self._sea.scenario.area
        per_metre = SHADED / max(area.width, area.length)
        whole = Rectangle(0, 0, round(area.width * per_metre), round(area.length * per_metre))
        return SeaSurface(np.stack([field for _, field in self._maps]), MapView(area, whole), SHADED)

    def _draw_map(self, axes: Axes, relief: np.ndarray) -> None:
        area, (a, b) = self._sea.scenario.area, self._section.ends
        extent = (0, area.width, 0, area.length)
        axes.imshow(relief[..., ::-1], extent=extent, interpolation="bilinear")
        axes.plot(*zip(a, b, strict=True), color=TEXT, lw=0.9, ls=(0, (5, 4)), alpha=0.8)
        for name, place in (("A", a + 0.05 * (b - a)), ("B", b + 0.05 * (a - b))):
            label = axes.text(place[0], place[1], name, color=TEXT, fontsize=10, fontweight="bold", ha="center")
            label.set_path_effects([withStroke(linewidth=2.5, foreground=OUTLINE)])
        axes.set_xlabel("x (east), m")
        axes.xaxis.set_major_locator(MaxNLocator(4))
        axes.yaxis.set_major_locator(MaxNLocator(4))

    def _draw_section(self, axes: Axes, limit: float) -> None:
        extent = (0, self._times[-1], 0, self._section.length)
        levels = np.array(self._sections).T
        axes.imshow(levels, LEVELS, vmin=-limit, vmax=limit, origin="lower", extent=extent, aspect="auto")
        axes.set_ylabel("A to B, m")
        set_title(axes, "η along A–B")

    def _draw_level(self, axes: Axes) -> None:
        everything, storm = np.array(self._middle).T
        axes.axhline(0, color=MUTED, lw=0.6, alpha=0.6)
        if storm.any() and (everything != storm).any():
            axes.plot(self._times, everything - storm, color=AMBER, lw=1.4, label="long waves alone")
        axes.plot(self._times, everything, color=WATER, lw=1.3, label="all")
        axes.set(xlim=(0, self._times[-1]), xlabel="time, s", ylabel="η, m")
        set_title(axes, "η in the middle")
        if len(axes.lines) > 2:
            place = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.99), "ncols": 2, "borderpad": 0.2}
            axes.legend(frameon=False, labelcolor=MUTED, fontsize=9, **place)

    def _draw_spectrum(self, axes: Axes, still: bool) -> None:
        """Draw the mean spectrum over probes all over the area, and the one that the storm is drawn from."""
        scenario = self._sea.scenario
        axes.set(xlabel="frequency, Hz", ylabel="spectral density of η, m²/Hz")
        set_title(axes, "Spectrum, mean over the area")
        if still or len(self._times) < SHORTEST:
            words = "nothing moves" if still else f"too short: below {SHORTEST} records"
            axes.text(0.5, 0.5, words, color=MUTED, ha="center", transform=axes.transAxes)
            axes.set(xticks=[], yticks=[])
            return
        step = self._sea.interval
        storm = scenario.storm.spectrum != "none"
        piece = SEGMENT * scenario.storm.peak_period if storm else math.inf
        frequency, density = spectrum(np.array(self._probes), step, piece)
        axes.loglog(frequency, density, color=WATER, lw=1.6, label="simulated")
        highest, last = density.max(), frequency[-1]
        if storm:
            f, target = target_spectrum(scenario)
            axes.loglog(f, target, color=TARGET, lw=1.6, label=f"target, Hs {scenario.storm.significant_height:g} m")
            highest, last = max(highest, target.max()), min(last, 1.5 * f[-1])
        if scenario.sea.irregular_rms > 0:
            ends = 1 / scenario.sea.irregular_period_max, 1 / scenario.sea.irregular_period_min
            axes.axvspan(*ends, color=AMBER, alpha=0.15, lw=0, label="forced long waves")
        axes.set(xlim=(frequency[0], last), ylim=(1e-5 * highest, 2 * highest))
        low, high = axes.get_xlim()
        ticks = [step * 10.0**power for power in range(-6, 4) for step in (1, 2, 5)]
        axes.set_xticks([tick for tick in ticks if low <= tick <= high])
        axes.xaxis.set_major_formatter(FormatStrFormatter("%g"))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.grid(color=LINE, lw=0.6)
        axes.legend(frameon=False, labelcolor=MUTED, fontsize=9, loc="upper right")


def spectrum(records: np.ndarray, step: float, piece: float) -> tuple[np.ndarray, np.ndarray]:
    """One-sided spectral density of records (T, P) by Welch's method, mean over P and over overlapping segments.

    Args:
        records: taken every `step` s.
        piece: length of a segment, s; at most the whole record is taken.

    Returns:
        Frequencies (F,) above 0, Hz, and density (F,), 1/Hz times the records' unit squared.
    """
    count = min(len(records), max(SHORTEST, round(piece / step)))
    starts = np.arange(0, len(records) - count + 1, max(1, count // 2))
    window = np.hanning(count + 2)[1:-1, None]
    total = np.zeros(count // 2 + 1)
    for start in starts:
        part = records[start : start + count].astype(np.float64)
        total += (np.abs(np.fft.rfft((part - part.mean(axis=0)) * window, axis=0)) ** 2).mean(axis=1)
    density = 2 * step / (window**2).sum() * total / len(starts)
    if count % 2 == 0:
        density[-1] /= 2  # the Nyquist frequency has no mirror image
    return np.fft.rfftfreq(count, step)[1:], density[1:]


def target_spectrum(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (Hz) and spectral density (m²/Hz) of the spectrum that the storm is drawn from."""
    storm = scenario.storm
    omega, S = band(
        storm.spectrum, storm.peak_period, storm.gamma, storm.shortest_wave, scenario.area.depth, scenario.sea.gravity
    )
    f = omega / (2 * math.pi)
    return f, S * (storm.significant_height / 4) ** 2 / cumulative(f, S)[-1]
