"""Layout of a frame: positions of its parts in a frame of any shape; the unit of its text; title, tiles, cards."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from usvauv.env.render import style
from usvauv.env.render.style import Theme, clock, shorten, text_width, write
from usvauv.env.scenario.environment import Area


class Rectangle(NamedTuple):
    """Pixels; y runs down."""

    left: int
    top: int
    width: int
    height: int

    @property
    def right(self) -> int:
        return self.left + self.width

    @property
    def bottom(self) -> int:
        return self.top + self.height

    def of(self, image: np.ndarray) -> np.ndarray:
        """The view of an image inside the rectangle."""
        return image[self.top : self.bottom, self.left : self.right]


SMALLEST_LETTERS = 8.8  # size in pixels below which letters are not legible
LEAST_UNIT = SMALLEST_LETTERS / 11  # the design's smallest letters are of 11 pixels
AXES = (46.0, 14.0, 36.0, 34.0)  # at the left, at the right, above and below a map, pixels of the design
MARGIN, GAP = 10.0, 7.0
LEAST_COLUMN = 280.0  # width of a column with a map
LEAST_PANEL = 250.0  # width of a panel beside a map that has the title and the figures above it
LEAST_PLOT_WIDTH = 200.0
HIGHEST_BOX = 0.95  # height over width from which on a perspective shows the water no larger
TABLE = 220.0, 260.0  # least width and height of the figures of two missions
NAME, LEAST_PLOT = 18.0, 84.0  # heights of the line above a map of two, and of their plots
LEAST = {"title": 56.0, "errors": 90.0, "fixes": 110.0, "reward": 44.0, "section": 80.0}  # heights of cards
SHARES = {"fixes": 0.42, "errors": 0.33, "section": 0.25}  # of the height that is left
PLOTS = "yield", "errors"  # of two missions
IMPORTANCE = ("title", "tiles", "errors", "fixes", "legend", "reward", "section")
BELOW = ("tiles", "reward", "fixes", "errors", "section", "legend")  # of the title, from the top to the bottom


@dataclass(frozen=True)
class Layout:
    """Rectangles of a frame designed for 1280 × 720, or upright for 720 × 1280, and scaled to other sizes.

    Attributes:
        width, height: of the frame, pixels.
        unit: pixels to one pixel of the design, for text and margins. It has a lower bound, so that text in small
            frames is legible.
        boxes: by name; "map" is the operating area.
        theme: colours around the map.
        left: of the part of the frame that the map and its scales keep to, pixels.
    """

    width: int
    height: int
    unit: float
    boxes: Mapping[str, Rectangle]
    theme: Theme = style.DARK
    left: int = 0

    @property
    def map(self) -> Rectangle:
        return self.boxes["map"]

    @property
    def zoom(self) -> int:
        """Factor by which shapes are drawn magnified before they are averaged."""
        return 4 if self.unit < 1.5 else 2

    def px(self, size: float) -> int:
        """A line width or gap of the design in whole pixels, at least 1."""
        return max(1, round(size * self.unit))


def design_unit(width: int, height: int) -> float:
    """Pixels of a frame to one pixel of the design; bounded from below, so that text in small frames is legible."""
    long, short = max(width, height), min(width, height)
    return max(min(long / 1280, short / 720), LEAST_UNIT)


def fitting_scale(width: float, height: float, area: Area) -> float:
    """Pixels a metre with which an area fits into a width and height; its longer side has at least 8 pixels."""
    return max(min(width / area.width, height / area.length), 8.0 / max(area.width, area.length))


def tile_columns(names: Sequence[str], width: float, unit: float) -> int:
    """Figures in a row of tiles of a width in pixels, so that names are legible, and rows are about equally long."""
    widest = max(text_width(name, 11 * unit) for name in names) + 14 * unit
    most = min(max(int(width / widest), 1), len(names))
    return -(-len(names) // -(-len(names) // most))


class Room(NamedTuple):
    """A rectangle; y runs down."""

    left: float
    top: float
    width: float
    height: float

    @property
    def right(self) -> float:
        return self.left + self.width

    @property
    def bottom(self) -> float:
        return self.top + self.height

    def pixels(self, unit: float) -> Rectangle:
        """This rectangle in pixels of a frame with `unit` of them to one of the design."""
        left, top = round(self.left * unit), round(self.top * unit)
        return Rectangle(left, top, round(self.right * unit) - left, round(self.bottom * unit) - top)

    def over(self, height: float) -> tuple[Room, Room]:
        """The upper part, of a height, and the part below it."""
        upper = self._replace(height=height)
        return upper, self._replace(top=upper.bottom + GAP, height=self.height - height - GAP)

    def beside(self, width: float) -> tuple[Room, Room]:
        """The left part, of a width, and the part to the right of it."""
        left = self._replace(width=width)
        return left, self._replace(left=left.right + GAP, width=self.width - width - GAP)


Rooms = dict[str, Room]


class Arrangement:
    """Divides a frame of a width and height in pixels; `area` is that of the map, `names` are those in tiles.

    Attributes:
        frame: within its margins. unit: pixels of the frame to one of the design.
    """

    def __init__(self, size: tuple[int, int], area: Area, names: Sequence[str]) -> None:
        self.area, self.names, self.unit = area, names, design_unit(*size)
        self.frame = Room(MARGIN, MARGIN, *(side / self.unit - 2 * MARGIN for side in size))

    def boxes(self, view: str, dives: bool) -> dict[str, Rectangle]:
        """The boxes of a view in pixels of the frame, by name; around a map those that make it about the largest.

        Where AUVs have `dives`, their depths stand beside the section.
        """
        if view == "map":
            beside, column, above = self._beside(), self._in_column(), self._above()
            if column["map"].width > 0.9 * beside["map"].width and column["map"].bottom < self.frame.bottom:
                beside = column
            rooms = max(beside, above, key=lambda rooms: rooms["map"].width)
        else:
            rooms = self._both() if view == "both" else self._sea()
        if dives and "section" in rooms and (half := (rooms["section"].width - GAP) / 2) >= LEAST_PLOT_WIDTH:
            rooms["section"], rooms["depth"] = rooms["section"].beside(half)
        return {name: room.pixels(self.unit) for name, room in rooms.items()}

    def least(self, name: str, width: float) -> float:
        """Height that a card of a width needs; infinite where it would not be legible."""
        if name == "tiles":
            return 8.0 + 46.0 * math.ceil(len(self.names) / tile_columns(self.names, width * self.unit, self.unit))
        if name == "legend":
            return 146.0 if width >= 520.0 else 262.0 if width >= 280.0 else math.inf
        if name in ("reward", "errors", "section") and width < LEAST_PLOT_WIDTH:
            return math.inf
        return LEAST[name]

    def cards(self, room: Room, wanted: Sequence[str]) -> Rooms:
        """The most important ones of the wanted cards, as many as there is room for, from the top to the bottom."""
        need, left = {name: self.least(name, room.width) for name in wanted}, room.height + GAP + 1e-6
        kept: set[str] = set()
        for name in sorted(wanted, key=IMPORTANCE.index):
            if need[name] + GAP <= left:
                left -= need[name] + GAP
                kept.add(name)
        shared, rooms, rest = sum(SHARES[name] for name in kept & SHARES.keys()), {}, room
        for name in (name for name in wanted if name in kept):
            more = left * SHARES[name] / shared if name in SHARES else 0.0
            rooms[name], rest = rest.over(need[name] + more)
        return rooms

    def map_in(self, room: Room) -> Room:
        """The largest map, true to scale, that has room with its axes, in the middle of a room."""
        left, right, top, bottom = AXES
        width, height = room.width - left - right, room.height - top - bottom
        scale = fitting_scale(width, height, self.area)
        across, up = max(scale * self.area.width, 10.0), max(scale * self.area.length, 10.0)
        return Room(
            room.left + left + max(width - across, 0.0) / 2, room.top + top + max(height - up, 0.0) / 2, across, up
        )

    def map_with_axes(self, width: float, height: float) -> tuple[float, float]:
        """Width and height of the largest map with its axes."""
        found = self.map_in(Room(0.0, 0.0, width, height))
        return found.width + AXES[0] + AXES[1], found.height + AXES[2] + AXES[3]

    def _beside(self) -> Rooms:
        """The map at the left, everything else at the right, or the legend below the map if there is room."""
        frame = self.frame._replace(left=0.0, width=self.frame.right)
        widest = 0.5625 * (frame.width + MARGIN)
        column, panel = frame.beside(min(max(self.map_with_axes(widest, frame.height)[0], LEAST_COLUMN), widest))
        legend = self.least("legend", column.width - MARGIN)
        if self.map_with_axes(widest, frame.height)[1] + GAP + legend <= frame.height:
            place, below = column.over(frame.height - legend - GAP)
            below = below._replace(left=MARGIN, width=below.width - MARGIN)
            return {**self.cards(panel, ("title", *BELOW[:-1])), "legend": below, "map": self.map_in(place)}
        return {**self.cards(panel, ("title", *BELOW)), "map": self.map_in(column)}

    def _in_column(self) -> Rooms:
        """Title, figures, map and what else there is room for at the left, a narrow panel at the right."""
        width = self.frame.width - GAP - LEAST_PANEL
        for _ in range(2):  # the narrower the column, the more rows of figures
            tiles = self.least("tiles", width)
            room = self.frame.height - LEAST["title"] - tiles - 2 * GAP
            found = [self.map_with_axes(width, room - below) for below in (146.0 + GAP, 0.0)]
            across, up = found[0] if found[0][0] >= 520.0 else found[1]
            width = min(max(across, LEAST_COLUMN), width)
        column, panel = self.frame.beside(width)
        title, rest = column.over(LEAST["title"])
        figures, rest = rest.over(tiles)
        place, rest = rest.over(up)
        rooms = {"title": title, "tiles": figures, "map": self.map_in(place), **self.cards(rest, ("errors", "legend"))}
        return rooms | self.cards(panel, [name for name in BELOW if name not in rooms])

    def _above(self) -> Rooms:
        """Title, map, and everything else below it."""
        title, rest = self.frame.over(LEAST["title"])
        wanted = ("tiles", "errors", "fixes", "legend") if rest.width >= 520.0 else ("tiles", "errors", "fixes")
        below = sum(self.least(name, rest.width) + GAP for name in wanted if self.least(name, rest.width) < math.inf)
        place, panel = rest.over(self.map_with_axes(rest.width, rest.height - below)[1])
        return {"title": title, "map": self.map_in(place), **self.cards(panel, BELOW)}

    def _both(self) -> Rooms:
        """The perspective in the right half of the frame, in the lower half of a square or upright one."""
        if self.frame.height > 0.85 * self.frame.width:
            title, rest = self.frame.over(LEAST["title"])
            narrowest = self.frame.width / (5.0 if self.frame.height > self.frame.width else 2.5)
            across, up = self.map_with_axes(rest.width - narrowest - GAP, 0.52 * self.frame.height - title.height - GAP)
            upper, perspective = rest.over(up)
            place, side = upper.beside(across)
            cards = self.cards(side, ("tiles", "errors"))
            cards = cards if "errors" in cards else {"tiles": side}
            return {"title": title, "map": self.map_in(place), "perspective": perspective, **cards}
        width = 0.5 * self.frame.width - GAP
        low = self.frame.height < 600.0
        for _ in range(2):  # the narrower the column, the more rows of figures
            head = LEAST["title"] + GAP + (54.0 if low else self.least("tiles", width)) + GAP
            below = 0.0 if low else LEAST["errors"] + GAP
            across, up = self.map_with_axes(width, self.frame.height - head - below)
            width = min(max(across, 1.3 * LEAST_COLUMN), width)
        column, perspective = self.frame.beside(width)
        title, rest = column.over(LEAST["title"])
        tiles, rest = rest.over(head - title.height - 2 * GAP)
        place, rest = rest.over(up)
        rooms = {"title": title, "tiles": tiles, "map": self.map_in(place), "perspective": perspective}
        return {**rooms, **self.cards(rest, ("errors", "legend"))}

    def _sea(self) -> Rooms:
        """The perspective between title and figures; in an upright frame also the errors and the legend."""
        title, rest = self.frame.over(LEAST["title"])
        room = rest.height - self.least("tiles", rest.width) - GAP
        perspective, below = rest.over(min(room, HIGHEST_BOX * rest.width))
        return {"title": title, "perspective": perspective, **self.cards(below, ("tiles", "errors", "legend"))}

    def compared(self) -> dict[str, Rectangle]:
        """The boxes of two missions beside each other: "first" and "second" of the maps, the largest there are."""
        title, rest = self.frame.over(LEAST["title"])
        plots = max(LEAST_PLOT, 0.18 * self.frame.height)
        with_plots, alone = self._in_a_row(rest, plots), self._in_a_row(rest, 0.0)
        if with_plots["first"].height < 0.7 * alone["first"].height:
            with_plots = alone
        across = self._over_all(rest)
        legible = all(across[plot].height >= LEAST_PLOT and across[plot].width >= LEAST_PLOT_WIDTH for plot in PLOTS)
        rooms = across if legible and across["first"].height > with_plots["first"].height else with_plots
        return {name: room.pixels(self.unit) for name, room in {"title": title, **rooms}.items()}

    def _named_map(self, room: Room) -> Room:
        """A map with a line above it for its name."""
        return self.map_in(room._replace(top=room.top + NAME, height=room.height - NAME))

    def _in_a_row(self, room: Room, plots: float) -> Rooms:
        """Two maps and the figures, the plots below them, of that height or none."""
        width = (room.width - TABLE[0] - 2 * GAP) / 2
        across, up = self.map_with_axes(width, room.height - NAME - (plots + GAP if plots else 0.0))
        row, below = room.over(NAME + up) if plots else (room, room)
        first, others = row.beside(across)
        second, table = others.beside(across)
        rooms = {"first": self._named_map(first), "second": self._named_map(second), "table": table}
        if plots:
            rooms["yield"], rooms["errors"] = below.beside((below.width - GAP) / 2)
        return rooms

    def _over_all(self, room: Room) -> Rooms:
        """Two maps across the frame, below them figures and plots."""
        width = (room.width - GAP) / 2
        _, up = self.map_with_axes(width, room.height - NAME - TABLE[1] - GAP)
        row, below = room.over(NAME + up)
        first, second = row.beside(width)
        table, plots = below.beside(TABLE[0])
        half = (plots.width - GAP) / 2
        each = plots.beside(half) if half >= LEAST_PLOT_WIDTH else plots.over((plots.height - GAP) / 2)
        maps = {"first": self._named_map(first), "second": self._named_map(second)}
        return {**maps, "table": table, "yield": each[0], "errors": each[1]}


def nice(value: float) -> float:
    """The largest of 1, 2, 5 × a power of ten that is not above a positive value."""
    power = 10.0 ** math.floor(math.log10(value) + 1e-9)
    return next(step * power for step in (5, 2, 1) if step * power <= value * (1 + 1e-9))


def nice_above(value: float, steps: tuple[float, ...] = (1, 2, 5, 10)) -> float:
    """The smallest of the steps × a power of ten that is not below a positive value."""
    power = 10.0 ** math.floor(math.log10(value) + 1e-9)
    return next(step * power for step in steps if step * power >= value * (1 - 1e-9))


class Head:
    """Title with clock, and tiles with figures.

    Args:
        still: picture that frames are copied from.
        title, tiles: their boxes; no tiles for None.
        words: first line of the title, and what its second line begins with; both are shortened to what there is room
            for beside the clock and the play speed.
        names: of the figures.
        end: duration, s. speed_up: play speed, s of mission in a second.
        slow: whether the storm's waves go at their true speed instead.
    """

    def __init__(
        self,
        still: np.ndarray,
        title: Rectangle,
        tiles: Rectangle | None,
        layout: Layout,
        words: tuple[str, str],
        names: list[str],
        end: float,
        speed_up: float,
        slow: bool,
    ) -> None:
        self.title, self._layout = title, layout
        unit, theme, edge = layout.unit, layout.theme, 2 * layout.unit
        room = title.width - text_width(clock(end), 24 * unit, bold=True) - 14 * unit
        size = max(fitting(words[0], 21 * unit, room, bold=True), 13 * unit)
        name = shorten(words[0], size, room, bold=True)
        write(still, name, (title.left + edge, title.top + 24 * unit), size, theme.text, bold=True)
        line, size = title.top + 44 * unit, 12 * unit
        room = title.width - 14 * unit
        paces = [f"of {clock(end)} · {speed_up:g} × speed", f"{speed_up:g} × speed", f"{speed_up:g} ×"]
        paces = [f"{paces[0]}, waves 1 ×"] * slow + paces
        fits = [pace for pace in paces if text_width(words[1], size) + text_width(pace, size) <= room]
        pace = (fits or paces[-1:])[0]
        run = shorten(words[1], size, room - text_width(pace, size))
        write(still, run, (title.left + edge, line), size, theme.muted)
        write(still, pace, (title.right - edge, line), size, theme.muted, anchor="right")
        self._places: list[tuple[float, float]] = []
        if tiles:
            self._draw_tiles(still, tiles, names)

    def _draw_tiles(self, still: np.ndarray, tiles: Rectangle, names: list[str]) -> None:
        unit = self._layout.unit
        draw_card(still, tiles, self._layout)
        columns, height = tile_columns(names, tiles.width, unit), tiles.height - 8 * unit
        rows = min(-(-len(names) // columns), max(1, int(height / (45 * unit))))
        across, down = tiles.width / columns, height / rows
        self._room = across - 14 * unit
        for place, name in enumerate(names[: rows * columns]):
            left = tiles.left + place % columns * across + 10 * unit
            top = tiles.top + 4 * unit + place // columns * down + (down - 46 * unit) / 2
            write(still, name, (left, top + 13 * unit), 11 * unit, self._layout.theme.muted)
            self._places.append((left, top + 37 * unit))

    def draw(self, picture: np.ndarray, time: float, share: float, values: list[str]) -> None:
        """Draw the time in s, a progress bar filled to `share`, and the values of the figures."""
        unit, theme, title = self._layout.unit, self._layout.theme, self.title
        corner = title.right - 2 * unit, title.top + 24 * unit
        write(picture, clock(time), corner, 24 * unit, theme.text, bold=True, anchor="right")
        top, done = round(title.bottom - 2 * unit), round(title.width * share)
        bar = picture[top : top + self._layout.px(3), title.left : title.right]
        bar[:], bar[:, :done] = theme.line, theme.muted
        for place, value in zip(self._places, values, strict=False):
            size = fitting(value, 20 * unit, self._room, bold=True)
            write(picture, value, place, size, theme.text, bold=True)


def fitting(text: str, size: float, room: float, bold: bool = False) -> float:
    """Font size, reduced down to legible ones where needed so that the text is no wider than `room` pixels."""
    while (width := text_width(text, size, bold)) > room and size > SMALLEST_LETTERS:
        size = max(size * min(room / width, 0.99), SMALLEST_LETTERS)
    return size


def write_heading(picture: np.ndarray, layout: Layout, box: Rectangle, text: str, note: str = "") -> None:
    """Title of a card, and a note at the right if there is room for both."""
    unit, theme = layout.unit, layout.theme
    line = box.top + 18 * unit
    room = box.width - 20 * unit
    text = shorten(text, 12 * unit, room, bold=True)
    write(picture, text, (box.left + 10 * unit, line), 12 * unit, theme.text, bold=True)
    if text_width(text, 12 * unit, bold=True) + 12 * unit + text_width(note, 11 * unit) < room:
        write(picture, note, (box.right - 10 * unit, line), 11 * unit, theme.muted, anchor="right")


def draw_card(picture: np.ndarray, box: Rectangle, layout: Layout) -> None:
    """A rounded background."""
    colour, radius = layout.theme.card, max(1, round(5 * layout.unit))
    left, top, right, bottom = box.left, box.top, box.right - 1, box.bottom - 1
    cv2.rectangle(picture, (left + radius, top), (right - radius, bottom), colour, -1)
    cv2.rectangle(picture, (left, top + radius), (right, bottom - radius), colour, -1)
    for x in (left + radius, right - radius):
        for y in (top + radius, bottom - radius):
            cv2.circle(picture, (x, y), radius, colour, -1, cv2.LINE_AA)


def within_margins(
    box: Rectangle, unit: float, top: float, sides: float, bottom: float, left: float | None = None
) -> Rectangle:
    """The box without its margins, which are in pixels of the design."""
    a, b, c = round((sides if left is None else left) * unit), round(sides * unit), round(top * unit)
    return Rectangle(
        box.left + a, box.top + c, max(box.width - a - b, 8), max(box.height - c - round(bottom * unit), 8)
    )
