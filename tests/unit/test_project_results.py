"""The results of stages over time: in use, replaced, restored, and waiting for a whole cut; without training."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from nvsim.project import ledger
from nvsim.project.earlier_results import discard, kept_results, replaced_result_sentence, restore
from nvsim.project.project import Project
from nvsim.project.state.cuts import StoredCut, load_cut, save_cut
from nvsim.submaps.split import Submap


def cut(count: int) -> tuple[Submap, ...]:
    return tuple(Submap(i, (i,), (i,), np.full((1, 3), float(i))) for i in range(count))


def train(project: Project, submap: int, steps: int) -> bool:
    """Commits a model as the training does, with `steps` as its configuration."""
    ledger.begin_part(project, "train", f"{submap} {steps}", submap)
    folder = project.root / project.stage_results().made_at("train", submap)[f"models/submap_{submap:03d}"]
    folder.mkdir(parents=True)
    (folder / "model.json").write_text(str(steps))
    return ledger.add_model(project, submap, 1.0, {"steps": steps}, f"batch {steps}")


def in_use(project: Project) -> list[str]:
    folders = [project.layout.model(s.index) for s in project.submaps("train")]
    return [(folder / "model.json").read_text() for folder in folders if (folder / "model.json").is_file()]


@pytest.fixture
def project(tmp_path: Path) -> Iterator[Project]:
    with Project.create_or_open(tmp_path / "house.nvsim") as opened:
        opened.set_submaps(cut(2))
        for submap in range(2):
            assert train(opened, submap, 12)
        yield opened


def test_each_model_replaces_one_and_the_models_before_the_batch_are_restored(project: Project) -> None:
    assert project.stage_results().restorable_stages == frozenset()
    assert train(project, 0, 16) and in_use(project) == ["16", "12"]
    assert train(project, 1, 16) and in_use(project) == ["16", "16"]
    assert "16 steps" in replaced_result_sentence(project, "train")
    assert "12 steps" in restore(project, "train") and in_use(project) == ["12", "12"]
    assert ledger.trained_key(project, 0) == "0 12" and ledger.is_current(project, "train", "1 12", 1)
    assert "16 steps" in restore(project, "train") and in_use(project) == ["16", "16"]


def test_a_batch_after_a_restore_keeps_the_restored_models(project: Project) -> None:
    train(project, 0, 16)
    restore(project, "train")
    assert train(project, 0, 16) and in_use(project) == ["16", "12"]
    assert "12 steps" in restore(project, "train") and in_use(project) == ["12", "12"]


def test_a_submap_that_is_trained_again_in_its_batch_starts_another_batch(project: Project) -> None:
    train(project, 0, 12)
    train(project, 1, 12)
    kept = project.stage_results().results["previous", "train"]
    places = [kept.files[f"models/submap_{i:03d}"] for i in range(2)]
    assert places == ["models/submap_000", "models/submap_001"]
    assert all((project.root / place / "model.json").is_file() for place in places)


def test_models_of_another_cut_wait_until_all_are_trained(project: Project) -> None:
    project.set_submaps(cut(3))
    assert project.uses_previous_submaps("train") and len(project.submaps("train")) == 2
    assert not train(project, 0, 16) and not train(project, 2, 16)
    assert [bool(ledger.trained_key(project, s)) for s in range(3)] == [True, False, True]
    assert in_use(project) == ["12", "12"]
    assert train(project, 1, 16)
    assert in_use(project) == ["16", "16", "16"] and not project.uses_previous_submaps("train")
    restore(project, "train")
    assert in_use(project) == ["12", "12"] and not project.layout.model(2).exists()


def test_work_on_other_submaps_continues_when_one_is_finished(project: Project) -> None:
    assert not ledger.begin_part(project, "train", "1 16", 1)
    train(project, 0, 16)
    assert ledger.begin_part(project, "train", "1 16", 1)


def test_one_earlier_result_is_kept_and_its_files_are_removed_with_it(project: Project) -> None:
    for steps in (14, 16, 18):
        for submap in range(2):
            train(project, submap, steps)
    assert len(list(project.layout.models.iterdir())) == 4
    (kept,) = kept_results(project)
    assert kept.stage == "train" and "16 steps" in kept.words and kept.bytes == 4
    assert discard(project, "train") == 4
    assert len(list(project.layout.models.iterdir())) == 2 and in_use(project) == ["18", "18"]


def test_a_part_is_stored_with_the_version_that_made_it(project: Project) -> None:
    from nvsim import __version__

    part = project.stage_results().part("train", 1)
    assert part is not None and part.version == __version__ and part.summary == {"steps": 12}


def test_a_cut_follows_its_frames_into_another_capture(tmp_path: Path) -> None:
    positions = np.arange(12.0).reshape(4, 3)
    parts = (Submap(0, (0, 1), (0, 1, 2), positions[:2]), Submap(1, (2, 3), (1, 2, 3), positions[2:]))
    save_cut(tmp_path / "1.npz", parts, ["a", "b", "c", "d"])
    stored = load_cut(tmp_path / "1.npz")
    assert stored.of_frames(["a", "b", "c", "d"]) == stored.submaps
    one, two = stored.of_frames(["new", "d", "c", "a"])
    assert (one.core, one.frames, two.core, two.frames) == ((3,), (2, 3), (1, 2), (1, 2))
    np.testing.assert_array_equal(one.positions, positions[:1])
    np.testing.assert_array_equal(two.positions, positions[[3, 2]])
    assert [s.index for s in stored.of_frames(["c", "new"])] == [1]
    # A file of an earlier version has no names: frames beyond the end of the capture are omitted.
    assert [s.core for s in StoredCut(parts, ()).of_frames(["a", "b", "c"])] == [(0, 1), (2,)]
