"""The camera path: it passes its keys, smoothly, and files that are wrong are refused with a sentence."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest

from nvsim.errors import InputError
from nvsim.geometry.camera_path import CameraPath, KeyPose, read_camera_path, write_camera_path

KEYS = [
    KeyPose((0, 0, 1.5), heading=3.0),
    KeyPose((2, 1, 1.5), heading=-3.0, elevation=0.2),
    KeyPose((4, 0, 1.0), heading=-2.5, fov=1.2),
]


def test_the_path_passes_every_key() -> None:
    path = CameraPath(KEYS)
    for i, key in enumerate(KEYS):
        at = path.at(i / 2)
        assert at.position == pytest.approx(key.position)
        assert (at.heading, at.elevation, at.fov) == pytest.approx((key.heading, key.elevation, key.fov))


def test_the_heading_takes_the_shorter_turn() -> None:
    headings = np.unwrap([CameraPath(KEYS[:2]).at(t).heading for t in np.linspace(0, 1, 21)])
    assert abs(headings[-1] - headings[0]) == pytest.approx(2 * pi - 6.0)


def test_the_way_has_no_kink_at_a_key() -> None:
    path, h = CameraPath(KEYS), 1e-5
    before = (np.array(path.at(0.5).position) - path.at(0.5 - h).position) / h
    after = (np.array(path.at(0.5 + h).position) - path.at(0.5).position) / h
    assert np.allclose(before, after, atol=1e-2)


def test_a_file_gives_the_same_path_back(tmp_path: Path) -> None:
    write_camera_path(tmp_path / "path.json", KEYS)
    assert read_camera_path(tmp_path / "path.json").keys == tuple(KEYS)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "cannot be read"),
        ("[]", "no list of keys"),
        ('{"keys": []}', "two key poses"),
        ('{"keys": [{"position": [0, 0]}]}', "key 1"),
        ('{"keys": [{"position": [0, 0, 1], "heading": 0, "elevation": 0, "fov": 9}]}', "key 1"),
    ],
)
def test_a_file_that_is_wrong_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "path.json").write_text(text)
    with pytest.raises(InputError, match=said):
        read_camera_path(tmp_path / "path.json")
