"""A mask that a person corrected counts everywhere, makes stale what was made without it, and is never overwritten."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from nvsim.capture.store import save_capture
from nvsim.capture.types import Alignment, Capture, Frame
from nvsim.errors import InputError
from nvsim.events import ignore_event
from nvsim.geometry.camera import camera_pose
from nvsim.geometry.lens import Lens
from nvsim.perception.segment import read_mask
from nvsim.project import ledger
from nvsim.project.corrections import (
    corrected_frames,
    corrections_key,
    discard_corrections,
    remove_correction,
    save_correction,
)
from nvsim.project.project import Project
from nvsim.project.stages import floors, mapped, trained
from nvsim.project.stages.submap_training import training_views
from nvsim.project.state.results import StageResult
from nvsim.submaps.split import Submap
from nvsim.training.config import TrainingConfig

WIDTH, HEIGHT = 64, 48


@pytest.fixture
def project(tmp_path: Path):
    """Twelve frames along a corridor whose floors were found, all of them empty, in two submaps."""
    lens = Lens("PINHOLE", WIDTH, HEIGHT, (40.0, 40.0, WIDTH / 2, HEIGHT / 2))
    frames = []
    for i in range(12):
        path = tmp_path / f"{i}.png"
        cv2.imwrite(str(path), np.full((HEIGHT, WIDTH, 3), 10 * i, np.uint8))
        pose = camera_pose(np.array([0.0, 0.5 * i, 1.5]), 0.0, math.radians(-40))
        frames.append(Frame(f"walk/cam 0/{i}.png", path, lens, pose))
    capture = Capture(tmp_path, "nerfstudio", tuple(frames), None, Alignment.identity())
    with Project.create_or_open(tmp_path / "house.nvsim") as opened:
        save_capture(capture, opened.layout.imported)
        halves = [tuple(range(6)), tuple(range(6, 12))]
        opened.set_submaps(tuple(Submap(k, h, h, capture.positions[list(h)]) for k, h in enumerate(halves)))
        for stage in ("import", "submaps"):
            ledger.begin_part(opened, stage, stage)
            ledger.finish(opened, stage, 0.0, {}, settings='{"camera_height": 1.5}')
        floors.run(opened, ignore_event)
        for i in range(12):
            cv2.imwrite(str(opened.layout.mask(i)), np.zeros((HEIGHT, WIDTH), np.uint8))
        yield opened


def lower_half(width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    mask = np.zeros((height, width), bool)
    mask[height // 2 :] = True
    return mask


def correct(project: Project, index: int, mask: np.ndarray | None = None) -> None:
    save_correction(project.layout, project.need_capture().frames[index], lower_half() if mask is None else mask)


def test_training_sees_the_correction_and_not_the_machines_mask(project: Project) -> None:
    correct(project, 2, lower_half(4 * WIDTH, 4 * HEIGHT))  # painted at a larger size than training's
    views = training_views(project, [1, 2], TrainingConfig())
    assert not views[0].floor.any()
    assert np.array_equal(views[1].floor, lower_half())


def test_a_correction_makes_only_the_submap_stale_that_trains_on_it(project: Project) -> None:
    before = [trained.train_key(project, s, TrainingConfig()) for s in project.submaps()]
    correct(project, 2)
    after = [trained.train_key(project, s, TrainingConfig()) for s in project.submaps()]
    assert after[0] != before[0] and after[1] == before[1]
    correct(project, 2, ~lower_half())
    assert trained.train_key(project, project.submaps()[0], TrainingConfig()) not in (before[0], after[0])
    remove_correction(project.layout, project.need_capture().frames[2])
    assert [trained.train_key(project, s, TrainingConfig()) for s in project.submaps()] == before


def test_a_correction_of_a_frame_that_is_held_out_leaves_the_model_current(project: Project) -> None:
    before = [trained.train_key(project, s, TrainingConfig()) for s in project.submaps()]
    correct(project, 4)  # frames 4, 12, ... are held out
    assert [trained.train_key(project, s, TrainingConfig()) for s in project.submaps()] == before


def forget_floors(project: Project) -> None:
    """Removes the record of the floors stage, so that it runs again."""
    found = project.stage_results()
    in_use = found.get("in use", "floors")
    assert in_use is not None
    project.set_stage_results(found.with_result("in use", "floors", StageResult({}, in_use.files)))


def test_finding_the_floors_again_keeps_the_corrections_unless_they_are_to_go(project: Project) -> None:
    correct(project, 2)
    forget_floors(project)
    floors.run(project, ignore_event)
    assert np.array_equal(read_mask(project.mask_path(2)), lower_half())
    assert corrected_frames(project.layout, project.need_capture().frames) == {2}
    floors.run(project, ignore_event, discard=True)
    assert project.mask_path(2) == project.layout.mask(2)
    assert discard_corrections(project) == 0


def test_the_supported_floor_follows_the_corrections(project: Project) -> None:
    forget_floors(project)
    floors.run(project, ignore_event)
    before = project.support().cells.copy()
    for index in range(12):
        correct(project, index, np.zeros((HEIGHT, WIDTH), bool))
    key = mapped.map_key
    from nvsim.mapping.config import MappingConfig

    stale = key(project, MappingConfig())
    floors.refresh_support(project, ignore_event)
    assert project.support().cells.sum() < before.sum()
    discard_corrections(project)
    assert key(project, MappingConfig()) != stale
    floors.refresh_support(project, ignore_event)
    assert np.array_equal(project.support().cells, before)


def test_a_correction_belongs_to_the_frames_name_wherever_it_stands(project: Project) -> None:
    correct(project, 2)
    frames = project.need_capture().frames
    assert corrected_frames(project.layout, frames[1:]) == {1}
    assert project.layout.correction("a/b.png") != project.layout.correction("a_b.png")
    assert project.layout.correction("../../a.png").parent == project.layout.corrections


def test_without_corrections_keys_are_what_they_were_before_there_could_be_any(project: Project) -> None:
    assert corrections_key(project, range(12)) == ()
    correct(project, 2)
    assert corrections_key(project, [3]) == () and corrections_key(project, [2, 3]) == corrections_key(project, [2])


def test_a_folder_that_cannot_be_written_is_said_in_a_sentence(project: Project) -> None:
    project.layout.corrections.write_text("a file where the folder should be")
    with pytest.raises(InputError, match="Cannot write .*corrections"):
        correct(project, 2)
