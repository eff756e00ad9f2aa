"""Circular insets with errors magnified around true positions: the boat's fixes of AUVs, or the team's estimates of
targets with the directions in which the next measurement tells most of them.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.record.tracking_bound import bearing_information, range_information
from usvauv.env.record.tracking_metrics import letter, number, settled
from usvauv.env.render import shapes, style
from usvauv.env.render.layout import SMALLEST_LETTERS, Layout, Rectangle, fitting, nice, within_margins, write_heading
from usvauv.env.render.mission import Playback, Series, error_axes, step_of
from usvauv.env.render.style import Colour, text_width, write
from usvauv.env.render.views.sea_surface import MapView

SHOWN = 60  # of the latest errors


class ErrorInsets(ABC):
    """Insets in up to three rows, all at one scale: the latest errors, older ones fainter, as dots; the estimate as a
    diamond, beyond the inset as an arrow at its rim; its predicted ellipse.

    Args:
        still: picture that the insets are drawn on.
        play: the mission. card: box of all insets.
        view: of the map, whose scale is compared with theirs.
        title: of the card.
        errors: (T, N, 2) that are shown as dots, m. inks: of the N dots and rims.
        estimated: (T, N, 2) errors of the estimates, m. covariance: (T, N, 3) of the estimates, m².
        scaled: steps whose errors the scale fits.
    """

    def __init__(
        self,
        still: np.ndarray,
        play: Playback,
        card: Rectangle,
        layout: Layout,
        view: MapView,
        title: str,
        errors: np.ndarray,
        inks: list[Colour],
        estimated: np.ndarray,
        covariance: np.ndarray,
        scaled: slice = slice(None),
    ) -> None:
        self._play, self._layout, self._errors = play, layout, errors
        self._estimated, self._covariance = Series(estimated), Series(covariance)
        box = within_margins(card, layout.unit, top=30, sides=8, bottom=2)
        count = len(inks)
        label = 30 * layout.unit
        diameters = [min(box.height / rows - label, 0.94 * box.width / -(-count // rows)) for rows in (1, 2, 3)]
        self._radius = max(*diameters, 8.0) / 2
        rows = 1 + int(np.argmax(diameters))
        columns = -(-count // rows)
        self._across = across = box.width / columns
        down = box.height / rows
        above = min(max(down - 2 * self._radius - label, 0.0) / 2, 0.5 * down) + self._radius
        self._centres = [
            np.array([box.left + (k % columns + 0.5) * across, box.top + (k // columns) * down + above])
            for k in range(count)
        ]
        shades = [0.2 + 0.6 * (age + 1) / SHOWN for age in range(SHOWN)]
        self._tints = np.array([[style.mix(style.SEA[0], ink, shade) for shade in shades] for ink in inks])
        longest = np.linalg.norm(error_axes(covariance[scaled]), axis=-1).max(-1)
        off = np.nan_to_num(np.linalg.norm(errors[scaled], axis=-1))
        reach = max(float(np.quantile(off, 0.96)), float(np.quantile(longest, 0.95)))
        self._scale = self._radius / max(1.1 * reach, 1e-6)
        ring = nice(0.75 * self._radius / self._scale)
        scale = self._scale / view.per_metre
        magnified = f"{scale:.0f} × magnified, " if scale >= 1.5 else ""
        write_heading(still, layout, card, title, f"{magnified}inner ring {ring:g} m")
        unit, zoom = layout.unit, layout.zoom
        for centre, ink in zip(self._centres, inks, strict=True):
            with shapes.smooth(still, centre, self._radius + 2 * unit, zoom) as (fine, middle):
                shapes.disc(fine, middle, self._radius * zoom, style.SEA[0])
                shapes.ring(fine, middle, ring * self._scale * zoom, style.DARK.line, round(1.2 * unit * zoom))
                shapes.ring(fine, middle, self._radius * zoom, ink, round(1.8 * unit * zoom))
            shapes.plus(still, centre, 5 * unit, style.WHITE, layout.px(1))

    def draw(self, picture: np.ndarray, t: float) -> None:
        """Draw a moment."""
        layout, unit, step = self._layout, self._layout.unit, step_of(t)
        first, off, axes_of = max(0, step - SHOWN + 1), self._estimated.at(t), error_axes(self._covariance.at(t))
        for item, centre in enumerate(self._centres):
            offsets = self._errors[first : step + 1, item] * (self._scale, -self._scale)
            shown = self._inside(offsets)
            tints = self._tints[item, SHOWN - len(offsets) :][shown]
            shapes.dots(picture, centre + offsets[shown], 1.5 * unit, tints)
            outline = shapes.ellipse_points(np.zeros(2), axes_of[item] * (self._scale, -self._scale))
            distance = np.hypot(outline[:, :1], outline[:, 1:])
            outline *= np.minimum(1.0, self._radius / np.maximum(distance, 1e-9))  # parts outside are drawn on the rim
            shapes.stroke(picture, centre + outline, style.WHITE, layout.px(1.2), closed=True)
            shapes.plus(picture, centre, 5 * unit, style.WHITE, layout.px(1))
            estimate = off[item] * (self._scale, -self._scale)
            if self._inside(estimate):
                shapes.fix(picture, centre + estimate, 4.5 * unit, style.WHITE, 1.5 * unit, layout.zoom)
            else:
                heading = math.atan2(-estimate[1], estimate[0])
                rim = centre + (self._radius - 5 * unit) * np.array([math.cos(heading), -math.sin(heading)])
                shapes.arrow(picture, rim, heading, 14 * unit, style.WHITE, layout.zoom)
            self._write_caption(picture, step_of(self._play.told(t)), item)

    @abstractmethod
    def _named(self, step: int, item: int) -> tuple[str, float, Colour, str]:
        """Name of an inset, its error in a step, m, the caption's colour, and what a long caption begins with."""

    def _inside(self, offsets: np.ndarray) -> np.ndarray:
        """Whether points (..., 2), pixels from the centre, lie in an inset; false for NaN, a fix without detection."""
        return np.hypot(offsets[..., 0], offsets[..., 1]) < self._radius - 2 * self._layout.unit

    def _write_caption(self, picture: np.ndarray, step: int, item: int) -> None:
        unit, centre = self._layout.unit, self._centres[item]
        name, error, ink, kind = self._named(step, item)
        digits = sum(error < limit for limit in (9.995, 99.95))  # three in all, so that captions are of one size
        text, room = f"{name}: {error:.{digits}f} m", 0.93 * self._across
        texts = [f"{kind} {text} off"] * (self._radius >= 42 * unit) + [text, name]
        fits = [text for text in texts if text_width(text, SMALLEST_LETTERS, bold=True) <= room]
        text = (fits or texts[-1:])[0]
        size = fitting(text, 12.5 * unit, room, bold=True)
        below = centre[1] + self._radius + 16 * unit
        write(picture, text, (centre[0], below), size, ink, bold=True, anchor="centre")


