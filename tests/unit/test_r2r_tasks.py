"""Paths are those that R2R would sample: shortest, spread, split by region, and written as agents read them."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from random import Random

import networkx as nx
import numpy as np
import pytest
from task_samples import as_agents_load, exported, house, without

from nvsim.cli.main import main
from nvsim.dataset import tasks as making
from nvsim.errors import InputError
from nvsim.graph.paths import PathGraph
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.r2r.tasks.shortest import PathBounds, ShortestPaths, eligible_paths
from nvsim.r2r.tasks.splitting import SPLITS, Dataset, Impassable, PathCounts, by_increasing_use, sample_tasks
from nvsim.r2r.tasks.task import read_tasks, write_tasks


def sampled(*graphs: NavGraph, unseen: tuple[str, ...] = (), **amounts: object) -> Dataset:
    return sample_tasks(graphs, unseen, PathBounds(), PathCounts(**amounts))  # type: ignore[arg-type]


def meters_along(graph: nx.Graph, path: tuple[str, ...]) -> float:
    return sum(graph.edges[a, b]["weight"] for a, b in pairwise(path))


def test_every_path_is_a_shortest_one_within_the_bounds() -> None:
    graph = house("house", 5)
    agents = as_agents_load(graph)
    dataset = sampled(graph)
    assert all(len(dataset.splits[name]) for name in SPLITS)
    for task in (t for name in SPLITS for t in dataset.splits[name]):
        assert 4 <= len(task.path) - 1 <= 6 and task.distance >= 5
        length = meters_along(agents, task.path)
        assert length == pytest.approx(nx.dijkstra_path_length(agents, task.path[0], task.path[-1]), abs=1e-5)
        assert task.distance == pytest.approx(length, abs=0.0051)
        assert 0 <= task.heading < 2 * math.pi


def test_all_pairs_that_networkx_finds_are_eligible() -> None:
    graph = house("house", 3, 4, seed=2)
    agents = as_agents_load(graph)
    expected = set()
    for a, paths in nx.all_pairs_dijkstra_path(agents):
        for b, path in paths.items():
            if a < b and 4 <= len(path) - 1 <= 6 and meters_along(agents, tuple(path)) >= 5:
                expected.add(frozenset(path))
    found = eligible_paths(PathGraph.of(graph), PathBounds(ties=True))
    assert {frozenset(found.ids[i] for i in found.path(k)) for k in range(len(found.rows))} == expected


def test_bounds_are_options() -> None:
    found = eligible_paths(PathGraph.of(house("house", 3)), PathBounds(2, 3, 3.0, 6.0))
    edges = (found.rows >= 0).sum(axis=1) - 1
    assert set(edges.tolist()) == {2, 3} and found.meters.min() >= 3 and found.meters.max() <= 6


def test_a_path_beside_which_another_is_as_short_is_left_out_unless_wanted() -> None:
    graph = house("house", 2, 4, even=True)  # on a lattice there are many ways round every corner
    only = eligible_paths(PathGraph.of(graph), PathBounds())
    at = {id: np.array(v.position) for id, v in graph.viewpoints.items()}
    agents = as_agents_load(graph)
    for k in range(len(only.rows)):
        ids = [only.ids[i] for i in only.path(k)]
        shortest = list(nx.all_shortest_paths(agents, ids[0], ids[-1], weight="weight"))
        assert [sorted(p) for p in shortest] == [sorted(ids)]
        assert np.linalg.norm(at[ids[0]] - at[ids[-1]]) > 0
    assert len(eligible_paths(PathGraph.of(graph), PathBounds(ties=True)).rows) > 2 * len(only.rows) > 0


def test_of_tied_paths_the_fewest_edges_and_then_the_order_of_the_file_decide() -> None:
    # From a to d: over b or c, both 2 m; and straight on over e to f, 2 m with one edge or two.
    at = {"a": (0, 0), "b": (0, 1), "c": (1, 0), "d": (1, 1), "e": (-1, 0), "f": (-2, 0)}
    joined = [("a", "b"), ("a", "c"), ("b", "d"), ("c", "d"), ("a", "e"), ("e", "f"), ("a", "f")]
    for order in (list(at), list(at)[::-1]):
        viewpoints = {id: Viewpoint(id, (*map(float, at[id]), 1.5)) for id in order}
        ways = PathGraph.of(NavGraph("g", viewpoints, {edge(*p).key: edge(*p) for p in joined}))
        tree = ShortestPaths(ways).tree(order.index("a"))
        over = [order[i] for i in tree.back_from(order.index("d"))]
        assert over == ["d", min("b", "c", key=order.index), "a"]
        assert [order[i] for i in tree.back_from(order.index("f"))] == ["f", "a"]


def test_no_path_comes_twice_and_ids_are_unique_over_scans() -> None:
    dataset = sampled(house("one"), house("two", seed=1), train=200, val_seen=40, val_unseen=80)
    tasks = [task for name in SPLITS for task in dataset.splits[name]]
    assert len({(t.scan, frozenset(t.path)) for t in tasks}) == len(tasks)
    assert [t.path_id for t in tasks] == list(range(1, len(tasks) + 1))
    assert {t.scan for t in tasks} == {"one", "two"}


def test_what_val_unseen_enters_no_other_path_enters() -> None:
    dataset = sampled(house("one", 6), house("two", 4, seed=1))
    entered = {name: {(t.scan, v) for t in dataset.splits[name] for v in t.path} for name in SPLITS}
    assert not entered["val_unseen"] & (entered["train"] | entered["val_seen"])
    assert entered["val_unseen"] <= {(scan, v) for scan, ids in dataset.unseen.items() for v in ids}


def test_the_unseen_region_is_cut_at_doors() -> None:
    for ids in sampled(house("one", 5), house("two", 8, seed=3)).unseen.values():
        rooms = {id[0] for id in ids}
        assert rooms and len(ids) == 16 * len(rooms), "rooms are unseen as a whole"


def test_whole_scans_can_be_unseen() -> None:
    dataset = sampled(house("one"), house("two", seed=1), unseen=("two",))
    assert {t.scan for t in dataset.splits["val_unseen"]} == {"two"}
    assert {t.scan for name in ("train", "val_seen") for t in dataset.splits[name]} == {"one"}


def test_excluded_viewpoints_are_in_no_path() -> None:
    graph = without(house("house"), "0r11", "1r22", "2r00")
    dataset = sampled(graph, val_seen=60)
    passed = {v for name in SPLITS for t in dataset.splits[name] for v in t.path}
    assert passed and not passed & {"0r11", "1r22", "2r00"}


def test_the_same_seed_gives_the_same_tasks_and_another_gives_others() -> None:
    same = [sampled(house("house"), seed=seed).splits for seed in (3, 3, 4)]
    assert same[0] == same[1] != same[2]


def test_spread_paths_cover_a_building_sooner_than_random_ones() -> None:
    found = eligible_paths(PathGraph.of(house("house", 8)), PathBounds())
    paths = [found.path(i) for i in range(len(found.rows))]
    order = list(by_increasing_use(paths, Random(0)))
    assert sorted(order) == list(range(len(paths)))

    def covered(chosen: list[int]) -> int:
        return len({v for i in chosen for v in paths[i]})

    by_chance = [covered(Random(seed).sample(range(len(paths)), 30)) for seed in range(20)]
    assert covered(order[:30]) > max(by_chance)


def test_spread_takes_the_least_used_path_as_one_by_one_counting_does() -> None:
    found = eligible_paths(PathGraph.of(house("house", 2)), PathBounds())
    paths = [found.path(i) for i in range(len(found.rows))]
    order = list(by_increasing_use(paths, Random(0)))
    use, ends = dict.fromkeys(range(100), 0), dict.fromkeys(range(100), 0)
    left = set(range(len(paths)))
    for i in order:
        score = {k: sum(use[v] for v in p) / len(p) + (ends[p[0]] + ends[p[-1]]) / 2 for k, p in enumerate(paths)}
        assert score[i] == min(score[k] for k in left)
        left.remove(i)
        for v in paths[i]:
            use[v] += 1
        for v in (paths[i][0], paths[i][-1]):
            ends[v] += 1


def test_joined_paths_lead_from_one_task_over_a_shortest_path_to_another() -> None:
    graph = house("house", 4)
    agents = as_agents_load(graph)
    dataset = sampled(graph, joined=30)
    for name in SPLITS:
        by_id = {t.path_id: t for t in dataset.splits[name]}
        for task in dataset.joined[name]:
            first, second = by_id[task.first_path_id], by_id[task.second_path_id]
            middle = task.path[len(first.path) - 1 : len(task.path) - len(second.path) + 1]
            assert task.path == first.path[:-1] + middle + second.path[1:]
            assert middle[0] == first.path[-1] and middle[-1] == second.path[0]
            between = nx.dijkstra_path_length(agents, middle[0], middle[-1])
            assert meters_along(agents, middle) == pytest.approx(between, abs=1e-5) and between <= 3
            assert task.distance == pytest.approx(meters_along(agents, task.path), abs=0.02)
            assert task.heading == first.heading
            ends = task.path[0], task.path[-1]
            assert (task.shortest_path[0], task.shortest_path[-1]) == ends
            assert task.shortest_path_distance == pytest.approx(nx.dijkstra_path_length(agents, *ends), abs=0.0051)
            if name != "val_unseen":
                assert not set(task.path) & set(dataset.unseen["house"])
    ids = [t.path_id for part in (dataset.splits, dataset.joined) for name in SPLITS for t in part[name]]
    assert len(set(ids)) == len(ids)
    assert sum(len(tasks) for tasks in dataset.joined.values()) > 40


def test_files_have_the_fields_of_r2r_and_come_back_as_they_were(tmp_path: Path) -> None:
    scans = exported(tmp_path, house("one"), house("two", seed=1))
    assert main(["export", "tasks", "--scans", str(scans), "--out", str(tmp_path / "tasks"), "--joined", "5"]) == 0
    dataset = sampled(house("one"), house("two", seed=1), joined=5)
    for name in SPLITS:
        path = tmp_path / "tasks" / f"R2R_{name}.json"
        for item in json.loads(path.read_text()):
            assert sorted(item) == ["distance", "heading", "instructions", "path", "path_id", "scan"]
            assert item["distance"] == round(item["distance"], 2) and item["heading"] == round(item["heading"], 3)
        assert [replace(task, instructions=()) for task in read_tasks(path)] == dataset.splits[name]
        assert len(read_tasks(tmp_path / "tasks" / f"R4R_{name}.json")) == len(dataset.joined[name])


def test_a_task_file_that_nvsim_did_not_write_is_not_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scans, out = exported(tmp_path, house("one")), tmp_path / "tasks"
    out.mkdir()
    (out / "R2R_train.json").write_text("[]")
    command = ["export", "tasks", "--scans", str(scans), "--out", str(out)]
    assert main(command) == 2 and "NVSim did not write it" in capsys.readouterr().err
    assert [p.name for p in out.iterdir()] == ["R2R_train.json"] and (out / "R2R_train.json").read_text() == "[]"
    assert main([*command[:-1], str(tmp_path / "other")]) == main([*command[:-1], str(tmp_path / "other")]) == 0


def test_tasks_that_cannot_be_written_are_refused_before_any_path_is_sampled(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A model may be paid for instructions after that."""
    scans, out = exported(tmp_path, house("one")), tmp_path / "tasks"
    (tmp_path / "file").touch()
    (out / "rxr").mkdir(parents=True)
    (out / "rxr" / "rxr_train_guide.jsonl.gz").touch()
    monkeypatch.setattr(making, "sample_tasks", lambda *_: pytest.fail("paths were sampled"))
    command = ["export", "tasks", "--scans", str(scans), "--out"]
    assert main([*command, str(tmp_path / "file")]) == 2 and "not a folder" in capsys.readouterr().err
    assert main([*command, str(out), "--rxr"]) == 2 and "NVSim did not write it" in capsys.readouterr().err
    (out / "R4R_train.json").touch()
    assert main([*command, str(out), "--joined", "1"]) == 2 and "R4R_train.json" in capsys.readouterr().err


