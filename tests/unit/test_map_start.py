"""Where the search begins: `--start` by the name of a frame or by X,Y."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from nvsim.capture.types import Alignment, Capture, Frame
from nvsim.errors import InputError
from nvsim.geometry.lens import Lens
from nvsim.project.stages.mapped import search_start

PLACES = [(0.0, 0.0, 1.2), (2.0, 1.0, 1.3)]


@pytest.fixture
def capture() -> Capture:
    frames = []
    for i, place in enumerate(PLACES):
        pose = np.eye(4)
        pose[:3, 3] = place
        lens = Lens("PINHOLE", 64, 48, (50.0, 50.0, 32.0, 24.0))
        frames.append(Frame(f"images/{i:05d}.jpg", Path(f"images/{i:05d}.jpg"), lens, pose))
    return Capture(Path("house"), "nerfstudio", tuple(frames), None, Alignment.identity())


@pytest.mark.parametrize(
    ("start", "place"),
    [
        ("images/00001.jpg", PLACES[1]),
        ("00000", PLACES[0]),
        ("1.5,1.0", (1.5, 1.0, 1.3)),
        (" -1 , 0", (-1.0, 0.0, 1.2)),
    ],
)
def test_a_start_is_a_frame_or_a_place_in_the_height_of_the_nearest_camera(
    capture: Capture, start: str, place: tuple[float, float, float]
) -> None:
    found = search_start(capture, start)
    assert found is not None and found.tolist() == list(place)


def test_nothing_asked_is_nothing_found(capture: Capture) -> None:
    assert search_start(capture, "") is None


@pytest.mark.parametrize("start", ["kitchen", "1,2,3", "1", "nan,1", "inf,0", "100,100"])
def test_another_start_is_refused_with_a_sentence(capture: Capture, start: str) -> None:
    with pytest.raises(InputError, match=f"--start {start} "):
        search_start(capture, start)
