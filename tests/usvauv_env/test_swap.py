"""Folders that take the place of others."""

import os
from pathlib import Path

import pytest

from usvauv.env.storage import swap


@pytest.fixture
def no_exchange(monkeypatch):
    """A system that cannot exchange names."""

    def refuse(new, place):
        if not place.exists():
            raise FileNotFoundError
        raise NotImplementedError

    monkeypatch.setattr(swap, "_exchange", refuse)


@pytest.fixture
def folders(tmp_path):
    """A new folder, and the place that it is for."""
    new, place = tmp_path / ".last-host-1", tmp_path / "last"
    new.mkdir()
    (new / "what").write_text("new")
    return new, place


@pytest.fixture(params=["as it is", "no_exchange"])
def system(request):
    """With what the system offers, and without."""
    if request.param == "no_exchange":
        request.getfixturevalue("no_exchange")


@pytest.mark.usefixtures("system")
def test_what_was_there_is_where_the_new_one_was(folders):
    new, place = folders
    place.mkdir()
    (place / "what").write_text("old")
    swap.replace_folder(new, place)
    assert {path.name: (path / "what").read_text() for path in place.parent.iterdir()} == {
        place.name: "new",
        new.name: "old",
    }


def test_paths_may_be_relative(folders, monkeypatch):
    new, place = folders
    place.mkdir()
    monkeypatch.chdir(place.parent)
    swap.replace_folder(Path(new.name), Path(place.name))
    assert (place / "what").read_text() == "new"
    assert new.is_dir()


@pytest.mark.usefixtures("system")
def test_where_nothing_was(folders):
    new, place = folders
    swap.replace_folder(new, place)
    assert [path.name for path in place.parent.iterdir()] == [place.name]
    assert (place / "what").read_text() == "new"


def test_a_refusal_between_two_renames_leaves_both_as_they_were(no_exchange, folders, monkeypatch):
    new, place = folders
    place.mkdir()
    replace = os.replace

    def refused(source, target):
        if (source, target) == (new, place):
            raise PermissionError
        replace(source, target)

    monkeypatch.setattr(os, "replace", refused)
    with pytest.raises(PermissionError):
        swap.replace_folder(new, place)
    assert {path.name for path in place.parent.iterdir()} == {place.name, new.name}


def test_what_a_kill_left_is_found(tmp_path):
    """The latest folder on its way out, as long as none is in its place; other folders' and files are none."""
    place = tmp_path / "last"
    assert swap.found(place) == place
    (tmp_path / ".last-file-old").write_text("")
    (tmp_path / ".best-host-3-old").mkdir()
    assert swap.found(place) == place
    for number, when in ((1, 100), (2, 300), (3, 200)):
        old = tmp_path / f".last-host-{number}-old"
        old.mkdir()
        os.utime(old, (when, when))
    assert swap.found(place) == tmp_path / ".last-host-2-old"
    place.mkdir()
    assert swap.found(place) == place
