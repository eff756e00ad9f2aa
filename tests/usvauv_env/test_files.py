"""Files that appear when they are complete."""

import pytest

from usvauv_env.files import OutputError, atomic_write


def test_the_file_appears_when_the_block_ends(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("older")
    with atomic_write(path) as partial:
        partial.write_text("newer")
        assert path.read_text() == "older"
    assert path.read_text() == "newer"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("ending", [KeyboardInterrupt, RuntimeError, OSError])
def test_an_older_file_outlives_what_is_cut_short(tmp_path, ending):
    path = tmp_path / "a.txt"
    path.write_text("older")

    def write() -> None:
        with atomic_write(path) as partial:
            partial.write_text("half")
            raise ending

    with pytest.raises(OutputError if ending is OSError else ending):
        write()
    assert path.read_text() == "older"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("place", ["missing/a.txt", "file/a.txt", "folder"])
def test_a_place_that_takes_no_file_is_named_before_work_begins(tmp_path, place):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError) as caught, atomic_write(tmp_path / place):
        pytest.fail("the block ran")
    assert str(caught.value).startswith(f"{tmp_path / place}: cannot be written: ")
    assert "\n" not in str(caught.value)
