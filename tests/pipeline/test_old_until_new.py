"""The result of a stage is in use until its replacement is complete, and can be restored afterward."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from nvsim.building import BuildingConfig, generate
from nvsim.errors import InputError
from nvsim.events import Event, Log, Progress, ignore_event
from nvsim.graph.edits import move_viewpoint
from nvsim.graph.store import same_graph
from nvsim.mapping.config import MappingConfig
from nvsim.project import ledger
from nvsim.project.config import CaptureConfig
from nvsim.project.earlier_results import discard, kept_results, replaced_result_sentence, restore
from nvsim.project.project import Project
from nvsim.project.stages import floors, imported, mapped, submaps, trained
from nvsim.project.state import results
from nvsim.splats.files import load_model, save_model
from nvsim.submaps.split import SubmapConfig
from nvsim.training.config import TrainingConfig

FEW = TrainingConfig(steps=12, image_size=48, gaussian_cap=600, threads=1, checkpoint_seconds=0.0)
MORE = replace(FEW, steps=16)
QUICK = MappingConfig(max_viewpoints=3, view_size=48)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project in which every stage was finished."""
    folder = tmp_path_factory.mktemp("results")
    generate(folder / "building", BuildingConfig(size="small", width=96, height=72, step=1.0, turn=45.0, people=False))
    with Project.create_or_open(folder / "rooms.nvsim") as project:
        imported.run(project, folder / "building" / "capture", CaptureConfig(), ignore_event)
        submaps.run(project, SubmapConfig(count=2), ignore_event)
        floors.run(project, ignore_event)
        trained.run(project, FEW, ignore_event, at_once=1)
        mapped.run(project, QUICK, ignore_event)
    return folder / "rooms.nvsim"


@pytest.fixture
def project(finished: Path, tmp_path: Path) -> Iterator[Project]:
    with Project.open(shutil.copytree(finished, tmp_path / "rooms.nvsim"), writable=True) as opened:
        yield opened


class Killed(BaseException):
    """Takes the place of a kill in the middle of a stage."""


def killed_at(step: int, stage: str = "train") -> Callable[[Event], None]:
    def listen(event: Event) -> None:
        if isinstance(event, Progress) and event.stage == stage and event.done >= step:
            raise Killed

    return listen


def steps_in_use(path: Path) -> list[object]:
    """Of the models that any reader gets."""
    with Project.open(path) as reader:
        scene = reader.scene(live=True)
        return [] if scene is None else [scene.model(i).info["steps"] for i in scene.indices]


def left(project: Project) -> list[str]:
    folder = project.layout.checkpoints
    return sorted(p.name for p in folder.iterdir()) if folder.is_dir() else []


def test_a_training_that_is_cut_off_leaves_the_trained_models_in_use(project: Project) -> None:
    with pytest.raises(Killed):
        trained.run(project, MORE, killed_at(5), at_once=1)
    assert steps_in_use(project.root) == [12, 12]
    assert ledger.record(project, "train", 0) is not None
    mapped.run(project, replace(QUICK, max_viewpoints=2), ignore_event)  # later stages still read them


def test_each_submap_is_replaced_when_its_own_training_has_ended(project: Project) -> None:
    with pytest.raises(Killed):
        trained.run(project, MORE, killed_at(16 + 3), at_once=1)
    assert steps_in_use(project.root) == [16, 12]
    trained.run(project, MORE, ignore_event, at_once=1)
    assert steps_in_use(project.root) == [16, 16]


def test_models_of_another_cut_are_put_to_use_together_when_all_are_trained(project: Project) -> None:
    old = [s.core for s in project.submaps("train")]
    submaps.run(project, SubmapConfig(count=3), ignore_event)
    assert steps_in_use(project.root) == [12, 12]
    with pytest.raises(InputError, match="another cut.*nvsim floors"):
        trained.run(project, MORE, ignore_event)
    floors.run(project, ignore_event)
    with pytest.raises(Killed):
        trained.run(project, MORE, killed_at(2 * 16 + 3), at_once=1)
    assert [s.core for s in project.submaps("train")] == old
    assert steps_in_use(project.root) == [12, 12]
    assert [bool(ledger.trained_key(project, s)) for s in range(3)] == [True, True, False]
    trained.run(project, MORE, ignore_event, at_once=1)
    assert steps_in_use(project.root) == [16, 16, 16] and project.submaps("train") == project.submaps()
    restore(project, "train")
    assert steps_in_use(project.root) == [12, 12] and [s.core for s in project.submaps("train")] == old