def test_no_tasks_of_an_earlier_run_stay_beside_new_ones(tmp_path: Path) -> None:
    scans, out = exported(tmp_path, house("one")), tmp_path / "tasks"
    command = ["export", "tasks", "--scans", str(scans), "--out", str(out)]
    assert main([*command, "--joined", "3"]) == 0 and (out / "R4R_train.json").exists()
    old = {path.name: path.read_text() for path in out.iterdir()}
    (out / "R2R_val_seen.json").unlink()
    (out / "R2R_val_seen.json").mkdir()  # the new run is cut off here
    (out / "R2R_val_seen.json" / "x").touch()
    assert main([*command, "--seed", "1"]) == 2
    assert all(path.is_dir() or path.read_text() == old[path.name] for path in out.iterdir())
    (out / "R2R_val_seen.json" / "x").unlink()
    (out / "R2R_val_seen.json").rmdir()
    assert main([*command, "--seed", "1"]) == 0 and not (out / "R4R_train.json").exists()


@pytest.mark.parametrize(
    "item, what",
    [
        ({"path_id": True}, "path_id is True"),
        ({"path_id": 1 << 70}, "path_id is 11805"),
        ({"path_id": 1}, "path_id 1 occurs twice"),
        ({"scan": 3}, "scan is 3"),
        ({"path": []}, "path is"),
        ({"path": ["a", 4]}, "path is"),
        ({"heading": "north"}, "heading is north"),
        ({"instructions": "go"}, "instructions is go"),
        ({"distance": "far"}, "distance is far"),
    ],
)
def test_a_wrong_item_is_refused_with_file_and_number(tmp_path: Path, item: dict, what: str) -> None:
    good = {"path_id": 1, "scan": "s", "path": ["a", "b"], "heading": 0.5, "instructions": ["go"], "distance": 5.0}
    path = tmp_path / "R2R_train.json"
    path.write_text(json.dumps([good, {**good, "path_id": 2, **item}]))
    with pytest.raises(InputError, match=rf"R2R_train.json, item 1: {what}"):
        read_tasks(path)


