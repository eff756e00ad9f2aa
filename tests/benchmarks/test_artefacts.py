"""The list of what makes the docs' figures and tables is complete, and its commands are those of the pages."""

import re
import subprocess

import av
import numpy as np
import pytest

from benchmarks.artefacts import ARTEFACTS, ROOT, frame

DOCS = ROOT / "docs"


def test_every_picture_has_a_command():
    tracked = subprocess.run(["git", "ls-files", "docs"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    pictures = {name.removeprefix("docs/") for name in tracked.splitlines() if name.endswith((".png", ".csv"))}
    made = [name for artefact in ARTEFACTS.values() for name in artefact.pictures]
    assert sorted(made) == sorted(pictures)


def test_every_study_that_a_page_names_is_made_for_it():
    made = {match for each in ARTEFACTS.values() for command in each.commands for match in _programs(command)}
    for page in DOCS.glob("*.md"):
        for program in _programs(" ".join(page.read_text(encoding="utf-8").split())):
            assert program in made, f"{page.name}: {program}"


@pytest.mark.parametrize("name", ARTEFACTS)
def test_the_page_names_the_command(name):
    artefact = ARTEFACTS[name]
    page = ROOT / artefact.page if artefact.page == "README.md" else DOCS / artefact.page
    text = " ".join(page.read_text(encoding="utf-8").split())
    command = re.sub(r" (?:--out|--learned) \S+", "", artefact.commands[-1])
    assert command in re.sub(r" (?:--out|--learned) [^\s`]+", "", text), command


def _programs(text):
    """Modules of studies, benchmarks and cases, and targets of `usvauv reproduce`."""
    found = re.findall(r"python -m ((?:benchmarks\.(?!gpu|artefacts)|tests\.cases)[\w.]*\w)", text)
    return found + re.findall(r"usvauv reproduce (?!all --quick)\w+ --out", text)


def test_a_frame_of_a_video(tmp_path):
    with av.open(str(tmp_path / "video.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=10, width=64, height=48, pix_fmt="yuv420p")
        for shade in (0, 120, 240):
            image = av.VideoFrame.from_ndarray(np.full((48, 64, 3), shade, np.uint8), format="rgb24")
            container.mux(stream.encode(image))
        container.mux(stream.encode())
    frame(tmp_path / "video.mp4", 2, tmp_path / "frame.png")
    with av.open(str(tmp_path / "frame.png")) as picture:
        (shown,) = picture.decode(video=0)
    assert abs(int(shown.to_ndarray(format="gray").mean()) - 120) < 5
    with pytest.raises(ValueError, match="fewer than 4 frames"):
        frame(tmp_path / "video.mp4", 4, tmp_path / "frame.png")