def test_a_cut_into_fewer_submaps_shows_no_model_of_the_former_one(project: Project) -> None:
    submaps.run(project, SubmapConfig(count=1), ignore_event)
    floors.run(project, ignore_event)
    trained.run(project, MORE, ignore_event)
    assert steps_in_use(project.root) == [16]
    submaps.run(project, SubmapConfig(count=2), ignore_event)
    assert steps_in_use(project.root) == [16]
    restore(project, "train")
    assert steps_in_use(project.root) == [12, 12]


def test_floors_that_are_found_again_are_in_use_when_all_are_found(project: Project) -> None:
    layout = project.layout
    before = {p.name: p.read_bytes() for p in [*layout.masks.iterdir(), *layout.floor.iterdir()]}
    submaps.run(project, SubmapConfig(count=3), ignore_event)
    with pytest.raises(Killed):
        floors.run(project, killed_at(3, "floors"))

    def now() -> dict[str, bytes]:
        layout = project.layout
        return {p.name: p.read_bytes() for p in [*layout.masks.iterdir(), *layout.floor.iterdir()]}

    assert now() == before and len(project.submaps("floors")) == 2
    floors.run(project, ignore_event)
    assert len(project.submaps("floors")) == 3 and project.surface(2) is not None and project.support() is not None
    restore(project, "floors")
    assert now() == before and len(project.submaps("floors")) == 2


def test_an_import_that_is_refused_or_cut_off_leaves_the_capture(project: Project, monkeypatch) -> None:
    source = project.need_capture().source
    before = project.need_capture()

    def no_disk(*_: object, **__: object) -> None:
        raise Killed

    monkeypatch.setattr(ledger, "finish", no_disk)
    with pytest.raises(Killed):
        imported.run(project, source, CaptureConfig(scale=2.0), ignore_event)
    monkeypatch.undo()
    assert project.need_capture() is before
    imported.run(project, source, CaptureConfig(scale=2.0), ignore_event)
    assert project.need_capture().alignment.scale == 2.0
    with pytest.raises(InputError, match="another capture.*nvsim submaps"):
        floors.run(project, ignore_event)
    assert steps_in_use(project.root) == [12, 12]  # where they were
    restore(project, "import")
    assert project.need_capture().alignment.scale == before.alignment.scale
    assert imported.capture_config(project) == CaptureConfig()
    trained.run(project, FEW, ignore_event)  # nothing is outdated any more


def test_the_models_keep_their_frames_when_the_capture_loses_some(project: Project) -> None:
    names = [frame.name for frame in project.need_capture().frames]
    before = {s.index: {names[f] for f in s.frames} for s in project.submaps("train")}
    mask = project.mask_path(9)
    config = CaptureConfig(leave_out=",".join(names[3:6]))
    imported.run(project, project.need_capture().source, config, ignore_event)
    left = [frame.name for frame in project.need_capture().frames]
    assert left == names[:3] + names[6:]
    found = project.submaps("train")
    assert {s.index: {left[f] for f in s.frames} for s in found} == {i: b - {*names[3:6]} for i, b in before.items()}
    positions = project.need_capture().positions
    assert all((positions[list(s.core)] == s.positions).all() for s in found)
    assert project.mask_path(6) == mask and mask.is_file()
    with pytest.raises(InputError, match="another capture.*nvsim submaps"):
        floors.run(project, ignore_event)
    imported.run(project, project.need_capture().source, CaptureConfig(leave_out=",".join(names[1:])), ignore_event)
    scene = project.scene()
    assert scene is not None and scene.indices == (0, 1), "models need no frame of the capture"
    imported.run(project, project.need_capture().source, config, ignore_event)
    restore(project, "import")
    imported.run(project, project.need_capture().source, CaptureConfig(), ignore_event)
    assert {s.index: {names[f] for f in s.frames} for s in project.submaps("train")} == before


def test_a_restored_stage_is_current_for_its_old_settings(project: Project) -> None:
    trained.run(project, MORE, ignore_event, at_once=1)
    assert "16 steps" in replaced_result_sentence(project, "train")
    assert "12 steps" in restore(project, "train")
    assert steps_in_use(project.root) == [12, 12]
    said: list[Event] = []
    trained.run(project, FEW, said.append, at_once=1)
    assert sum(isinstance(e, Log) and "trained already" in e.text for e in said) == 2
    restore(project, "train")
    assert steps_in_use(project.root) == [16, 16]


def test_a_restored_map_has_the_edits_that_it_had(project: Project) -> None:
    graph = project.need_graph()
    first = next(iter(graph.viewpoints.values()))
    x, y, z = first.position
    edited = move_viewpoint(graph, first.id, (x + 0.25, y, z))
    project.set_graph(edited)
    mapped.run(project, replace(QUICK, max_viewpoints=2), ignore_event)
    assert not same_graph(project.need_graph(), edited)
    restore(project, "map")
    assert same_graph(project.need_graph(), edited)


