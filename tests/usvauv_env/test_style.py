"""Colours of categories, told apart with any colour vision and from their ground; text in pictures."""

import itertools

import numpy as np
import pytest
from matplotlib.markers import MarkerStyle

from usvauv.env.render import style
from usvauv.env.render.style import CATEGORICAL, CATEGORICAL_ON_WHITE, MARKERS, web, write

# Machado, Oliveira & Fernandes (2009), severity 1, applied to linear RGB.
VISIONS = {
    "normal": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
DIFFER, FROM_SEA = 16.0, 12.0  # CIEDE2000; 1 is just noticeable side by side
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
GROUNDS = {"#0b131c": CATEGORICAL, "#142130": CATEGORICAL, "#ffffff": CATEGORICAL_ON_WHITE}


def linear(code):
    """Linear RGB of a web colour, 0 to 1 (IEC 61966-2-1)."""
    value = np.array([int(code[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def lab(rgb):
    """CIELAB of linear RGB, white D65."""
    ratio = XYZ @ np.clip(rgb, 0, 1) / XYZ.sum(1)
    x, y, z = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def difference(first, second):
    """CIEDE2000 of two colours in CIELAB, as in Sharma, Wu & Dalal (2005), doi 10.1002/col.20070."""
    (l1, a1, b1), (l2, a2, b2) = first, second
    chroma = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2
    more = 1 + 0.5 * (1 - np.sqrt(chroma**7 / (chroma**7 + 25**7)))
    (c1, h1), (c2, h2) = (
        (np.hypot(more * a, b), np.degrees(np.arctan2(b, more * a)) % 360) for a, b in (first[1:], second[1:])
    )
    turn = (h2 - h1 + 180) % 360 - 180 if c1 * c2 else 0
    hue = (h1 + h2 + (360 if abs(h1 - h2) > 180 else 0)) / 2 if c1 * c2 else h1 + h2
    light, chroma = (l1 + l2) / 2, (c1 + c2) / 2

    def cosine(degrees):
        return np.cos(np.radians(degrees))

    t = 1 - 0.17 * cosine(hue - 30) + 0.24 * cosine(2 * hue) + 0.32 * cosine(3 * hue + 6) - 0.2 * cosine(4 * hue - 63)
    dl = (l2 - l1) / (1 + 0.015 * (light - 50) ** 2 / np.sqrt(20 + (light - 50) ** 2))
    dc = (c2 - c1) / (1 + 0.045 * chroma)
    dh = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn / 2)) / (1 + 0.015 * chroma * t)
    rotation = np.sin(np.radians(60 * np.exp(-(((hue % 360 - 275) / 25) ** 2))))
    rotation *= -2 * np.sqrt(chroma**7 / (chroma**7 + 25**7))
    return np.sqrt(dl**2 + dc**2 + dh**2 + rotation * dc * dh)


def contrast(code, ground):
    """Contrast of WCAG 2.2, 1 to 21."""
    low, high = sorted(float(XYZ[1] @ linear(each)) + 0.05 for each in (code, ground))
    return high / low


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425),
        ((50, 2.5, 0), (50, 0, -2.5), 4.3065),
        ((50, 2.5, 0), (73, 25, -18), 27.1492),
        ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
    ],
)
def test_the_colour_difference_is_that_of_the_published_data(first, second, expected):
    assert difference(first, second) == pytest.approx(expected, abs=5e-5)


@pytest.mark.parametrize("colours", [CATEGORICAL, CATEGORICAL_ON_WHITE], ids=["dark", "light"])
@pytest.mark.parametrize("vision", VISIONS)
def test_colours_are_told_apart_with_any_colour_vision(vision, colours):
    matrix = np.asarray(VISIONS[vision])
    assert matrix.sum(1) == pytest.approx(1, abs=1e-5)  # greys stay grey
    seen = [lab(matrix @ linear(code)) for code in colours]
    pairs = {(i, j): difference(seen[i], seen[j]) for i, j in itertools.combinations(range(len(colours)), 2)}
    assert min(pairs.values()) >= DIFFER, min(pairs, key=pairs.__getitem__)


@pytest.mark.parametrize("vision", VISIONS)
def test_vehicles_are_told_from_the_sea(vision):
    matrix = np.asarray(VISIONS[vision])
    for colour, water in itertools.product(CATEGORICAL, style.SEA):
        assert difference(lab(matrix @ linear(colour)), lab(matrix @ linear(web(water)))) >= FROM_SEA, colour


@pytest.mark.parametrize("ground", GROUNDS)
def test_colours_stand_out_from_their_ground(ground):
    assert all(contrast(code, ground) >= 3 for code in GROUNDS[ground])


def test_each_category_has_a_colour_on_both_grounds_and_a_shape_of_its_own():
    assert len(CATEGORICAL) == len(CATEGORICAL_ON_WHITE) == len(set(MARKERS)) == len(MARKERS) == 8
    assert all(MarkerStyle(marker).is_filled() for marker in MARKERS)


@pytest.mark.parametrize("theme", style.THEMES.values(), ids=style.THEMES)
def test_text_is_legible(theme):
    for text, ground in ((theme.text, theme.card), (theme.muted, theme.card), (theme.muted, theme.background)):
        assert contrast(web(text), web(ground)) >= 4.5  # WCAG 2.2, AA


def test_sixteen_vehicles_have_colours_of_their_own():
    for colours in (style.auv_colour, style.DARK.auv, style.LIGHT.auv):
        assert len({colours(auv) for auv in range(16)}) == 16


class TestText:
    def test_letters_are_there_and_those_of_other_scripts_are_replaced(self):
        pictures = np.zeros((4, 40, 120, 3), np.uint8)
        write(pictures[0], "?", (10, 25), 20, (255, 255, 255))
        for letter in "σηΣ±×→↑…“”·−²µ°":
            pictures[1] = 0
            write(pictures[1], letter, (10, 25), 20, (255, 255, 255))
            assert pictures[1].any()
            assert (pictures[1] != pictures[0]).any()
        write(pictures[2], "海\n1", (10, 25), 20, (255, 255, 255))
        write(pictures[3], "??1", (10, 25), 20, (255, 255, 255))
        assert (pictures[2] == pictures[3]).all()

    def test_what_is_outside_is_cut_off(self):
        picture = np.zeros((20, 60, 3), np.uint8)
        for position in ((-20, 15), (50, 15), (10, 3), (10, 32), (500, 15), (10, -90)):
            write(picture, "Text", position, 14, (255, 255, 255))
        assert picture.any()
