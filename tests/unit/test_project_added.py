"""A capture that is added keeps everything the project had in its place, and the later stages notice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from capture_samples import room, turn, walk, write_nerfstudio

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.events import ignore_event
from nvsim.project.config import CaptureConfig
from nvsim.project.corrections import corrected_frames, save_correction
from nvsim.project.project import Project
from nvsim.project.stages import added_captures, imported, submaps
from nvsim.submaps.split import SubmapConfig

UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # a world whose y is down


@pytest.fixture
def walks(tmp_path: Path) -> list[Path]:
    made = []
    for name, count, seed in (("one", 12, 0), ("two", 7, 1), ("elsewhere/one", 5, 2)):
        (tmp_path / name).mkdir(parents=True)
        made.append(write_nerfstudio(tmp_path / name, *turn(UP, walk(count=count, seed=seed), room(seed=seed + 1))))
    return [path if path.is_dir() else path.parent for path in made]


@pytest.fixture
def project(walks: list[Path], tmp_path: Path) -> Path:
    with Project.create_or_open(tmp_path / "house.nvsim") as made:
        imported.run(made, walks[0], CaptureConfig(camera_height=1.4), ignore_event)
        submaps.run(made, SubmapConfig(count=2), ignore_event)
    return tmp_path / "house.nvsim"


def test_what_was_imported_keeps_its_place_and_the_submaps_are_cut_anew(project: Path, walks: list[Path]) -> None:
    with Project.open(project, writable=True) as opened:
        former = opened.need_capture()
        together = added_captures.run(opened, walks[1], ignore_event)
        assert [f.name for f in together.frames[:12]] == [f"one/{f.name}" for f in former.frames]
        assert len(together.frames) == 19 and together.frames[12].name.startswith("two/")
        np.testing.assert_array_equal(together.positions[:12], former.positions)
        np.testing.assert_array_equal(together.alignment.rotation, former.alignment.rotation)
        assert added_captures.sources(together) == [former.source, walks[1]]
        cut = submaps.run(opened, SubmapConfig(count=2), ignore_event)
        assert {i for s in cut for i in s.core} == set(range(19))


def test_frames_that_were_left_out_stay_left_out_beside_another_walk(walks: list[Path], tmp_path: Path) -> None:
    with Project.create_or_open(tmp_path / "less.nvsim") as made:
        config = CaptureConfig(camera_height=1.4, leave_out="images/002.png, images/005.png")
        assert len(imported.run(made, walks[0], config, ignore_event).frames) == 10
        together = added_captures.run(made, walks[1], ignore_event, "two/images/000.png")
        names = {f.name for f in together.frames}
        assert len(names) == 16 and not names & {"one/images/002.png", "one/images/005.png", "two/images/000.png"}
        assert len(added_captures.run(made, walks[2], ignore_event).frames) == 21


def test_the_new_walk_lies_where_it_would_lie_alone(project: Path, walks: list[Path], tmp_path: Path) -> None:
    with Project.create_or_open(tmp_path / "alone.nvsim") as other:
        alone = imported.run(other, walks[1], CaptureConfig(camera_height=1.4), ignore_event)
    with Project.open(project, writable=True) as opened:
        together = added_captures.run(opened, walks[1], ignore_event)
    np.testing.assert_allclose(together.positions[12:], alone.positions, atol=0.03)


def test_a_third_walk_of_the_same_name_changes_no_other_name(project: Path, walks: list[Path]) -> None:
    with Project.open(project, writable=True) as opened:
        two = added_captures.run(opened, walks[1], ignore_event)
        three = added_captures.run(opened, walks[2], ignore_event)
        assert [f.name for f in three.frames[:19]] == [f.name for f in two.frames]
        assert three.frames[19].name.startswith("one-1/")
        assert [p.name for p in project.glob("*.captures")] == ["together-3.captures"]


def test_corrected_masks_stay_with_their_frames(project: Path, walks: list[Path]) -> None:
    with Project.open(project, writable=True) as opened:
        frames = opened.need_capture().frames
        save_correction(opened.layout, frames[4], np.eye(48, 64, dtype=bool))
        added_captures.run(opened, walks[1], ignore_event)
        added_captures.run(opened, walks[2], ignore_event)
        assert corrected_frames(opened.layout, opened.need_capture().frames) == {4}
        assert len(list(opened.layout.corrections.iterdir())) == 1


@pytest.mark.parametrize("wrong", ["held", "missing", "broken"])
def test_what_cannot_be_added_leaves_the_project_as_it_was(project: Path, walks: list[Path], wrong: str) -> None:
    path, words = {
        "held": (walks[0], "already"),
        "missing": (walks[0].parent / "nowhere", "does not exist"),
        "broken": (walks[1], "image is"),
    }[wrong]
    if wrong == "broken":
        next((walks[1] / "images").iterdir()).write_bytes(b"")
    with Project.open(project, writable=True) as opened:
        save_correction(opened.layout, opened.need_capture().frames[2], np.eye(48, 64, dtype=bool))
        source, before = opened.need_capture().source, sorted(p.name for p in project.rglob("*") if p.is_file())
        with pytest.raises(InputError, match=words):
            added_captures.run(opened, path, ignore_event)
        assert sorted(p.name for p in project.rglob("*") if p.is_file()) == before
        assert len(opened.need_capture().frames) == 12 and opened.need_capture().source == source


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
@pytest.mark.parametrize("where", ["imported.run", "corrected_frames"])
def test_an_interrupted_addition_leaves_the_project_as_it_was(
    project: Path, walks: list[Path], error: type[BaseException], where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*arguments: object, **named: object) -> None:
        raise error

    monkeypatch.setattr(f"nvsim.project.stages.added_captures.{where}", interrupted)
    with Project.open(project, writable=True) as opened:
        save_correction(opened.layout, opened.need_capture().frames[2], np.eye(48, 64, dtype=bool))
        before = sorted(p.name for p in project.rglob("*") if p.is_file())
        with pytest.raises(error):
            added_captures.run(opened, walks[1], ignore_event)
        assert sorted(p.name for p in project.rglob("*") if p.is_file()) == before


def test_an_interruption_after_the_import_keeps_the_list_of_captures(
    project: Path, walks: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = imported.run

    def interrupted(*arguments: Any) -> None:
        run(*arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr(imported, "run", interrupted)
    with Project.open(project, writable=True) as opened:
        with pytest.raises(KeyboardInterrupt):
            added_captures.run(opened, walks[1], ignore_event)
        assert len(added_captures.sources(opened.need_capture())) == 2


def test_the_command_adds_and_says_what_it_will_not_take(project: Path, walks: list[Path], capsys) -> None:
    assert main(["import", str(walks[1]), "--add", "--project", str(project), "--scale", "2"]) == 2
    assert "do not give --scale" in capsys.readouterr().err
    assert main(["import", str(walks[1]), "--add", "--project", str(project)]) == 0
    with Project.open(project) as opened:
        assert len(opened.need_capture().frames) == 19
    assert main(["import", str(walks[1]), "--add", "--project", str(project.parent / "new.nvsim")]) == 2
