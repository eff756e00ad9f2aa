"""Text in pictures."""

from __future__ import annotations

import numpy as np

from usvauv.env.render.style import shorten, text_width, write


class TestText:
    def test_letters_are_there(self):
        for letter in "σηΣ±×→↑…“”·−²µ°":
            picture = np.zeros((40, 40, 3), np.uint8)
            missing = np.zeros((40, 40, 3), np.uint8)
            write(picture, letter, (10, 25), 20, (255, 255, 255))
            write(missing, "?", (10, 25), 20, (255, 255, 255))
            assert picture.any()
            assert (picture != missing).any()

    def test_letters_of_other_scripts_are_replaced(self):
        pictures = np.zeros((2, 40, 120, 3), np.uint8)
        write(pictures[0], "海\n1", (10, 25), 20, (255, 255, 255))
        write(pictures[1], "??1", (10, 25), 20, (255, 255, 255))
        assert (pictures[0] == pictures[1]).all()

    def test_outside_is_cut_off(self):
        picture = np.zeros((20, 60, 3), np.uint8)
        for position in ((-20, 15), (50, 15), (10, 3), (10, 32), (500, 15), (10, -90)):
            write(picture, "Text", position, 14, (255, 255, 255))
        assert picture.any()

    def test_anchors_and_shortening(self):
        width = text_width("clear words", 14)
        for anchor, left in (("left", 100), ("centre", 100 - width // 2), ("right", 100 - width)):
            picture = np.zeros((40, 200, 3), np.uint8)
            write(picture, "clear words", (100, 25), 14, (255, 255, 255), anchor=anchor)
            assert abs(np.nonzero(picture.any((0, 2)))[0][0] - left) <= 2
        assert shorten("clear words", 14, width) == "clear words"
        assert text_width(shorten("clear words", 14, width - 10), 14) <= width - 10
