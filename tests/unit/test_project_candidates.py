"""The steps of the hybrid segmentation for a frame of a project: stored, found again, made anew when they must be."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from nvsim.capture.store import save_capture
from nvsim.capture.types import Alignment, Capture, Cloud, Frame
from nvsim.errors import InputError
from nvsim.geometry.camera import camera_pose
from nvsim.geometry.lens import Lens
from nvsim.perception.hybrid import HybridSteps
from nvsim.project import ledger
from nvsim.project.frame_candidates import CandidateMaker, candidates_path, read_candidates
from nvsim.project.project import Project
from nvsim.submaps.split import Submap


@pytest.fixture
def project(tmp_path: Path):
    """Six views of a floor with stripes before a white wall."""
    rng = np.random.default_rng(4)
    floor = np.column_stack([rng.uniform(-4, 4, 20_000), rng.uniform(-1, 6, 20_000), np.zeros(20_000)])
    wall = np.column_stack([rng.uniform(-4, 4, 12_000), np.full(12_000, 6.0), rng.uniform(0, 3, 12_000)])
    lens = Lens("PINHOLE", 160, 120, (100.0, 100.0, 80.0, 60.0))
    frames = []
    for i in range(6):
        pose = camera_pose(np.array([0.3 * i - 0.9, 0.2 * i, 1.5]), 0.0, math.radians(-25))
        frame = Frame(f"{i}.png", tmp_path / f"{i}.png", lens, pose)
        rays = frame.camera.rays()
        ground = pose[:3, 3] + (-pose[2, 3] / np.minimum(rays[..., 2], -1e-6))[..., None] * rays
        on_floor = (rays[..., 2] < 0) & (ground[..., 1] < 6)
        stripes = np.where(np.floor(ground[..., 0] * 3) % 2 > 0, 90, 130)
        image = np.where(on_floor, stripes, 235).astype(np.uint8)
        cv2.imwrite(str(frame.image_path), np.repeat(image[..., None], 3, axis=-1))
        frames.append(frame)
    cloud = Cloud(np.concatenate([floor, wall]).astype(np.float32))
    capture = Capture(tmp_path, "nerfstudio", tuple(frames), cloud, Alignment.identity())
    with Project.create_or_open(tmp_path / "house.nvsim") as opened:
        save_capture(capture, opened.layout.imported)
        opened.set_submaps((Submap(0, tuple(range(6)), tuple(range(6)), capture.positions),))
        opened.layout.floor.mkdir()
        np.savez(opened.layout.surface(0), heights=np.zeros((1, 1), np.float32), origin=np.zeros(2), spacing=1.0)
        yield opened


def found(project: Project) -> None:
    ledger.begin_part(project, "floors", "some key")
    ledger.finish(project, "floors", 0.0, {})


def test_the_steps_are_made_once_and_come_back_as_they_were(project: Project, monkeypatch) -> None:
    found(project)
    made: list[HybridSteps] = []
    from nvsim.perception.hybrid import HybridFloor

    steps_of = HybridFloor.steps

    def steps(self, *arguments) -> HybridSteps:
        made.append(steps_of(self, *arguments))
        return made[-1]

    monkeypatch.setattr(HybridFloor, "steps", steps)
    maker = CandidateMaker(project)
    path = maker.make(2)
    stored = read_candidates(path)
    for name in ("semantic", "horizontal", "candidates", "prompted"):
        assert np.array_equal(getattr(stored, name), getattr(made[0], name))
    assert np.array_equal(stored.points, made[0].points)
    assert np.abs(stored.normals - made[0].normals).max() < 0.01
    assert stored.prompted[100, 80] and not stored.prompted[10, 80]
    assert maker.make(2) == path and len(made) == 1
    path.write_bytes(path.read_bytes()[:500])  # half a file
    maker.make(2)
    assert len(made) == 2 and read_candidates(path) is not None


def test_floors_found_anew_make_the_old_steps_void(project: Project) -> None:
    found(project)
    before = candidates_path(project, 2)
    ledger.begin_part(project, "floors", "another key")
    ledger.finish(project, "floors", 0.0, {})
    assert candidates_path(project, 2) != before


def test_before_the_floors_are_found_it_says_what_to_do(project: Project) -> None:
    with pytest.raises(InputError, match="nvsim floors"):
        CandidateMaker(project).make(2)
    found(project)
    project.layout.surface(0).unlink()
    with pytest.raises(InputError, match="surface_000.*nvsim floors"):
        CandidateMaker(project).make(2)


def test_points_without_a_network_are_refused_with_the_folder_it_belongs_into(
    project: Project, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setenv("NVSIM_MODELS", str(tmp_path / "models"))
    found(project)
    with pytest.raises(InputError, match="no prompted network in .*models; add one with .nvsim models add"):
        CandidateMaker(project).prompt(2, np.array([[0.5, 0.5]]), np.ones(1, bool))
