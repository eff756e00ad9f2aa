"""Video files: what is decoded is what was drawn."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest

from usvauv.cli.encoder import FORMATS, video_file


def gradients(count: int) -> list[np.ndarray]:
    """Pictures of 330 × 322, whose rows the encoder pads, each brighter than the one before."""
    slope = np.linspace(0, 60, 330, dtype=np.uint8)
    return [np.broadcast_to((slope + 20 * i)[None, :, None], (322, 330, 3)).copy() for i in range(count)]


def encoded(path: Path, pictures: list[np.ndarray]) -> Path:
    """A video of pictures that are all drawn into the same array, as a painter does."""
    drawn = np.empty_like(pictures[0])
    with video_file(path, 330, 322, 30) as append:
        for picture in pictures:
            drawn[:] = picture
            append(drawn)
    return path


@pytest.mark.parametrize("ending", list(FORMATS))
def test_a_file_has_the_pictures_in_their_order(ending, tmp_path):
    """Decoded, each is its picture, to what the kind of file loses; and the same pictures make the same file."""
    pictures = gradients(9)
    path = encoded(tmp_path / f"first{ending}", pictures)
    assert encoded(tmp_path / f"second{ending}", pictures).read_bytes() == path.read_bytes()
    if ending == ".webp":  # FFmpeg writes moving WebP and reads only still ones
        return
    with av.open(str(path)) as file:
        shown = [frame.to_ndarray(format="bgr24").astype(float) for frame in file.decode(video=0)]
    assert len(shown) == len(pictures)
    for got, picture in zip(shown, pictures, strict=True):
        assert np.abs(got - picture).mean() < 6
