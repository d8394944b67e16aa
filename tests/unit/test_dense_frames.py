"""Of nearly equal frames, the sharpest is kept; other captures keep all frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import capture_samples as sample
import cv2
import numpy as np
from test_capture_pose_files import seven_scenes

from nvsim.capture.check import check
from nvsim.capture.dense_frames import ALIKE, MANY, NEAR, without_near_duplicates
from nvsim.capture.read import read
from nvsim.submaps.split import SubmapConfig, split


def dense(count: int, step: float) -> np.ndarray:
    """(count, 4, 4) level cameras on a line, `step` meters apart."""
    poses = np.tile(sample.walk(1)[0], (count, 1, 1))
    poses[:, 0, 3] = step * np.arange(count)
    return poses


def test_the_sharpest_of_nearly_equal_frames_is_kept(tmp_path: Path) -> None:
    capture = read(seven_scenes(tmp_path / "scan", dense(MANY + 10, 0.012)))
    noise = np.random.default_rng(0).integers(0, 255, (sample.HEIGHT, sample.WIDTH, 3), np.uint8)
    sharp = (2, 5, 13)
    for i in sharp:
        assert cv2.imwrite(str(capture.frames[i].image_path), noise)
    kept = without_near_duplicates(capture)
    indices = [int(f.timestamp) for f in kept.frames]
    assert indices == sorted(indices) and 40 <= len(indices) <= 70
    assert {2, 5, 13} & set(indices) and not {0, 1, 3} & set(indices)
    assert [d.frame for d in kept.depths] == [f.name for f in kept.frames]
    first = np.array([f.camera_to_world[:3, 3] for f in kept.frames])
    assert np.linalg.norm(np.diff(first, axis=0), axis=1).max() <= 3 * NEAR
    assert any("nearly equal" in f.message for f in check(tmp_path / "scan").findings)


def test_other_directions_and_other_sensors_are_not_equal(tmp_path: Path) -> None:
    capture = read(seven_scenes(tmp_path / "scan", dense(MANY + 10, 0.0)))
    turned = []
    for i, frame in enumerate(capture.frames):
        angle = np.radians(2 * ALIKE * (i % 30))
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        turned.append(replace(frame, camera_to_world=turn @ frame.camera_to_world, sensor=f"camera{i % 2}"))
    kept = without_near_duplicates(replace(capture, frames=tuple(turned))).frames
    assert len(kept) == 30


def test_captures_that_are_not_dense_keep_all_frames(tmp_path: Path) -> None:
    small = read(seven_scenes(tmp_path / "small", dense(20, 0.001)))
    assert without_near_duplicates(small) is small
    wide = read(seven_scenes(tmp_path / "wide", dense(MANY + 10, 0.2)))
    assert without_near_duplicates(wide) is wide


def test_more_submaps_that_share_all_frames_are_not_made() -> None:
    rng = np.random.default_rng(0)
    room = rng.uniform(-0.7, 0.7, (600, 3))  # every camera is within the overlap of every other
    assert [len(s.frames) for s in split(room, SubmapConfig())] == [600]
    corridor = np.column_stack([np.linspace(0, 60, 600), rng.normal(0, 0.05, 600), np.full(600, 1.5)])
    submaps = split(corridor, SubmapConfig())
    assert len(submaps) == 4 and max(len(s.frames) for s in submaps) <= 250