class FixInsets(ErrorInsets):
    """Fixes and estimates of the AUVs."""

    def __init__(self, still: np.ndarray, play: Playback, card: Rectangle, layout: Layout, view: MapView) -> None:
        trace = play.trace
        truth = trace.auv_position[:, 0]
        super().__init__(
            *(still, play, card, layout, view, "Fixes around the true position"),
            errors=(trace.fix[:, 0] - trace.heard_position[:, 0]).astype(float),
            inks=[style.auv_colour(auv) for auv in range(truth.shape[1])],
            estimated=(trace.estimate[:, 0] - truth).astype(float),
            covariance=trace.estimate_covariance[:, 0].astype(float),
        )

    def _named(self, step: int, item: int) -> tuple[str, float, Colour, str]:
        return f"{item + 1}", float(self._play.position_error[step, item]), self._layout.theme.auv(item), "AUV"


DIRECTIONS = 72  # of the rim
BRIGHTEST = 0.4  # share of the variance that a measurement removes


def measured_share(trace: Trace, covariance: np.ndarray, away: np.ndarray, depth: float) -> np.ndarray:
    """Share of a target's variance of place that the measurements of one AUV in one step remove.

    It is 1 − tr (P⁻¹ + J)⁻¹/tr P, with J the information of a range and a bearing, as far as the AUVs measure them.

    Args:
        covariance: (3,) P of the estimate: xx, xy, yy, m². away: (N, 2) from the target to the AUV, m. depth: h, m.
    """
    P = covariance[[[0, 1], [1, 2]]] + 1e-9 * np.eye(2)
    J = np.zeros((len(away), 2, 2))
    if number(trace, "ranges") > 0:
        J += range_information(away, np.zeros(2), number(trace, "range_noise"), depth)
    if number(trace, "bearing_noise") > 0:
        J += bearing_information(away, np.zeros(2), number(trace, "bearing_noise"))
    after = np.linalg.inv(np.linalg.inv(P) + J)
    return 1 - np.trace(after, axis1=-2, axis2=-1) / np.trace(P)


