"""Occupancy maps built from projects: their files, their origin, and which of them may evaluate a graph."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from measured_room import poses, truth, write_kapture

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.events import Event, Warning, ignore_event
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.occupancy.read import read_map
from nvsim.occupancy.ros import Provenance, Source, read_provenance, write_ros_map
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap, compare_maps
from nvsim.project.config import CaptureConfig
from nvsim.project.jobs.joblist import JobList
from nvsim.project.occupancy_maps import built_map, occupancy_of, refuse_own_depth, source_digests
from nvsim.project.occupancy_sources import find_capture_with_ranges, find_rays
from nvsim.project.project import Project
from nvsim.project.stages import imported


def with_graph(project: Project) -> None:
    places = {"a": (-2.0, -2.0, 1.3), "b": (-2.0, 2.0, 1.3), "c": (2.0, -2.0, 1.3), "inside": (0.9, -0.2, 1.3)}
    viewpoints = {id: Viewpoint(id, place) for id, place in places.items()}
    edges = {tuple(sorted(pair)): edge(*pair) for pair in (("a", "b"), ("a", "c"), ("b", "c"))}
    project.set_graph(NavGraph("room", viewpoints, edges))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def imported_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("measured")
    write_kapture(folder / "walk", poses(16))
    with Project.create_or_open(folder / "room.nvsim") as made:
        imported.run(made, folder / "walk", CaptureConfig(), ignore_event)
        with_graph(made)
    return folder


@pytest.fixture
def folder(imported_once: Path, tmp_path: Path) -> Path:
    """A folder with a project; its capture lies where it was imported from."""
    shutil.copytree(imported_once / "room.nvsim", tmp_path / "room.nvsim")
    return tmp_path


def said(source: Source, makers: tuple[str, ...]) -> Provenance:
    return Provenance(source, "", 0.1, 1.5, makers)


def test_a_map_built_in_a_project_is_its_map_and_judges_its_graph(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = folder / "room.nvsim"
    with Project.open(root) as project:
        assert occupancy_of(project) is None and not project.may_have_occupancy
    assert main(["evaluate", "graph", "--project", str(root)]) == 2
    assert "nvsim occupancy build" in capsys.readouterr().err
    assert main(["occupancy", "build", "--project", str(root), "--json"]) == 0
    done = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert done["event"] == "done" and done["results"]["source"] == "lidar"
    with Project.open(root) as project:
        found = occupancy_of(project)
        assert found is not None and project.may_have_occupancy
        assert JobList(root).jobs()[-1].order.verb == "occupancy build"
    figures = compare_maps(found, truth())
    assert figures["occupied_found_free"] == 0 and figures["free_found_free"] > 0.98
    assert done["results"]["free_m2"] == pytest.approx((found.cells == FREE).sum() * 0.05**2, abs=0.01)
    assert main(["evaluate", "graph", "--project", str(root), "--json"]) == 0
    judged = json.loads(capsys.readouterr().out)
    assert (judged["node_validity"], judged["edge_validity"]) == (0.75, pytest.approx(2 / 3, abs=1e-4))


def test_a_map_outside_the_project_needs_no_writer(folder: Path) -> None:
    root, out = folder / "room.nvsim", folder / "maps" / "room.yaml"
    with Project.open(root, writable=True):  # as a job that runs
        assert main(["occupancy", "build", "--project", str(root), "--out", str(out)]) == 0
        assert main(["occupancy", "build", "--project", str(root)]) == 2
    found = read_provenance(out)
    assert found is not None and found.source == "lidar" and "16 LiDAR scans" in found.note
    with Project.open(root) as project:
        assert found.makers == source_digests(project.need_capture(), project) and built_map(project) is None


def test_a_map_of_the_projects_own_models_is_refused_and_others_are_not(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root, out = folder / "room.nvsim", folder / "map.yaml"
    with Project.open(root) as project:
        trajectory, place = source_digests(project.need_capture(), project)
    for makers in ((trajectory, place), (trajectory,), ("another trajectory", place)):
        write_ros_map(truth(), out, said("trained", makers))
        assert main(["evaluate", "graph", "--project", str(root), "--occupancy", str(out)]) == 2
        words = capsys.readouterr().err
        assert words.count("\n") == 1 and "own models, so it cannot evaluate them" in words
    for provenance in (said("trained", ("x", "y")), said("images", (trajectory, place)), None):
        write_ros_map(truth(), out, provenance)
        assert main(["evaluate", "graph", "--project", str(root), "--occupancy", str(out), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["node_validity"] == 0.75


def test_a_map_of_another_capture_or_of_models_is_not_the_projects(folder: Path) -> None:
    with Project.open(folder / "room.nvsim") as project:
        makers = source_digests(project.need_capture(), project)
        for provenance in (None, said("lidar", ("another",)), said("trained", makers)):
            write_ros_map(truth(), project.layout.occupancy, provenance)
            assert occupancy_of(project) is None
        write_ros_map(truth(), project.layout.occupancy, said("depth", makers[:1]))
        assert occupancy_of(project) is not None


def test_the_same_walk_in_another_project_is_known(folder: Path, imported_once: Path) -> None:
    with Project.create_or_open(folder / "again.nvsim") as again:
        imported.run(again, imported_once / "walk", CaptureConfig(), ignore_event)
        with Project.open(folder / "room.nvsim") as project:
            ours, theirs = (source_digests(p.need_capture(), p) for p in (project, again))
            write_ros_map(truth(), folder / "map.yaml", said("trained", theirs))
            assert ours[0] == theirs[0] and ours[1] != theirs[1]
            with pytest.raises(InputError):
                refuse_own_depth(folder / "map.yaml", project)


def test_a_project_whose_capture_is_gone_casts_from_its_cloud(tmp_path: Path) -> None:
    write_kapture(tmp_path / "walk", poses(12))
    heard: list[Event] = []
    with Project.create_or_open(tmp_path / "room.nvsim") as project:
        imported.run(project, tmp_path / "walk", CaptureConfig(), ignore_event)
        there = find_rays(find_capture_with_ranges(project, heard.append), project)
        assert there.cloud is None and there.count == 12 and not heard
        (tmp_path / "walk").rename(tmp_path / "away")
        rays = find_rays(find_capture_with_ranges(project, heard.append), project)
    assert rays.cloud is not None and "nearest cameras" in rays.note
    assert [type(event) for event in heard] == [Warning]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "either CAPTURE or --project"),
        (["walk", "--project", "room.nvsim"], "either CAPTURE or --project"),
        (["walk"], "--out NAME.yaml"),
        (["walk", "--out", "map.pgm"], "ends in .yaml"),
        (["--project", "room.nvsim", "--source", "trained"], "--out NAME.yaml"),
        (["--project", "room.nvsim", "--source", "trained", "--out", "map.yaml"], "nvsim train"),
        (["--project", "room.nvsim", "--source", "images"], "nvsim depth"),
        (["--project", "room.nvsim", "--scale", "2"], "drop --scale"),
        (["--project", "room.nvsim", "--resolution", "0"], "--resolution"),
        (["--project", "room.nvsim", "--from-height", "2"], "--from-height"),
        (["--project", "room.nvsim", "--reach", "-1"], "--reach"),
        (["--project", "nowhere.nvsim"], "does not exist"),
        (["nowhere", "--out", "map.yaml"], "does not exist"),
    ],
)
def test_a_wrong_order_ends_in_one_sentence_and_writes_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str], sentence: str
) -> None:
    monkeypatch.chdir(folder)
    before = {path for path in folder.rglob("*") if "database" not in path.name and "db" not in path.name}
    assert main(["occupancy", "build", *words]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert sentence in last and "a bug in NVSim" not in last
    after = {path for path in folder.rglob("*") if "database" not in path.name and "db" not in path.name}
    made = [path for path in after - before if "logs" not in path.parts]  # the job of the command
    assert {path.suffix for path in made} <= {"", ".writer"}


def test_maps_are_compared_cell_by_cell(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    true = np.array([[FREE, FREE, FREE, FREE], [OCCUPIED, OCCUPIED, UNKNOWN, UNKNOWN]])
    found = np.array([[FREE, FREE, FREE, OCCUPIED], [FREE, UNKNOWN, FREE, OCCUPIED]])
    for name, cells in (("true", true), ("found", found)):
        write_ros_map(OccupancyMap(cells, 0.5, (1.0, 2.0)), tmp_path / f"{name}.yaml")
    assert main(["occupancy", "compare", str(tmp_path / "found.yaml"), str(tmp_path / "true.yaml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "free_found_free": 0.75,
        "free_found_occupied": 0.25,
        "free_found_unknown": 0.0,
        "free_cells": 4,
        "occupied_found_free": 0.5,
        "occupied_found_occupied": 0.0,
        "occupied_found_unknown": 0.5,
        "occupied_cells": 2,
        "beside_m2": 0.25,
    }
    assert (
        compare_maps(read_map(tmp_path / "true.yaml"), OccupancyMap(found[:1, :3], 0.5, (1.0, 2.0)))[
            "occupied_found_free"
        ]
        is None
    )
