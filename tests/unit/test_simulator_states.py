"""States are those of Matterport3DSimulator: recorded from the compiled one, and by its published numbers."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nvsim.benchmarks.simulator import write_made_scan
from nvsim.r2r.simulator import Simulator

RECORD = json.loads((Path(__file__).parents[1] / "data" / "mattersim_states.json").read_text())
"""Written by tests/benchmarks/mattersim_states.py --record, on a graph made by this project."""
ROUNDING = 5e-7
"""Radians and meters: the last digit of a float32 below 8 depends on the processor."""


def write_graph(folder: Path, scan: str, entries: list[dict[str, Any]]) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "scans.txt").write_text(f"{scan}\n")
    (folder / f"{scan}_connectivity.json").write_text(json.dumps(entries))
    return folder


def without_images(graphs: Path, discrete: bool = True, restricted: bool = True) -> Simulator:
    sim = Simulator()
    sim.setNavGraphPath(str(graphs))
    sim.setRenderingEnabled(False)
    sim.setCameraResolution(640, 480)
    sim.setCameraVFOV(math.radians(60))
    sim.setDiscretizedViewingAngles(discrete)
    sim.setRestrictedNavigation(restricted)
    return sim


def entry(id: str, position: tuple[float, float, float], free: list[int], included: bool = True) -> dict[str, Any]:
    x, y, z = position
    return {"image_id": id, "pose": [1, 0, 0, x, 0, 0, 1, y, 0, -1, 0, z, 0, 0, 0, 1], "included": included} | {
        "unobstructed": free
    }


@pytest.mark.parametrize("run", RECORD["runs"], ids=lambda r: f"discrete {r['discrete']}, restricted {r['restricted']}")
def test_states_are_those_of_the_compiled_simulator(run: dict[str, Any], tmp_path: Path) -> None:
    graphs = write_graph(tmp_path / "graphs", RECORD["scan"], RECORD["graph"])
    sim = without_images(graphs, run["discrete"], run["restricted"])
    for step in run["steps"]:
        (sim.newEpisode if len(step["call"]) == 4 else sim.makeAction)(*step["call"])
        state = sim.getState()[0]
        places = [state.location, *state.navigableLocations]
        same = [state.scanId, state.step, state.viewIndex, *([p.viewpointId, p.ix, *p.point] for p in places)]
        angles = [state.heading, state.elevation]
        angles += [v for p in places for v in (p.rel_heading, p.rel_elevation, p.rel_distance)]
        assert same == step["state"][0]
        np.testing.assert_allclose(angles, step["state"][1], rtol=0, atol=ROUNDING)


def test_actions_without_images_have_the_states_of_the_general_way(tmp_path: Path) -> None:
    ids = write_made_scan(tmp_path, count=20, plain=True)
    quick, general = (without_images(tmp_path / "connectivity") for _ in range(2))
    for sim in (quick, general):
        sim.setBatchSize(3)
        sim.newEpisode(["made"] * 3, ids[:3], [0.1, 2.0, 4.0], [0.0, 0.6, -0.6])
    random = np.random.default_rng(0)
    acted = 0
    for _ in range(300):
        ways = [int(random.integers(len(s.navigableLocations))) for s in quick.getState()]
        turns, tilts = random.choice([-2.5, -1.0, 0.0, 0.5, 1.0], (2, 3)).tolist()
        general._batch.quick_angle = None  # type: ignore[union-attr]
        acted += quick._batch.quick_angle is not None  # type: ignore[union-attr]
        for sim in (quick, general):
            sim.makeAction(ways, turns, tilts)
        for a, b in zip(quick.getState(), general.getState(), strict=True):
            assert (a.step, a.viewIndex, a.heading, a.elevation) == (b.step, b.viewIndex, b.heading, b.elevation)
            assert repr([*map(vars_of, a.navigableLocations)]) == repr([*map(vars_of, b.navigableLocations)])
    assert acted == 300


@pytest.mark.parametrize("call", [([0, 99], [0.0] * 2, [0.0] * 2), ([0, 0], [0.0, math.nan], [0.0] * 2),
                                  ([0, -1], [0.0] * 2, [0.0] * 2), ([0], [0.0] * 2, [0.0] * 2)])  # fmt: skip
def test_an_invalid_action_of_one_environment_moves_none(call: tuple[Any, Any, Any], tmp_path: Path) -> None:
    ids = write_made_scan(tmp_path, count=20, plain=True)
    sim = without_images(tmp_path / "connectivity")
    sim.setBatchSize(2)
    sim.newEpisode(["made"] * 2, ids[:2], [0.0] * 2, [0.0] * 2)
    sim.makeAction([0, 0], [1, 1], [0, 0])
    with pytest.raises((ValueError, TypeError, IndexError)):
        sim.makeAction(*call)
    assert [(s.step, s.viewIndex, s.location.viewpointId) for s in sim.getState()] == [(1, 13, ids[0]), (1, 13, ids[1])]


def vars_of(place: Any) -> list[Any]:
    return [getattr(place, name) for name in place.__slots__]


def test_a_sweep_of_36_views_counts_them_and_sees_every_neighbor(tmp_path: Path) -> None:
    ids = write_made_scan(tmp_path, count=20, plain=True)
    sim = without_images(tmp_path / "connectivity")
    free = without_images(tmp_path / "connectivity", restricted=False)
    for id in ids:
        seen = set()
        for view in range(36):
            if view == 0:
                sim.newEpisode(["made"], [id], [0], [math.radians(-30)])
            else:
                sim.makeAction([0], [1.0], [1.0 if view % 12 == 0 else 0])
            state = sim.getState()[0]
            assert state.viewIndex == view
            assert state.navigableLocations[0].viewpointId == id
            seen |= {p.viewpointId for p in state.navigableLocations}
        free.newEpisode(["made"], [id], [0], [0])
        assert seen == {p.viewpointId for p in free.getState()[0].navigableLocations}


def test_who_is_exactly_above_is_never_in_a_restricted_view(tmp_path: Path) -> None:
    entries = [entry("low", (0, 0, 1), [0, 1]), entry("high", (0, 0, 4), [1, 0])]
    graphs = write_graph(tmp_path / "g", "two", entries)
    for restricted, expected in ((True, ["low"]), (False, ["low", "high"])):
        sim = without_images(graphs, discrete=False, restricted=restricted)
        sim.newEpisode("two", "low", 0.0, 0.5)
        found = sim.getState().navigableLocations
        assert [p.viewpointId for p in found] == expected
        if not restricted:
            assert found[1].rel_elevation == pytest.approx(math.pi / 2 - 0.5)


def test_the_field_of_view_is_the_linear_one(tmp_path: Path) -> None:
    entries = [entry("a", (0, 0, 1), [0, 1]), entry("b", (0, 3, 1), [1, 0])]
    sim = without_images(write_graph(tmp_path / "g", "two", entries), discrete=False)
    for degrees, seen in ((39.9, 2), (40.1, 1), (-39.9, 2), (-40.1, 1)):
        sim.newEpisode("two", "a", math.radians(degrees), 0.0)
        assert len(sim.getState().navigableLocations) == seen


def test_ways_go_one_way_only_where_the_file_says_so_and_never_to_excluded_ones(tmp_path: Path) -> None:
    entries = [
        entry("a", (0, 0, 1), [1, 1, 1]),
        entry("b", (0, 1, 1), [0, 0, 0]),
        entry("c", (0, 2, 1), [1, 1, 0], included=False),
    ]
    sim = without_images(write_graph(tmp_path / "g", "three", entries), restricted=False)
    sim.newEpisode("three", "a", 0, 0)
    assert [p.viewpointId for p in sim.getState().navigableLocations] == ["a", "b"]
    sim.newEpisode("three", "b", 0, 0)
    assert [p.viewpointId for p in sim.getState().navigableLocations] == ["b"]


def test_a_batch_goes_as_its_environments_alone(tmp_path: Path) -> None:
    ids = write_made_scan(tmp_path, "one", count=20)
    others = write_made_scan(tmp_path, "two", count=15, seed=2)
    graphs = tmp_path / "connectivity"
    starts = [("one", ids[0]), ("two", others[1]), ("one", ids[5])]
    batch = without_images(graphs)
    batch.setBatchSize(3)
    alone = [without_images(graphs) for _ in starts]
    batch.newEpisode([s for s, _ in starts], [v for _, v in starts], [0.1, 2, 4], [0, 0.6, -0.6])
    for sim, (scan, v), h, e in zip(alone, starts, [0.1, 2, 4], [0, 0.6, -0.6], strict=True):
        sim.newEpisode(scan, v, h, e)
    r = np.random.default_rng(0)
    for _ in range(60):
        states = batch.getState()
        for state, sim in zip(states, alone, strict=True):
            one = sim.getState()
            assert (state.scanId, state.location.viewpointId, state.viewIndex, state.step) == (
                *(one.scanId, one.location.viewpointId, one.viewIndex, one.step),
            )
            assert [repr(p) for p in state.navigableLocations] == [repr(p) for p in one.navigableLocations]
        index = [int(r.integers(len(s.navigableLocations))) for s in states]
        turns = r.choice([-1.0, 0.0, 1.0], (2, 3)).tolist()
        batch.makeAction(index, *turns)
        for sim, i, h, e in zip(alone, index, *turns, strict=True):
            sim.makeAction(i, h, e)


def test_an_edited_graph_holds_from_the_next_episode_on(tmp_path: Path) -> None:
    entries = [entry("a", (0, 0, 1), [0, 1]), entry("b", (0, 1, 1), [1, 0])]
    graphs = write_graph(tmp_path / "g", "two", entries)
    sim = without_images(graphs, restricted=False)
    sim.newEpisode("two", "a", 0, 0)
    write_graph(
        graphs, "two", [*([e | {"unobstructed": [0, 0, 0]} for e in entries]), entry("c", (1, 0, 1), [1, 0, 0])]
    )
    sim.makeAction(1, 0, 0)
    assert sim.getState().location.viewpointId == "b"
    sim.newEpisode("two", "a", 0, 0)
    assert len(sim.getState().navigableLocations) == 1
    sim.newEpisode("two", "c", 0, 0)
    assert len(sim.getState().navigableLocations) == 2


def test_random_episodes_of_seed_1_are_those_of_the_compiled_simulator(tmp_path: Path) -> None:
    entries = [entry(f"v{i}", (i, 0, 1), [0] * 10) for i in range(10)]
    sim = without_images(write_graph(tmp_path / "g", "ten", entries), discrete=False)
    sim.newRandomEpisode("ten")
    # minstd_rand0 begins with 16807 and 282475249.
    assert sim.getState().location.ix == 16806 * 10 // (2**31 - 3)
    expected = 2 * math.pi * (16806 + 282475248 * 2147483646) / 2147483646**2
    assert sim.getState().heading == pytest.approx(expected, abs=1e-12)
