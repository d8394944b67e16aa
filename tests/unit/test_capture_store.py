"""A stored capture equals the original, and its fingerprint changes with every relevant value."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import capture_samples as sample
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nvsim.capture.read import read
from nvsim.capture.store import fingerprint, load_capture, save_capture
from nvsim.capture.types import Alignment, Capture, Cloud
from nvsim.errors import InputError


@pytest.fixture
def capture(tmp_path: Path) -> Capture:
    rotation = Rotation.random(random_state=3).as_matrix()
    poses, points = sample.turn(rotation, sample.walk(), sample.room(3000))
    return read(sample.write_colmap(tmp_path / "source", poses, points, binary=True), camera_height=1.37)


def test_a_stored_capture_comes_back_equal_in_every_bit(capture: Capture, tmp_path: Path) -> None:
    save_capture(capture, tmp_path / "stored")
    again = load_capture(tmp_path / "stored")
    assert (again.source, again.format) == (capture.source, capture.format)
    for a, b in zip(capture.frames, again.frames, strict=True):
        assert (a.name, a.image_path, a.lens, a.sensor, a.timestamp) == (
            b.name,
            b.image_path,
            b.lens,
            b.sensor,
            b.timestamp,
        )
        assert np.array_equal(a.camera_to_world, b.camera_to_world) and b.image_path.is_absolute()
    assert capture.cloud is not None and again.cloud is not None
    assert np.array_equal(capture.cloud.points, again.cloud.points) and again.cloud.points.dtype == np.float32
    assert np.array_equal(capture.cloud.colors, again.cloud.colors) and again.cloud.kind == "sfm"
    assert np.array_equal(capture.alignment.rotation, again.alignment.rotation)
    assert (again.alignment.scale, again.alignment.scale_known) == (capture.alignment.scale, True)
    assert fingerprint(again) == fingerprint(capture)


def test_a_capture_without_cloud_replaces_one_with(capture: Capture, tmp_path: Path) -> None:
    save_capture(capture, tmp_path / "stored")
    save_capture(replace(capture, cloud=None), tmp_path / "stored")
    assert load_capture(tmp_path / "stored").cloud is None
    assert [p.name for p in (tmp_path / "stored").iterdir()] == ["capture.json"]


def test_a_new_cloud_leaves_one_file(capture: Capture, tmp_path: Path) -> None:
    save_capture(capture, tmp_path / "stored")
    assert capture.cloud is not None
    save_capture(replace(capture, cloud=Cloud(capture.cloud.points[:7])), tmp_path / "stored")
    cloud = load_capture(tmp_path / "stored").cloud
    assert cloud is not None and len(cloud.points) == 7 and cloud.colors is None
    assert len(list((tmp_path / "stored").iterdir())) == 2


def test_the_fingerprint_follows_poses_lenses_images_and_cloud(capture: Capture) -> None:
    before = fingerprint(capture)
    assert fingerprint(capture) == before
    first, rest = capture.frames[0], capture.frames[1:]
    moved = first.camera_to_world.copy()
    moved[0, 3] += 1e-9
    longer = replace(first.lens, params=(41.0, *first.lens.params[1:]))
    assert capture.cloud is not None
    changed = {
        fingerprint(replace(capture, frames=(replace(first, camera_to_world=moved), *rest))),
        fingerprint(replace(capture, frames=(replace(first, lens=longer), *rest))),
        fingerprint(replace(capture, frames=rest)),
        fingerprint(replace(capture, cloud=None)),
        fingerprint(replace(capture, cloud=Cloud(capture.cloud.points + 1))),
        fingerprint(replace(capture, alignment=Alignment.identity())),
    }
    os.utime(first.image_path, ns=(1, 1))
    changed.add(fingerprint(capture))
    assert len(changed) == 7 and before not in changed


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda text: text[:300], "not a stored capture"),
        (lambda text: text.replace('"version": 1', '"version": 99'), "version 99"),
        (lambda text: text.replace('"camera_to_world"', '"pose"', 1), "damaged"),
        (lambda text: text.replace('"PINHOLE"', '"HOLE"', 1), "damaged"),
        (lambda text: "[]", "not a stored capture"),
    ],
)
def test_a_damaged_or_newer_store_is_refused_in_a_sentence(
    capture: Capture, tmp_path: Path, damage, message: str
) -> None:
    save_capture(capture, tmp_path / "stored")
    path = tmp_path / "stored" / "capture.json"
    path.write_text(damage(path.read_text()))
    with pytest.raises(InputError, match=message):
        load_capture(tmp_path / "stored")


def test_a_missing_cloud_file_is_refused_in_a_sentence(capture: Capture, tmp_path: Path) -> None:
    save_capture(capture, tmp_path / "stored")
    next((tmp_path / "stored").glob("cloud-*")).write_bytes(b"PK")
    with pytest.raises(InputError, match="import the capture again"):
        load_capture(tmp_path / "stored")
