"""Colours of categories, which stand out from their ground; text in pictures."""

import numpy as np
import pytest

from usvauv.env.render import style
from usvauv.env.render.style import CATEGORICAL, CATEGORICAL_ON_WHITE, web, write

GROUNDS = {"#0b131c": CATEGORICAL, "#142130": CATEGORICAL, "#ffffff": CATEGORICAL_ON_WHITE}


def linear(code):
    """Linear RGB of a web colour, 0 to 1 (IEC 61966-2-1)."""
    value = np.array([int(code[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def contrast(code, ground):
    """Contrast of WCAG 2.2, 1 to 21."""
    low, high = sorted(float(np.dot([0.2126729, 0.7151522, 0.0721750], linear(each))) + 0.05 for each in (code, ground))
    return high / low


@pytest.mark.parametrize("ground", GROUNDS)
def test_colours_stand_out_from_their_ground(ground):
    assert all(contrast(code, ground) >= 3 for code in GROUNDS[ground])


@pytest.mark.parametrize("theme", style.THEMES.values(), ids=style.THEMES)
def test_text_is_legible(theme):
    for text, ground in ((theme.text, theme.card), (theme.muted, theme.card), (theme.muted, theme.background)):
        assert contrast(web(text), web(ground)) >= 4.5  # WCAG 2.2, AA


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
