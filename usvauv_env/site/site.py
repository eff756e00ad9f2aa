"""The place of a scenario: its bed, real current, waves and speed of sound, from the scenario's files and tables."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from usvauv.env.scenario.environment import Area
from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.site.cf import iso, parse_time
from usvauv.env.site.ocean import Flow, bilinear, read_bathymetry, read_flow
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.sound_speed import SoundSpeedError, SoundSpeedProfile
from usvauv.env.site.waves import Waves, read_waves
from usvauv.env.storage.netcdf import OceanError
from usvauv.kernels.flow.vortex import Eddies
from usvauv.kernels.types import Level

BED_WAVES = 256  # of a random bed
COLUMN = 1000  # depths over which a current has its mean
BED_CELLS = 256  # along the longer side of the area, of the bed that nodes lie on


def random_bed(area: Area, cells: tuple[int, int]) -> np.ndarray:
    """Depth of a random bed at the centres of cells (nx, ny), (ny, nx) float64, m, row 0 in the south.

    h(x, y) = h0 + σ √(2/N) Σ cos(k_n · (x, y) + φ_n), N = `BED_WAVES`, with phases uniform and the components of k_n
    normal of standard deviation 1/l: a stationary field of rms σ = `area.bed_rms` and, over all seeds, of covariance
    σ² e^{−r²/(2 l²)}, normal for large N (spectral method: Shinozuka and Deodatis 1991, doi 10.1115/1.3119501).
    """
    draw = np.random.default_rng(area.bed_seed)
    kx, ky = draw.normal(size=(2, BED_WAVES)) / area.bed_length
    phase = draw.uniform(0, 2 * np.pi, BED_WAVES)
    x, y = area.middles(*cells)
    along_x, along_y = np.outer(x, kx), np.outer(y, ky) + phase  # cos(a + b) = cos a cos b − sin a sin b
    waves = np.cos(along_y) @ np.cos(along_x).T - np.sin(along_y) @ np.sin(along_x).T
    return area.depth + area.bed_rms * math.sqrt(2 / BED_WAVES) * waves


@dataclass(frozen=True)
class Site:
    """The place of a scenario. Each file is read when it is first needed, and kept as long as the site.

    Raises:
        OceanError: a file does not serve; on first use of what is read from it.
    """

    scenario: Scenario
    _depths: dict[tuple[int, int], np.ndarray] = field(default_factory=dict, init=False, repr=False, compare=False)

    @classmethod
    def recorded(cls, scenario: Scenario) -> Site:
        """The place of a recorded run, whose bed is flat at `area.depth` where its file is not here any more."""
        site = cls(scenario)
        try:
            _ = site.bed
        except OceanError:
            water = scenario.water.model_copy(update={"bathymetry": ""})
            site = cls(scenario.model_copy(update={"water": water}))
        return site

    def under(self, scenario: Scenario) -> Site:
        """This place, with what has been read of it, under a scenario with other parameters of worlds that run."""
        site = copy.copy(self)
        object.__setattr__(site, "scenario", scenario)
        return site

    def still_depth(self, cells: tuple[int, int]) -> np.ndarray:
        """Depth of still water at the centres of cells (nx, ny), (ny, nx) float64, m, row 0 in the south.

        On land it is at most 0: minus the height, where that is known.
        """
        area, water = self.scenario.area, self.scenario.water
        if self.flat:
            return np.broadcast_to(np.float64(area.depth), cells[::-1])
        if cells not in self._depths:
            if water.bathymetry:
                depth = read_bathymetry(water.bathymetry, self._frame, area.width, area.length, cells)
            else:
                depth = random_bed(area, cells)
            self._depths[cells] = depth
        return self._depths[cells]

    @property
    def flat(self) -> bool:
        """Whether the bed has the same depth everywhere."""
        return not self.scenario.water.bathymetry and self.scenario.area.bed_rms == 0

    @cached_property
    def mean_depth(self) -> float:
        """Mean depth of the water, land left out, m."""
        depth = self.still_depth(self.scenario.area.cells(BED_CELLS))
        return float(depth[depth > 0].mean())

    @cached_property
    def bed(self) -> np.ndarray:
        """Depth of still water as a field of `usvauv.kernels.flow.current`, (1, rows, columns, 1), m.

        Raises:
            ScenarioError: the bed rises to the AUVs.
        """
        area, water, auv = self.scenario.area, self.scenario.water, self.scenario.auv
        if self.flat:
            return np.full((1, 2, 2, 1), area.depth)
        depth = self.still_depth(area.cells(BED_CELLS))
        for axis in (0, 1):  # from cell centres to the corners around them
            rows = np.moveaxis(depth, axis, 0)
            inner = (rows[1:] + rows[:-1]) / 2
            ends = 1.5 * rows[[0, -1]] - 0.5 * rows[[1, -2]]
            depth = np.moveaxis(np.concatenate([ends[:1], inner, ends[1:]]), 0, axis)
        if depth.min() <= auv.depth:
            i, j = np.unravel_index(depth.argmin(), depth.shape)
            x, y = j * area.width / (depth.shape[1] - 1), i * area.length / (depth.shape[0] - 1)
            bed = water.bathymetry or f"area.bed_rms = {area.bed_rms:g}"
            raise ScenarioError(
                f"auv.depth = {auv.depth:g}: must be above the bed everywhere, and {bed} "
                f"has {depth.min():.1f} m at x = {x:.0f} m, y = {y:.0f} m"
            )
        return depth[None, :, :, None]

    def depth_at(self, places: np.ndarray) -> np.ndarray:
        """Depth of the bed at positions (..., 2), m: bilinear in `bed`."""
        bed, area = self.bed[0, :, :, 0], self.scenario.area
        rows, columns = (np.arange(n) for n in bed.shape)
        x = np.clip(places[..., 0] / area.width, 0, 1) * columns[-1]
        y = np.clip(places[..., 1] / area.length, 0, 1) * rows[-1]
        return bilinear(bed, columns, rows, x, y)

    @cached_property
    def current(self) -> Flow | None:
        """The uniform current and that of the file at the depths of `usvauv.kernels.types.Level` during a mission.

        None without either.
        """
        area, water, mission = self.scenario.area, self.scenario.water, self.scenario.mission
        depths = {Level.surface: 0.0, Level.cruise: self.scenario.auv.depth}
        levels = [depths[level] for level in sorted(depths)]
        if water.currents:
            duration = mission.steps * mission.step
            flow = read_flow(water.currents, self._frame, area.width, area.length, levels, water.start, duration)
        elif self.scenario.current.speed:
            start = iso(parse_time(water.start)) if water.start else ""
            still = np.zeros((1, len(levels), 2, 2, 2), np.float32)
            flow = Flow(area.width, area.length, tuple(levels), np.zeros(1), still, start)
        else:
            return None
        uniform = self.scenario.current.uniform(levels, self.mean_depth)[:, None, None]
        return replace(flow, velocity=(flow.velocity + uniform).astype(np.float32))

    @cached_property
    def eddies(self) -> Eddies:
        """How vortices fill the water: the period of their pattern, and their speed at depth.

        A column of water cannot shear and keep its eddies' profile φ(z) = e^{z/D}: vorticity φ ζ_0 carried by φ V_0 is,
        over the depth h, that of a column that moves with V_0 ∫φ² dz/∫φ dz = V_0 (1 + e^{−h/D})/2, the mean of the
        velocity over its vorticity, as in equivalent-barotropic flow (Charney 1949, J. Meteorology 6, 371–385). The
        uniform current carries it with the same mean of its own velocity.
        """
        area, current = self.scenario.area, self.scenario.current
        column, vorticity = 1.0, np.ones(COLUMN)
        depths = (np.arange(COLUMN) + 0.5) / COLUMN * self.mean_depth
        if current.decay_depth:
            column = 0.5 + 0.5 * math.exp(-self.mean_depth / current.decay_depth)
            vorticity = np.exp(-depths / current.decay_depth)
        centre = (area.width / 2, area.length / 2) if current.period else (0.0, 0.0)
        x, y = np.average(current.uniform(depths, self.mean_depth), axis=0, weights=vorticity)
        return Eddies(current.period, centre, self.scenario.eddies_at_cruise, column, (float(x), float(y)))

    @cached_property
    def waves(self) -> Waves | None:
        """The waves of the scenario's file at the start of a mission, or None without one."""
        area, water = self.scenario.area, self.scenario.water
        if not water.waves:
            return None
        start = self.current.start if self.current is not None else water.start
        return read_waves(water.waves, self._frame, area.width, area.length, start)

    @cached_property
    def sound_speed(self) -> SoundSpeedProfile | None:
        """Speed of sound against depth, or None where it is a constant.

        Raises:
            ScenarioError: the scenario has two profiles, or one that cannot be used.
        """
        acoustic, water = self.scenario.acoustics, self.scenario.water
        speeds, waters = acoustic.sound_speed_profile, acoustic.temperature_salinity
        if speeds and waters:
            raise ScenarioError("acoustics.sound_speed_profile and acoustics.temperature_salinity: give one of them")
        if not speeds and not waters:
            return None
        about = {"latitude": water.latitude, "longitude": water.longitude}
        try:
            if speeds:
                profile = SoundSpeedProfile.from_table(speeds)
            else:
                profile = SoundSpeedProfile.from_water(waters, **about, salinity=acoustic.salinity)
            profile.check_reaches(self.scenario.auv.depth)
        except SoundSpeedError as error:
            field = "sound_speed_profile" if speeds else "temperature_salinity"
            raise ScenarioError(f"acoustics.{field}: {error}") from None
        return profile

    @cached_property
    def start(self) -> str:
        """Date and time at which a mission begins, ISO 8601, UTC; "" where neither scenario nor files say it."""
        if self.current is not None and self.current.start:
            return self.current.start
        if self.scenario.water.start:
            return iso(parse_time(self.scenario.water.start))
        return self.waves.start if self.waves is not None else ""

    @property
    def frame(self) -> LocalFrame | None:
        """The area's plane on the Earth; None where the scenario names no place: no file, and the default corner."""
        water = self.scenario.water
        named = water.bathymetry or water.currents or water.waves or water.longitude or water.latitude
        return self._frame if named else None

    @property
    def _frame(self) -> LocalFrame:
        return LocalFrame(self.scenario.water.longitude, self.scenario.water.latitude)