def test_the_test_split_of_r2r_which_hides_its_goals_is_read(tmp_path: Path) -> None:
    path = tmp_path / "R2R_test.json"
    path.write_text('[{"path_id": 7, "scan": "s", "path": ["a"], "heading": 1, "instructions": ["x", "y", "z"]}]')
    (task,) = read_tasks(path)
    assert task.distance is None and task.instr_ids == ("7_0", "7_1", "7_2")
    assert "distance" not in json.loads(write_tasks(path, [task]).read_text())[0]


@pytest.mark.parametrize(
    "words, sentence",
    [
        (["--fewest-edges", "50", "--most-edges", "60", "--val-unseen", "0"], "is left for train"),
        (["--fewest-edges", "5", "--most-edges", "3"], "No path has from 5 to 3 edges"),
        (["--unseen", "Louvre"], "--unseen 'Louvre' is not one of the scans"),
        (["--only", "Louvre"], "is not listed"),
        (["--unseen-share", "1.5"], "give a share between 0 and 1"),
    ],
)
def test_what_cannot_be_sampled_is_said_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], sentence: str
) -> None:
    scans = exported(tmp_path, house("one"))
    assert main(["export", "tasks", "--scans", str(scans), "--out", str(tmp_path / "tasks"), *words]) == 2
    assert sentence in capsys.readouterr().err and not (tmp_path / "tasks").exists()