class TargetInsets(ErrorInsets):
    """Estimates of the targets.

    The rim is brighter in directions from which a measurement tells more, at the distance of the nearest AUV. A mark
    on it is the direction of an AUV within range, or of a boat that listens.
    """

    def __init__(self, still: np.ndarray, play: Playback, card: Rectangle, layout: Layout, view: MapView) -> None:
        errors = play.tracked.values - play.node_way
        super().__init__(
            *(still, play, card, layout, view, "Estimates around the true targets"),
            errors=errors,
            inks=[style.TARGET] * errors.shape[1],
            estimated=errors,
            covariance=play.track_covariance.values,
            scaled=settled(play.trace),
        )
        self._reach = number(play.trace, "range_most")
        self._boats = play.trace.scenario.task_numbers.get("boat_listens", 0.0) > 0
        turns = np.linspace(0.0, 2 * math.pi, DIRECTIONS, endpoint=False)
        self._around = np.stack([np.cos(turns), np.sin(turns)], axis=1)

    def draw(self, picture: np.ndarray, t: float) -> None:
        for item, centre in enumerate(self._centres):
            self._draw_rim(picture, t, item, centre)
        super().draw(picture, t)

    def _named(self, step: int, item: int) -> tuple[str, float, Colour, str]:
        error = float(np.hypot(*self._errors[step, item]))
        return letter(item), error, self._layout.theme.text, "target"

    def _draw_rim(self, picture: np.ndarray, t: float, item: int, centre: np.ndarray) -> None:
        play, unit = self._play, self._layout.unit
        away = play.auvs.at(t) - play.nodes.at(t)[item]
        apart = np.maximum(np.hypot(*away.T), 1.0)
        nearest = int(apart.argmin())
        depth = play.target_depth - float(play.depths.at(t)[nearest])
        share = measured_share(play.trace, self._covariance.at(t)[item], apart[nearest] * self._around, depth)
        ends = centre + self._radius * (self._around * (1, -1))
        for place, gain in enumerate(share.tolist()):
            ink = style.mix(style.SEA[0], style.TARGET, 0.15 + 0.85 * min(gain / BRIGHTEST, 1.0))
            shapes.stroke(picture, ends[[place - 1, place]], ink, self._layout.px(5))
        marks = [(way, style.auv_colour(auv)) for auv, way in enumerate(away)]
        marks += [(way, style.BOAT) for way in play.boats.at(t) - play.nodes.at(t)[item] if self._boats]
        for way, ink in marks:
            distance = max(float(np.hypot(*way)), 1.0)
            if distance < self._reach:
                x, y = way / distance
                at = centre + self._radius * np.array([x, -y])
                shapes.arrow(picture, at, math.atan2(-y, -x), 12 * unit, ink, self._layout.zoom)
