"""Submaps trained side by side: the same models, one stream of events, and nothing outlives the parent."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import psutil
import pytest

from nvsim.building import BuildingConfig, generate
from nvsim.cluster.config import ClusterConfig
from nvsim.cluster.executor_choice import open_executor
from nvsim.cluster.storage import StorageProbe
from nvsim.depth.config import DepthConfig
from nvsim.errors import InputError
from nvsim.events import Event, Log, Metric, Progress, Worker, ignore_event
from nvsim.project import ledger
from nvsim.project.config import CaptureConfig
from nvsim.project.project import Project
from nvsim.project.stages import depths, floors, imported, submaps, trained
from nvsim.project.stages.submap_training import train
from nvsim.project.stages.training_pool import plan
from nvsim.splats.files import load_model
from nvsim.submaps.split import SubmapConfig
from nvsim.training.config import TrainingConfig

QUICK = TrainingConfig(steps=6, image_size=64, gaussian_cap=1500)


@pytest.fixture(scope="module")
def project_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pool") / "rooms.nvsim"
    with Project.create_or_open(path) as project:
        building = BuildingConfig(size="small", width=160, height=120, step=0.8, turn=30.0, people=False)
        generate(project.layout.root, building, ignore_event)
        imported.run(project, project.layout.built_in_capture, CaptureConfig(), ignore_event)
        submaps.run(project, SubmapConfig(count=3), ignore_event)
        floors.run(project, ignore_event)
    return path


def test_two_at_once_give_the_models_that_one_process_gives(project_path: Path) -> None:
    events: list[Event] = []
    with Project.open(project_path, writable=True) as project:
        trained.run(project, QUICK, events.append, at_once=2)
        assert all(ledger.record(project, "train", i) is not None for i in range(3))
        for task in plan([0, 1, 2], psutil.cpu_count() or 1, 2)[1:]:
            together = load_model(project.layout.model(task.submap)).gaussians
            train(project, task.submap, replace(QUICK, threads=task.threads), ignore_event)
            alone = load_model(project.layout.model(task.submap)).gaussians
            np.testing.assert_array_equal(together.means, alone.means)
            np.testing.assert_array_equal(together.sh, alone.sh)
            project.layout.checkpoint(task.submap).unlink()
    shares = [e.done / e.total for e in events if isinstance(e, Progress) and e.stage == "train"]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_what_is_trained_stays_trained_at_any_number_at_once(project_path: Path) -> None:
    events: list[Event] = []
    with Project.open(project_path, writable=True) as project:
        trained.run(project, replace(QUICK, threads=1), events.append, at_once=2)
    assert [e.text for e in events if isinstance(e, Log)] == [f"Submap {i} is trained already." for i in range(3)]


def test_a_mistake_in_a_child_is_the_parents_sentence(project_path: Path) -> None:
    before = psutil.Process().children(recursive=True)
    with Project.open(project_path, writable=True) as project:
        project.layout.surface(1).rename(project.layout.surface(1).with_suffix(".away"))
        try:
            with pytest.raises(InputError, match="run `nvsim floors"):
                trained.run(project, replace(QUICK, steps=7), ignore_event, at_once=2)
        finally:
            project.layout.surface(1).with_suffix(".away").rename(project.layout.surface(1))
    for child in set(psutil.Process().children(recursive=True)) - set(before):
        with contextlib.suppress(psutil.Error):  # one that ends while it is looked at
            assert "spawn_main" not in " ".join(child.cmdline())


def test_children_of_a_killed_parent_end(project_path: Path) -> None:
    argv = [sys.executable, "-m", "nvsim", "train", "--project", str(project_path), "--json", "--at-once", "2",
            "--steps", "100000", "--image-size", "64", "--gaussian-cap", "1500"]  # fmt: skip
    parent = subprocess.Popen(argv, stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    for line in parent.stdout:
        if '"progress"' in line:
            break
    children = psutil.Process(parent.pid).children(recursive=True)
    assert children
    parent.kill()
    parent.wait()
    _, alive = psutil.wait_procs(children, timeout=5)
    assert not alive


def test_an_impossible_number_at_once_is_refused(project_path: Path) -> None:
    with Project.open(project_path, writable=True) as project, pytest.raises(InputError, match="--at-once -1"):
        trained.run(project, QUICK, ignore_event, at_once=-1)


def test_a_cluster_gives_the_models_that_this_machine_gives_although_a_worker_is_killed(
    project_path: Path, ray_head: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = replace(QUICK, threads=1, steps=60, checkpoint_seconds=0.0)
    killed, heard = 0, []

    def listen(event: Event) -> None:
        nonlocal killed
        heard.append(event)
        begun = [e for e in heard if isinstance(e, Worker)]
        if not killed and isinstance(event, Metric) and event.submap == begun[0].part:
            killed = int(begun[0].name.split()[-1])
            psutil.Process(killed).kill()

    with (
        Project.open(project_path, writable=True) as project,
        open_executor(ClusterConfig("ray", ray_head)) as executor,
    ):
        trained.run(project, config, listen, executor=executor)
        assert any(isinstance(e, Worker) and e.state == "lost" for e in heard)
        _hold_against_this_machine(project, config, [0, 1, 2])
        config = replace(config, steps=50)
        monkeypatch.setattr(StorageProbe, "create_in", lambda *_: StorageProbe(Path("/nowhere at all"), "a word"))
        heard.clear()
        trained.run(project, config, heard.append, only=(2,), executor=executor)
        assert any(isinstance(e, Log) and "sends the inputs" in e.text for e in heard)
        _hold_against_this_machine(project, config, [2])


def _hold_against_this_machine(project: Project, config: TrainingConfig, submaps: list[int]) -> None:
    assert not list(project.layout.checkpoints.iterdir())
    for submap in submaps:
        assert project.layout.preview(submap).is_file()
        afar = load_model(project.layout.model(submap)).gaussians
        train(project, submap, config, ignore_event)
        here = load_model(project.layout.model(submap)).gaussians
        np.testing.assert_array_equal(afar.means, here.means)
        np.testing.assert_array_equal(afar.sh, here.sh)
        project.layout.checkpoint(submap).unlink()


def test_a_cluster_finds_the_floors_and_the_depth_that_this_machine_finds(
    project_path: Path, ray_head: str, tmp_path: Path
) -> None:
    depth = DepthConfig(longest_side=48, planes=16)
    found, heard = [], []
    with open_executor(ClusterConfig("ray", ray_head)) as cluster:
        for executor in (None, cluster):
            path = tmp_path / str(executor is None)
            shutil.copytree(project_path, path)
            with Project.open(path, writable=True) as project:
                shutil.rmtree(project.layout.masks)
                floors.run(project, heard.append, executor=executor)
                depths.run(project, "always", depth, heard.append, executor=executor)
                files = [*project.layout.masks.iterdir(), *project.layout.depth.iterdir()]
                pictures = [f for f in files if f.suffix == ".png"]
                found.append({f"{f.parent.name}/{f.name}": cv2.imread(str(f), cv2.IMREAD_UNCHANGED) for f in pictures})
    assert len(found[0]) > 90
    assert found[0].keys() == found[1].keys()
    for name, expected in found[0].items():
        # Kernels that this process compiled may round otherwise than those that a worker read.
        assert np.mean(found[1][name] != expected) < 0.01
    assert {e.stage for e in heard if isinstance(e, Worker)} == {"floors", "depth"}
