"""The two generations of Matterport3DSimulator's interface, its defaults and its refusals."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from nvsim.benchmarks.simulator import write_made_scan
from nvsim.errors import InputError
from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.r2r.simulator import Simulator, cbf
from nvsim.r2r.simulator.scan import OneScan, level_scan


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    folder = tmp_path_factory.mktemp("made")
    return folder, write_made_scan(folder, count=10, side=64)


def opened(folder: Path, images: bool = False) -> Simulator:
    sim = Simulator()
    sim.setNavGraphPath(str(folder / "connectivity"))
    sim.setDatasetPath(str(folder / "scans"))
    sim.setRenderingEnabled(images)
    return sim


def test_v0_1_gives_one_state_with_a_point(made: tuple[Path, list[str]]) -> None:
    folder, ids = made
    sim = opened(folder)
    sim.init()
    sim.newEpisode("made", ids[0], 0, 0)
    state = sim.getState()
    assert state.location.viewpointId == ids[0]
    assert state.location.point == [state.location.x, state.location.y, state.location.z]
    sim.makeAction(0, 1.0, 0.0)
    assert sim.getState().heading == pytest.approx(1.0) and sim.getState().step == 1
    sim.newEpisode("made", "", 0, 0)
    assert sim.getState().location.viewpointId in ids


def test_scans_that_are_given_are_walked_as_those_of_a_file(tmp_path: Path) -> None:
    noise = np.random.default_rng(4)
    ids = [f"v{k}" for k in range(9)]
    viewpoints = {id: Viewpoint(id, tuple(noise.uniform(-4, 4, 3).tolist()), included=id != "v3") for id in ids}
    pairs = [(a, b) for a in ids for b in ids if a < b and noise.random() < 0.6]
    graph = NavGraph("given", viewpoints, {pair: edge(*pair) for pair in pairs})
    write_connectivity(graph, tmp_path)
    positions = np.array([v.position for v in viewpoints.values()])
    edges = np.array([(ids.index(a), ids.index(b)) for a, b in pairs])
    scan = level_scan("given", ids, np.array([id != "v3" for id in ids]), positions, edges)
    sims = Simulator(OneScan(scan)), Simulator()
    sims[1].setNavGraphPath(tmp_path)
    for sim in sims:
        sim.setRenderingEnabled(False)
        sim.newEpisode("given", "v0", 0.3, 0.1)
    for _ in range(60):
        states = [sim.getState() for sim in sims]
        told = [
            [(p.viewpointId, p.ix, p.rel_heading, p.rel_elevation, p.rel_distance) for p in s.navigableLocations]
            for s in states
        ]
        assert told[0] == told[1] and states[0].location.point == states[1].location.point
        action = int(noise.integers(len(told[0]))), float(noise.normal()), 0.0
        for sim in sims:
            sim.makeAction(*action)
    with pytest.raises(IndexError, match="other"):
        sims[0].newEpisode("other", "v0", 0, 0)


def test_the_batched_interface_gives_lists(made: tuple[Path, list[str]]) -> None:
    folder, ids = made
    sim = opened(folder)
    sim.setBatchSize(2)
    sim.initialize()
    assert [s.scanId for s in sim.getState()] == ["", ""]
    sim.newEpisode(["made"] * 2, ids[:2], [0.5, -0.5], [0, 2])
    a, b = sim.getState()
    assert (a.heading, b.elevation) == (0.5, 0.94)
    assert b.heading == pytest.approx(2 * np.pi - 0.5)
    sim.makeAction(np.array([0, 0]), np.array([1.0, 0.0]), [0, 0])
    assert a.heading == 1.5  # a state goes on with its environment
    with pytest.raises(TypeError, match="lists"):
        sim.newEpisode("made", ids[0], 0, 0)


def test_defaults_are_the_originals(made: tuple[Path, list[str]]) -> None:
    folder, ids = made
    sim = opened(folder)
    assert (sim.width, sim.height, sim.vfov, sim.lowest, sim.highest) == (320, 240, 0.8, -0.94, 0.94)
    assert sim.rendering_enabled is False and sim.restricted and not sim.discrete and not sim.depth_enabled
    assert (sim.batch_size, sim.cache_size, sim.seed) == (1, 200, 1)
    assert not sim.setElevationLimits(0.1, 0.5) and not sim.setElevationLimits(-1.6, 0.5)
    assert sim.setElevationLimits(-0.2, 0.3)
    sim.newEpisode("made", ids[0], 0, -1)
    assert sim.getState().elevation == -0.2
    sim.setDiscretizedViewingAngles(True)  # too late
    sim.makeAction(0, 0.1, 0)
    assert sim.getState().heading == pytest.approx(0.1)
    assert sim.getState().rgb.shape == (240, 320, 3) and not sim.getState().rgb.any()
    assert sim.getState().depth.shape == (240, 320, 1) and sim.getState().depth.dtype == np.uint16
    assert "Rendered 0 frames" in sim.timingInfo()


def refusals(folder: Path, ids: list[str]) -> list[tuple[type[Exception], str, tuple[object, ...]]]:
    excluded = next(
        e["image_id"]
        for e in json.loads((folder / "connectivity/made_connectivity.json").read_text())
        if not e["included"]
    )
    return [
        (IndexError, "no scan 'nowhere'", (["nowhere"], [ids[0]], [0], [0])),
        (ValueError, "Could not find viewpointId: nobody", (["made"], ["nobody"], [0], [0])),
        (ValueError, f"{excluded}, is excluded from the connectivity graph", (["made"], [excluded], [0], [0])),
        (IndexError, "heading has 0 values", (["made"], [ids[0]], [], [0])),
        (TypeError, "scanId contains 3", ([3], [ids[0]], [0], [0])),
        (TypeError, "heading is", (["made"], [ids[0]], ["north"], [0])),
        (ValueError, "finite radians", (["made"], [ids[0]], [float("nan")], [0])),
    ]


def test_an_episode_that_is_refused_says_why_and_changes_nothing(tmp_path: Path) -> None:
    ids = write_made_scan(tmp_path, count=40)
    sim = opened(tmp_path)
    sim.newEpisode(["made"], [ids[1]], [1.0], [0])
    for kind, words, call in refusals(tmp_path, ids):
        with pytest.raises(kind, match=words) as caught:
            sim.newEpisode(*call)  # type: ignore[arg-type]
        assert isinstance(caught.value, InputError) and "\n" not in str(caught.value)
        assert sim.getState()[0].location.viewpointId == ids[1]


def test_actions_before_an_episode_and_beyond_the_locations_are_refused(made: tuple[Path, list[str]]) -> None:
    folder, ids = made
    sim = opened(folder)
    with pytest.raises(RuntimeError, match="newEpisode must be called before makeAction"):
        sim.makeAction([0], [0], [0])
    sim.initialize()
    with pytest.raises(ValueError, match="Invalid action index: 0 in environment 0 of 1"):
        sim.makeAction([0], [0], [0])
    sim.newEpisode(["made"], [ids[0]], [0], [0])
    with pytest.raises(ValueError, match="Invalid action index: 99 in environment 0 of 1"):
        sim.makeAction([99], [0], [0])
    with pytest.raises(TypeError, match="whole numbers from 0"):
        sim.makeAction([-1], [0], [0])
    with pytest.raises(TypeError, match="one number for each"):
        sim.makeAction([0.5], [0], [0])
    assert sim.getState()[0].step == 0


def test_graphs_that_make_no_sense_are_refused_with_the_entry(tmp_path: Path) -> None:
    ids = write_made_scan(tmp_path, count=5, plain=True)
    path = tmp_path / "connectivity" / "made_connectivity.json"
    good = json.loads(path.read_text())
    damages = [
        ([{**good[0], "unobstructed": [True]}, *good[1:]], "entry 0: unobstructed has 1 values"),
        ([{**good[0], "pose": [*good[0]["pose"], 1]}, *good[1:]], "entry 0: pose has 17 values"),
        ([{**good[0], "pose": [0] * 16}, *good[1:]], "are not a rotation"),
        ([{**good[0], "image_id": "../../x"}, *good[1:]], "must be a name without slash"),
        ({"a": 1}, "not a list of viewpoints"),
    ]
    for damaged, words in damages:
        path.write_text(json.dumps(damaged))
        with pytest.raises(ValueError, match=words):
            opened(tmp_path).newEpisode("made", ids[0], 0, 0)
    path.unlink()
    with pytest.raises(ValueError, match="Could not open navigation graph file"):
        opened(tmp_path).newEpisode("made", ids[0], 0, 0)
    (tmp_path / "connectivity" / "scans.txt").unlink()
    with pytest.raises(ValueError, match="Could not open list of scans"):
        opened(tmp_path).newEpisode("made", ids[0], 0, 0)


def test_after_close_it_can_be_set_up_again(made: tuple[Path, list[str]]) -> None:
    folder, ids = made
    sim = opened(folder)
    sim.newEpisode("made", ids[0], 0, 0)
    sim.close()
    sim.setBatchSize(2)
    sim.newEpisode(["made"] * 2, ids[:2], [0, 0], [0, 0])
    assert len(sim.getState()) == 2


def test_simulators_of_several_threads_do_not_disturb_each_other(made: tuple[Path, list[str]]) -> None:
    folder, ids = made
    shared, wrong = opened(folder, images=True), []

    def go(number: int) -> None:
        sim = opened(folder, images=True)
        for k in range(20):
            id = ids[(number + k) % len(ids)]
            sim.newEpisode("made", id, 0.1 * k, 0)
            shared.newEpisode("made", id, 0, 0)
            wrong.extend([id] if sim.getState().location.viewpointId != id else [])

    threads = [threading.Thread(target=go, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong and shared.getState().step == 0


def test_neither_torch_nor_qt_is_imported_for_skyboxes(made: tuple[Path, list[str]]) -> None:
    folder, ids = made
    code = (
        "import sys; from nvsim.r2r.simulator import Simulator; s = Simulator(); "
        f"s.setNavGraphPath({str(folder / 'connectivity')!r}); s.setDatasetPath({str(folder / 'scans')!r}); "
        f"s.newEpisode(['made'], [{ids[0]!r}], [0], [0]); assert s.getState()[0].rgb.any(); "
        "print([m for m in ('torch', 'PySide6', 'sklearn', 'gymnasium') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout.strip() == "[]", done.stderr


def test_the_example_of_the_page_runs_as_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = Path(__file__).parents[2] / "resources" / "docs" / "simulator.md"
    example = re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)[0]
    ids = write_made_scan(tmp_path, "house", count=30, side=32, plain=True)
    monkeypatch.chdir(tmp_path)
    probe = opened(tmp_path)
    seeing = []
    for id in ids:
        probe.newEpisode("house", id, 0.0, 0.0)
        seeing += [id] if len(probe.getState().navigableLocations) > 1 else []
    names = {"first": seeing[0], "second": ids[1]}
    exec(compile(example, "simulator.md", "exec"), names)
    assert capsys.readouterr().out.count("(480, 640, 3)") == 2


def test_the_filter_fills_a_hole_from_its_own_side_of_an_edge() -> None:
    depth, light = np.full((60, 80), 50, np.uint8), np.full((60, 80), 30, np.uint8)
    # As the original takes them: the bytes are columns of 60.
    d, l = depth.reshape(80, 60), light.reshape(80, 60)
    d[40:], l[40:] = 200, 220
    mask = np.zeros_like(depth)
    mask.reshape(80, 60)[34:46, 20:30] = 255
    holed = np.where(mask, 0, depth).astype(np.uint8)
    result = np.zeros_like(depth)
    cbf(holed, light, mask, result)
    assert np.abs(result.astype(int) - depth).max() <= 2
