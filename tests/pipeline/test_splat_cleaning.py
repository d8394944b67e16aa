"""Floaters and Gaussians outside a made room are found, removed from maps and exports, and restored."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.graph.store import same_graph
from nvsim.mapping.config import MappingConfig
from nvsim.project import ledger
from nvsim.project.cleaning import read_whole_splat, removal_candidates, remove_gaussians
from nvsim.project.graph import recorded_config
from nvsim.project.outdated import outdated_stages
from nvsim.project.project import Project
from nvsim.project.stages import mapped
from nvsim.project.stages.mapped import for_splats, map_key
from nvsim.project.state.results import CONTENT, StageResult
from nvsim.splats.formats.choice import read_splats, write_splats
from nvsim.splats.types import Gaussians, joined
from tests.unit.splat_rooms import rectangle, stair_house, two_rooms

FOG, OUTSIDE = 60, 200
"""Numbers of Gaussians that are added after those of the room."""


def dirty_room() -> Gaussians:
    """Two rooms, then fog in the middle of the first one, then Gaussians 6 m outside."""
    random, room = np.random.default_rng(0), two_rooms()
    fog = Gaussians(*(a[:FOG].copy() for a in vars(room).values()))
    fog.means[:] = random.uniform([1.2, 0.8, 0.9], [3.2, 2.2, 1.8], (FOG, 3))
    fog.log_scales[:], fog.opacity_logits[:] = np.log(0.06), -1.0
    outside = rectangle((14, 1, 0.5), (0, 3, 0), (0, 0, 2))
    return joined(room, fog, Gaussians(*(a[:OUTSIDE] for a in vars(outside).values())))


def imported(folder: Path, *options: str) -> Path:
    write_splats(folder / "room.ply", dirty_room(), False, "ply")
    project = folder / "room.nvsim"
    words = ["import", str(folder / "room.ply"), "--project", str(project), "--scale", "1", "--up", "z", *options]
    assert main(words) == 0
    return project


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return imported(tmp_path_factory.mktemp("cleaning"))


def counts(project: Path) -> tuple[int, int]:
    """The number of Gaussians of the models in use, and of all Gaussians."""
    with Project.open(project) as opened:
        scene, whole = opened.scene(), read_whole_splat(opened)
    assert scene is not None
    return sum(len(scene.model(i).gaussians) for i in scene.indices), len(whole.removed)


def test_the_added_gaussians_are_the_candidates(project: Path) -> None:
    with Project.open(project) as opened:
        whole = read_whole_splat(opened)
        found = removal_candidates(opened, whole)
    room = len(whole.removed) - FOG - OUTSIDE
    floater, outside = found["floater"], found["outside"]
    assert not whole.removed.any() and not (floater & outside).any()
    assert floater[room : room + FOG].mean() > 0.8  # recall
    assert floater[room : room + FOG].sum() > 0.9 * floater.sum()  # precision
    np.testing.assert_array_equal(np.flatnonzero(outside), room + FOG + np.arange(OUTSIDE))


def test_removed_gaussians_are_absent_until_they_are_restored(project: Path, tmp_path: Path) -> None:
    export = ["export", "splats", "--project", str(project), "--frame", "capture", "--out"]
    assert main([*export, str(tmp_path / "before")]) == 0
    assert main(["splat", "clean", str(project), "--apply"]) == 0
    in_use, all_of_them = counts(project)
    assert in_use <= all_of_them - OUTSIDE - 0.8 * FOG
    assert main([*export, str(tmp_path / "clean")]) == 0
    cleaned = read_splats(tmp_path / "clean" / "submap_000.ply").gaussians
    assert len(cleaned) == in_use and cleaned.means[:, 0].max() < 9
    assert main(["splat", "clean", str(project), "--restore"]) == 0
    assert main([*export, str(tmp_path / "after")]) == 0
    name = "submap_000.ply"
    assert (tmp_path / "after" / name).read_bytes() == (tmp_path / "before" / name).read_bytes()
    assert not list((project / "imported").rglob("removed-*"))


def test_floors_and_map_are_stale_after_a_removal_and_current_after_the_restore(project: Path) -> None:
    def keys() -> tuple[bool, str]:
        with Project.open(project) as opened:
            return "floors" in opened.stage_results().finished_stages, map_key(opened, for_splats(MappingConfig()))

    assert main(["floors", "--project", str(project)]) == 0
    before = keys()
    with Project.open(project, writable=True) as opened:
        whole = read_whole_splat(opened)
        floors = ledger.record(opened, "floors")
        removed = np.zeros(len(whole.removed), bool)
        removed[-OUTSIDE:] = True
        remove_gaussians(opened, whole.rows, removed)
        assert map_key(opened, for_splats(MappingConfig())) != before[1]
    assert main(["floors", "--project", str(project)]) == 0
    with Project.open(project, writable=True) as opened:
        again = ledger.record(opened, "floors")
        assert floors is not None and again is not None and again.key != floors.key
        remove_gaussians(opened, whole.rows, whole.removed)
    assert main(["floors", "--project", str(project)]) == 0
    assert keys() == before


def outdated(project: Path) -> set[str]:
    with Project.open(project) as opened:
        return set(outdated_stages(opened))


def test_floors_and_map_are_outdated_while_they_belong_to_other_gaussians(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def warned(*words: str) -> bool:
        capsys.readouterr()
        assert main([*words]) == 0
        return "The splat has changed since the floor was found." in " ".join(capsys.readouterr().err.split())

    project = imported(tmp_path)
    here = ["--project", str(project)]
    assert main(["floors", *here]) == main(["map", *here]) == 0
    assert not outdated(project)
    for _ in range(2):  # removed, restored, removed again, restored again
        assert warned("splat", "clean", str(project), "--apply") and outdated(project) == {"floors", "map"}
        assert not warned("splat", "clean", str(project), "--restore") and not outdated(project)
    assert not warned("export", "r2r", *here, "--out", str(tmp_path / "graph"))
    assert main(["splat", "clean", str(project), "--apply"]) == 0
    assert warned("export", "r2r", *here, "--out", str(tmp_path / "graph"))
    assert warned("graph", "check", str(project))
    with Project.open(project) as opened:
        before = opened.need_graph()
    assert main(["floors", *here]) == 0 and outdated(project) == {"map"}
    assert main(["map", *here]) == 0 and not outdated(project)
    with Project.open(project) as opened:
        assert not same_graph(opened.need_graph(), before)
    assert warned("splat", "clean", str(project), "--restore") and outdated(project) == {"floors", "map"}
    assert main(["restore", "floors", *here]) == 0 and outdated(project) == {"map"}
    assert "the known floor of 1 storey" in capsys.readouterr().err
    assert main(["restore", "map", *here]) == 0 and not outdated(project)
    with Project.open(project) as opened:
        assert same_graph(opened.need_graph(), before)
    assert warned("splat", "clean", str(project), "--apply")
    assert main(["restore", "floors", *here]) == main(["restore", "map", *here]) == 0 and not outdated(project)


def test_results_of_earlier_versions_are_outdated_if_their_stage_would_run_again(tmp_path: Path) -> None:
    project = imported(tmp_path)
    assert main(["floors", "--project", str(project)]) == 0
    with Project.open(project, writable=True) as opened:
        key = map_key(opened, config := for_splats(MappingConfig()))
        ledger.begin_part(opened, "map", key)
        ledger.finish(opened, "map", 1.0, recorded_config(config))
        found = opened.stage_results()
        for stage in ("floors", "map"):  # earlier versions did not record the content
            part = ledger.record(opened, stage)
            assert part is not None
            figures = {name: value for name, value in part.summary.items() if name != CONTENT}
            found = found.with_result("in use", stage, StageResult({0: replace(part, figures=json.dumps(figures))}))
        opened.set_stage_results(found)
    assert not outdated(project)
    assert main(["splat", "clean", str(project), "--apply"]) == 0 and outdated(project) == {"floors", "map"}
    assert main(["splat", "clean", str(project), "--restore"]) == 0 and not outdated(project)


def test_a_map_of_a_floor_of_other_gaussians_warns(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(mapped, "run", lambda *_: None)
    here = ["--project", str(project)]
    assert main(["floors", *here]) == main(["map", *here]) == 0
    assert "has changed" not in capsys.readouterr().err
    with Project.open(project, writable=True) as opened:
        whole = read_whole_splat(opened)
        remove_gaussians(opened, whole.rows, np.arange(len(whole.removed)) == 0)
    assert main(["map", *here]) == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "since the floor was found. `nvsim floors --project` computes the results again." in told
    with Project.open(project, writable=True) as opened:
        remove_gaussians(opened, whole.rows, whole.removed)


def test_the_removal_of_an_import_can_be_undone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    project = imported(tmp_path, "--clean")
    in_use, all_of_them = counts(project)
    assert in_use < all_of_them == len(dirty_room())
    capsys.readouterr()
    assert main(["splat", "clean", str(project), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["removed"] == all_of_them - in_use and found["outside"] == 0
    assert main(["splat", "clean", str(project), "--restore"]) == 0
    assert counts(project) == (all_of_them, all_of_them)


def test_a_gaussian_of_two_submaps_is_removed_from_both(tmp_path: Path) -> None:
    write_splats(tmp_path / "house.ply", stair_house(), False, "ply")
    house = tmp_path / "house.nvsim"
    assert main(["import", str(tmp_path / "house.ply"), "--project", str(house), "--scale", "1"]) == 0
    with Project.open(house, writable=True) as opened:
        whole = read_whole_splat(opened)
        assert len(whole.models) == 3
        shared = np.bincount(np.concatenate(list(whole.rows.values()))) > 1
        assert shared.any() and len(whole.removed) == len(stair_house())
        for index, model in whole.models.items():
            np.testing.assert_array_equal(whole.model.gaussians.means[whole.rows[index]], model.gaussians.means)
        remove_gaussians(opened, whole.rows, shared)
        scene = opened.scene()
        assert scene is not None
        assert sum(len(scene.model(i).gaussians) for i in scene.indices) == (~shared).sum()
        np.testing.assert_array_equal(read_whole_splat(opened).removed, shared)


def test_what_cannot_be_removed_is_refused(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Project.open(project, writable=True) as opened:
        whole = read_whole_splat(opened)
        with pytest.raises(InputError, match="All Gaussians"):
            remove_gaussians(opened, whole.rows, np.ones(len(whole.removed), bool))
    assert main(["splat", "clean", str(project), "--apply", "--restore"]) == 2
    assert "one of them" in capsys.readouterr().err