def test_no_path_uses_what_a_robot_cannot_use() -> None:
    graph = house("house", 4)
    edges, ends = (("0r00", "0r01"), ("1r11", "1r12")), ("2r00", "2r33")
    bounds = PathBounds(ties=True)
    whole = eligible_paths(PathGraph.of(graph), bounds)
    reduced = whole.excluding(edges, ends)
    paths = [[reduced.ids[i] for i in reduced.path(k)] for k in range(len(reduced.rows))]
    expected = []
    for k in range(len(whole.rows)):
        path = [whole.ids[i] for i in whole.path(k)]
        steps = {frozenset(pair) for pair in pairwise(path)}
        if not steps & {frozenset(e) for e in edges} and path[0] not in ends and path[-1] not in ends:
            expected.append(path)
    assert paths == expected and len(whole.rows) > len(paths) > 0
    assert any("2r00" in path[1:-1] for path in paths)  # a robot may still pass it
    impassable = {"house": Impassable(edges, ends)}
    dataset = sample_tasks([graph], (), bounds, PathCounts(40, 8, 10), impassable)
    tasks = [task for split in dataset.splits.values() for task in split]
    assert all(list(task.path) in expected or list(task.path)[::-1] in expected for task in tasks)
    nowhere = {"house": Impassable(ends=tuple(graph.viewpoints))}
    with pytest.raises(InputError, match="with room for a robot"):
        sample_tasks([graph], (), bounds, PathCounts(), nowhere)
