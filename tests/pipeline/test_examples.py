"""The scripts of `examples/` run on a small finished project."""

from __future__ import annotations

import json
import re
import runpy
import shutil
import sys
from pathlib import Path

import pytest
from PIL import Image

from nvsim.building import BuildingConfig, generate
from nvsim.events import ignore_event
from nvsim.mapping.config import MappingConfig
from nvsim.project.config import CaptureConfig
from nvsim.project.project import Project
from nvsim.project.stages import floors, imported, mapped, submaps, trained
from nvsim.submaps.split import SubmapConfig
from nvsim.training.config import TrainingConfig

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with small models of one submap and a graph of three viewpoints."""
    folder = tmp_path_factory.mktemp("examples")
    generate(folder / "building", BuildingConfig(size="small", width=96, height=72, step=1.0, turn=45.0, people=False))
    few = TrainingConfig(steps=12, image_size=48, gaussian_cap=600, threads=1)
    with Project.create_or_open(folder / "rooms.nvsim") as project:
        imported.run(project, folder / "building" / "capture", CaptureConfig(), ignore_event)
        submaps.run(project, SubmapConfig(count=1), ignore_event)
        floors.run(project, ignore_event)
        trained.run(project, few, ignore_event)
        mapped.run(project, MappingConfig(max_viewpoints=3, view_size=48), ignore_event)
    return folder / "rooms.nvsim"


@pytest.fixture
def project(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the project in the current folder, which is empty otherwise."""
    monkeypatch.chdir(tmp_path)
    return shutil.copytree(finished, tmp_path / "rooms.nvsim")


def run(monkeypatch: pytest.MonkeyPatch, name: str, *arguments: object) -> None:
    monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")


def test_render_view_writes_an_image_that_is_not_of_one_color(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run(monkeypatch, "render_view.py", project)
    with Image.open("view.png") as image:
        assert image.size == (640, 480)
        assert max(high - low for low, high in image.getextrema()) > 20


def test_rebuild_map_stores_a_graph_with_the_new_thresholds(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run(monkeypatch, "rebuild_map.py", project)
    from nvsim import mapping_config, open_project

    with open_project(project) as opened:
        config = mapping_config(opened)
    assert (config.robot_radius, config.tau_alpha, config.view_size) == (0.2, 0.9, 48)


def test_edit_graph_writes_a_graph_with_one_more_viewpoint(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from nvsim import load_graph

    run(monkeypatch, "edit_graph.py", project)
    edited = load_graph(Path("edited/rooms_connectivity.json"))
    before = load_graph(project)
    assert len(edited.viewpoints) == len(before.viewpoints) + 1
    assert len(edited.edges) == len(before.edges) + 1
    assert "Refused: " in capsys.readouterr().out


def test_simulate_scan_moves_through_the_exported_scan(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run(monkeypatch, "simulate_scan.py", project)
    entries = json.loads(Path("scans/connectivity/rooms_connectivity.json").read_text())
    visited = re.findall(r"Step (\d): viewpoint (\w+), image \(240, 320, 3\)", capsys.readouterr().out)
    assert [int(step) for step, _ in visited] == [0, 1, 2]
    assert {id for _, id in visited} <= {entry["image_id"] for entry in entries}
    assert len({id for _, id in visited}) > 1


def test_score_trajectory_prints_the_scores_of_an_agent_that_returns_to_its_start(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run(monkeypatch, "score_trajectory.py", project)
    printed = capsys.readouterr().out
    length, error = (float(re.search(rf"{what} +([\d.]+) m", printed)[1]) for what in ("length", "error"))
    assert length == pytest.approx(2 * error, abs=0.02)
    assert error > 0


def test_train_custom_preset_trains_the_first_submap(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run(monkeypatch, "train_custom_preset.py", project, 3)
    assert re.search(r"Submap 0: \d+ Gaussians after 3 steps\.", capsys.readouterr().out)


def test_every_example_is_short_and_has_a_test() -> None:
    tested = set(re.findall(r'"(\w+\.py)", project', Path(__file__).read_text()))
    assert tested == {path.name for path in EXAMPLES.glob("*.py")}
    assert max(len(path.read_text().splitlines()) for path in EXAMPLES.glob("*.py")) <= 40
