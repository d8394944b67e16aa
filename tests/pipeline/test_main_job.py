"""The main job on two rooms, from the command line, as a person runs it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from nvsim.building import BuildingConfig, generate
from nvsim.project.project import Project

STEPS = "150"


def nvsim(*argv):
    return subprocess.run([sys.executable, "-m", "nvsim", *map(str, argv)], capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    root = tmp_path_factory.mktemp("demo") / "rooms.nvsim"
    result = nvsim("demo", "--small", "--no-window", "--project", root, "--train.steps", STEPS)
    assert result.returncode == 0, result.stderr
    assert "nvsim app --project" in result.stdout and "Valid edges" in result.stdout
    return root


def figures(*argv):
    result = nvsim(*argv, "--json")
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout.splitlines()[-1])


def test_the_graph_is_valid_and_covers_the_rooms(demo):
    got = figures("evaluate", "graph", "--project", demo, "--picture", demo.parent / "graph.png")
    assert got["nodes"] >= 4
    assert got["node_validity"] >= 0.9
    assert got["edge_validity"] >= 0.9
    assert got["coverage"] >= 0.6
    assert (demo.parent / "graph.png").stat().st_size > 1000


def test_the_floor_masks_meet_the_truth(demo):
    assert figures("evaluate", "floor", "--project", demo)["miou"] >= 0.9


def test_held_out_frames_look_right_and_alpha_separates_floor_from_the_rest(demo):
    got = figures("evaluate", "views", "--project", demo, "--pictures", demo.parent / "views")
    assert got["psnr_nonfloor"] > 18
    assert got["psnr_floor"] > 18
    assert got["alpha_floor"] < 0.2
    assert got["alpha_nonfloor"] > 0.8


def test_the_export_loads_as_agents_load_it(demo):
    out = demo.parent / "connectivity"
    result = nvsim("export", "r2r", "--project", demo, "--out", out)
    assert result.returncode == 0, result.stderr
    scan, stub = (out / "scans.txt").read_text().split()
    assert stub == "ZMojNkEp431"
    entries = json.loads((out / f"{scan}_connectivity.json").read_text())
    with Project.open(demo) as project:
        assert len(entries) == len(project.need_graph().viewpoints)
    for i, entry in enumerate(entries):
        for j, other in enumerate(entries):
            assert entry["unobstructed"][j] == other["unobstructed"][i]
        assert not entry["unobstructed"][i]


def test_a_second_run_finds_everything_up_to_date(demo):
    result = nvsim("run", demo / "capture", "--project", demo, "--train.steps", STEPS)
    assert result.returncode == 0, result.stderr
    for words in ("capture is unchanged", "submaps are up to date", "masks are up to date", "graph is up to date"):
        assert words in result.stderr


def test_a_killed_run_resumes_and_ends_with_the_same_graph(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
    import kill_and_resume

    building = BuildingConfig(size="small", width=160, height=120, step=0.8, turn=30.0, people=False)
    generate(tmp_path / "building", building)
    result = kill_and_resume.measure(tmp_path / "building" / "capture", tmp_path, kills=2, seed=5, steps=60)
    # On a machine that is busy at times, a moment that was drawn may lie behind the end of the run.
    assert result["killed_in"] and result["nodes"] > 2, result
    assert result["same_graph"], result
