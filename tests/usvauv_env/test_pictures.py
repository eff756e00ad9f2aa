"""Frames are the stored pictures; where they are meant to change, `python -m tests.pictures --renew` writes them."""

import pytest

from tests.pictures import FOLDER, LIMITS, cases, differences, drawn

CASES = cases()


@pytest.mark.parametrize("name", CASES)
def test_a_frame_is_the_stored_picture(name):
    differ, mean = differences(name, drawn(CASES[name]))
    assert differ <= LIMITS[0]
    assert mean <= LIMITS[1]


def test_each_stored_picture_is_compared():
    assert {path.stem for path in FOLDER.iterdir()} == CASES.keys()