def test_at_most_one_result_of_a_stage_is_kept_and_it_can_be_let_go(project: Project) -> None:
    for steps in (14, 16, 18):
        trained.run(project, replace(FEW, steps=steps), ignore_event, at_once=1)
    folders = sorted(p.name for p in project.layout.models.iterdir())
    assert len(folders) == 4, folders
    (kept,) = kept_results(project)
    old = project.root / project.stage_results().results["previous", "train"].files["models/submap_000"]
    assert kept.stage == "train" and "16 steps" in kept.words
    assert kept.bytes >= sum(p.stat().st_size for p in old.iterdir())
    assert discard(project, "train") == kept.bytes
    assert len(list(project.layout.models.iterdir())) == 2 and steps_in_use(project.root) == [18, 18]
    with pytest.raises(InputError, match="keeps no earlier result of train"):
        restore(project, "train")


def test_what_is_replaced_is_said_before_it_is_begun(project: Project) -> None:
    said: list[Event] = []
    with pytest.raises(Killed):
        trained.run(project, MORE, lambda e: (said.append(e), killed_at(1)(e)), at_once=1)  # type: ignore[func-returns-value]
    words = replaced_result_sentence(project, "train")
    assert words.startswith("train replaces the models of 2 submaps (12 steps, finished 20")
    assert "the old ones stay until the new ones are finished" in words
    texts = [e.text for e in said if isinstance(e, Log)]
    first_step = next(i for i, e in enumerate(said) if isinstance(e, Progress) and e.done > 0)
    assert words in texts and next(i for i, e in enumerate(said) if getattr(e, "text", "") == words) < first_step
    assert "94" not in replaced_result_sentence(project, "map") and "viewpoint" in replaced_result_sentence(
        project, "map"
    )
    assert "floor masks of" in replaced_result_sentence(project, "floors")
    assert "the cut into 2 submaps" in replaced_result_sentence(project, "submaps")
    assert "the capture of" in replaced_result_sentence(project, "import")


def test_nothing_is_left_of_a_training_that_was_given_up_for_another(project: Project) -> None:
    with pytest.raises(Killed):
        trained.run(project, MORE, killed_at(5), at_once=1)
    assert "submap_000.ckpt" in left(project)
    trained.run(project, FEW, ignore_event, at_once=1)  # the settings of the models in use: nothing is to be done
    assert left(project) == []


def test_a_finished_training_leaves_no_checkpoint_whatever_killed_it_before(project: Project, monkeypatch) -> None:
    (project.layout.checkpoints).mkdir(exist_ok=True)
    (project.layout.checkpoints / "submap_007.ckpt").write_bytes(b"of a cut into more submaps")
    (project.layout.checkpoints / ".submap_000-x1y2.ckpt").write_bytes(b"half written when it was killed")
    (project.layout.checkpoints / "live_007").mkdir()

    def cut_off(*_: object, **__: object) -> None:
        raise Killed

    monkeypatch.setattr(results, "remove_unreferenced_files", cut_off)  # right after the model was committed
    with pytest.raises(Killed):
        trained.run(project, MORE, ignore_event, at_once=1)
    monkeypatch.undo()
    trained.run(project, MORE, ignore_event, at_once=1)
    assert left(project) == []


def test_a_live_model_that_vanishes_while_it_is_read_gives_way_to_the_finished_one(project: Project) -> None:
    layout = project.layout
    model = load_model(layout.model(0))
    shutil.rmtree(layout.model(0))
    save_model(replace(model, info={"steps": 3}), layout.live_model(0))
    scene = project.scene(live=True)
    assert scene is not None
    save_model(model, layout.model(0))
    results.remove_folder(layout.live_model(0))
    assert scene.model(0).info["steps"] == 12


def test_a_project_whose_places_lead_elsewhere_loses_nothing_there(project: Project, tmp_path: Path) -> None:
    (tmp_path / "precious").mkdir()
    with project.transaction() as c:
        c.execute("UPDATE stage_files SET place = '../precious' WHERE name = 'masks'")
        c.execute("UPDATE stage_files SET place = 'floor.1/../../precious' WHERE name = 'floor'")
    assert project.layout.masks == project.root / "masks" and project.layout.floor == project.root / "floor"
    results.remove_unreferenced_files(project.stage_results(), project.root)
    assert (tmp_path / "precious").is_dir() and project.layout.masks.is_dir()
