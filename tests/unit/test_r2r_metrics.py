"""Metrics are those of the reference evaluation: against a table worked out by hand, and against a slow twin."""

from __future__ import annotations

import json
import math
from functools import cache
from itertools import pairwise
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
from export_samples import random_graph
from task_samples import as_agents_load, exported, house

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.evaluation.interval import grouped_mean, grouped_share, wilson
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.r2r.metrics.distances import Distances
from nvsim.r2r.metrics.scores import Scores, score
from nvsim.r2r.metrics.submission import check_submission, read_submission
from nvsim.r2r.tasks.task import Task


def corridor(step: float = 2.0) -> NavGraph:
    """Viewpoints 0 to 9 in a row, `step` meters apart, and n beside 2, as far from it."""
    at = {str(i): (step * i, 0.0, 1.5) for i in range(10)} | {"n": (2 * step, step, 1.5)}
    joined = [*pairwise("0123456789"), ("2", "n")]
    return NavGraph("row", {id: Viewpoint(id, p) for id, p in at.items()}, {edge(*p).key: edge(*p) for p in joined})


def scored(graph: NavGraph, walks: list[tuple[str | tuple[str, ...], str | tuple[str, ...]]]) -> Scores:
    """Of pairs of reference and trajectory."""
    tasks = [Task(i, graph.scan, tuple(reference), 0.0) for i, (reference, _) in enumerate(walks)]
    trajectories = {f"{i}_0": [(v, 0.0, 0.0) for v in walk] for i, (_, walk) in enumerate(walks)}
    distances = {graph.scan: Distances(graph)}
    check_submission(trajectories, tasks, distances, "here")
    return score(tasks, trajectories, distances)


A, B = "01234", "n2345"  # references, both 8 m long
TABLE = [
    # reference, trajectory, PL, NE, success, oracle success, DTW in meters, meters from each of the reference to it
    (A, "01234", 8, 0, 1, 1, 0, (0, 0, 0, 0, 0)),
    (A, "0", 0, 8, 0, 0, 20, (0, 2, 4, 6, 8)),
    (A, "0123", 6, 2, 1, 1, 2, (0, 0, 0, 0, 2)),
    (A, "012", 4, 4, 0, 0, 6, (0, 0, 0, 2, 4)),
    (A, "01", 2, 6, 0, 0, 12, (0, 0, 2, 4, 6)),
    (A, "012345", 10, 2, 1, 1, 2, (0, 0, 0, 0, 0)),
    (A, "0123456", 12, 4, 0, 1, 6, (0, 0, 0, 0, 0)),
    (A, "0123454", 12, 0, 1, 1, 2, (0, 0, 0, 0, 0)),
    (A, "0101234", 12, 0, 1, 1, 2, (0, 0, 0, 0, 0)),
    (A, "0012344", 8, 0, 1, 1, 0, (0, 0, 0, 0, 0)),
    (A, "012n", 6, 6, 0, 0, 8, (0, 0, 0, 2, 4)),
    (A, "012n234", 12, 0, 1, 1, 2, (0, 0, 0, 0, 0)),
    (A, "012n2", 8, 4, 0, 0, 8, (0, 0, 0, 2, 4)),
    (A, "0123234", 12, 0, 1, 1, 2, (0, 0, 0, 0, 0)),
    (A, "01234321", 14, 6, 0, 1, 10, (0, 0, 0, 0, 0)),
    (A, "012343", 10, 2, 1, 1, 2, (0, 0, 0, 0, 0)),
    (A, "0123456789", 18, 10, 0, 1, 30, (0, 0, 0, 0, 0)),
    (A, "0000", 0, 8, 0, 0, 20, (0, 2, 4, 6, 8)),
    (B, "n23", 4, 4, 0, 0, 6, (0, 0, 0, 2, 4)),
    (B, "n210", 6, 10, 0, 0, 18, (0, 0, 2, 4, 6)),
]


def test_twenty_trajectories_have_the_scores_worked_out_by_hand() -> None:
    found = scored(corridor(), [(reference, walk) for reference, walk, *_ in TABLE])
    for i, (_, walk, pl, ne, success, oracle, dtw, far) in enumerate(TABLE):
        ndtw = math.exp(-dtw / (3.0 * 5))
        coverage = sum(math.exp(-d / 3.0) for d in far) / 5
        cls = coverage * (8 * coverage) / (8 * coverage + abs(8 * coverage - pl))
        expected = {"pl": pl, "ne": ne, "success": success, "oracle_success": oracle, "spl": success * 8 / max(pl, 8)}
        expected |= {"spl_path": expected["spl"], "ndtw": ndtw, "sdtw": success * ndtw, "cls": cls}
        expected |= {"steps": len(walk) - 1}
        assert {name: getattr(found, name)[i] for name in expected} == pytest.approx(expected, abs=1e-12), walk


def test_who_stops_exactly_three_meters_away_has_not_succeeded() -> None:
    found = scored(corridor(3.0), [("012", "01"), ("012", "012")])
    assert found.ne.tolist() == [3.0, 0.0] and found.success.tolist() == found.oracle_success.tolist() == [0.0, 1.0]


def test_the_conventions_of_spl_differ_where_the_reference_is_a_detour() -> None:
    found = scored(corridor(), [("012n234", "01234"), ("012n234", "012n234")])
    assert found.spl.tolist() == pytest.approx([1.0, 8 / 12])
    assert found.spl_path.tolist() == pytest.approx([1.0, 1.0])


def test_distances_are_those_of_networkx() -> None:
    for graph in (house("house", 3), random_graph("hall", 80, 3, reach=3.0)):
        agents, found = as_agents_load(graph), Distances(graph)
        lengths = dict(nx.all_pairs_dijkstra_path_length(agents))
        for a, i in found.row.items():
            for b, j in found.row.items():
                expected = lengths.get(a, {}).get(b, 0.0 if a == b else math.inf)
                assert found.meters[i, j] == pytest.approx(expected, abs=1e-9)
        assert [id for id, v in graph.viewpoints.items() if not v.included and id in found.row] == []


def test_scores_are_those_of_a_slow_twin() -> None:
    graph = house("house", 3, 4, seed=5)
    agents = as_agents_load(graph)
    far = dict(nx.all_pairs_dijkstra_path_length(agents))
    random = np.random.default_rng(0)

    def walk(start: str, steps: int) -> tuple[str, ...]:
        path = [start]
        for _ in range(steps):
            path.append(str(random.choice([*agents[path[-1]], path[-1]])))
        return tuple(path)

    walks = []
    for _ in range(60):
        start = str(random.choice(list(agents)))
        walks.append((walk(start, int(random.integers(1, 15))), walk(start, int(random.integers(0, 40)))))
    found = scored(graph, walks)
    for i, (reference, path) in enumerate(walks):

        @cache
        def dtw(p: int, r: int, path: tuple = path, reference: tuple = reference) -> float:
            if p < 0 or r < 0:
                return 0.0 if p == r == -1 else math.inf
            return far[path[p]][reference[r]] + min(dtw(p - 1, r), dtw(p, r - 1), dtw(p - 1, r - 1))

        ndtw = math.exp(-dtw(len(path) - 1, len(reference) - 1) / (3 * len(reference)))
        coverage = np.mean([math.exp(-min(far[u][v] for v in path) / 3) for u in reference])
        pl = sum(far[a][b] for a, b in pairwise(path))
        length = sum(far[a][b] for a, b in pairwise(reference))
        success = float(far[path[-1]][reference[-1]] < 3)
        shortest = far[reference[0]][reference[-1]]
        assert found.pl[i] == pytest.approx(pl) and found.ne[i] == pytest.approx(far[path[-1]][reference[-1]])
        assert found.success[i] == success
        assert found.oracle_success[i] == float(min(far[v][reference[-1]] for v in path) < 3)
        assert found.spl[i] == pytest.approx(success * shortest / max(pl, shortest, 0.01))
        assert found.spl_path[i] == pytest.approx(success * length / max(pl, length, 0.01))
        assert found.ndtw[i] == pytest.approx(ndtw) and found.sdtw[i] == pytest.approx(success * ndtw)
        expected = coverage * length
        if expected:
            assert found.cls[i] == pytest.approx(coverage * expected / (expected + abs(expected - pl)))


def test_intervals_know_that_instructions_of_one_path_are_not_independent() -> None:
    random = np.random.default_rng(1)
    hits = (random.random(200) < 0.3).astype(float)
    alone = np.arange(200)
    low, high = grouped_share(hits, alone)
    assert (low, high) == pytest.approx(wilson(int(hits.sum()), 200), abs=1e-3)
    assert grouped_share(np.repeat(hits, 3), np.repeat(alone, 3)) == pytest.approx((low, high), abs=1e-3)
    assert grouped_share(np.ones(9), np.repeat([1, 2, 3], 3)) == wilson(3, 3)
    values = random.normal(5, 2, 200)
    half = 1.959964 * values.std(ddof=1) / math.sqrt(200)
    assert grouped_mean(values, alone) == pytest.approx((values.mean() - half, values.mean() + half))
    assert grouped_mean(values[:3], np.zeros(3, int)) == (-math.inf, math.inf)


def test_intervals_hold_the_truth_nineteen_times_of_twenty() -> None:
    random = np.random.default_rng(2)
    groups, held, held_share = np.repeat(np.arange(60), 3), 0, 0
    for _ in range(1000):
        ability = np.repeat(random.normal(0.0, 1.0, 60), 3)
        values = ability + random.normal(0.0, 0.5, 180)
        low, high = grouped_mean(values, groups)
        held += low <= 0.0 <= high
        low, high = grouped_share((values > 0).astype(float), groups)
        held_share += low <= 0.5 <= high
    assert 930 <= held <= 970 and 930 <= held_share <= 970


def written(folder: Path, graph: NavGraph, *items: dict) -> tuple[str, str, str]:
    tasks = [{"path_id": 1, "scan": "row", "path": list(A), "heading": 0.0, "instructions": ["a", "b"]}]
    (folder / "R2R_val.json").write_text(json.dumps(tasks))
    (folder / "agent.json").write_text(json.dumps(items))
    exported(folder, graph)
    return str(folder), str(folder / "R2R_val.json"), str(folder / "agent.json")


def walked(instr_id: str, path: str) -> dict:
    return {"instr_id": instr_id, "trajectory": [[v, 0.0, 0.5] for v in path]}


def test_a_submission_is_scored_and_the_table_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = walked("99_0", "7")  # of another split, as a leaderboard file has
    scans, tasks, agent = written(tmp_path, corridor(), walked("1_0", A), other, walked("1_1", "012"))
    command = ["evaluate", "r2r", "--scans", scans, "--tasks", tasks, "--submission", agent]
    assert main([*command, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["agents"]["agent"]
    assert (found["instructions"], found["paths"], found["successes"]) == (2, 1, 1)
    assert (found["ne"], found["success"], found["spl"], found["pl"]) == pytest.approx((2.0, 0.5, 0.5, 6.0))
    assert found["ne_low"] is None
    assert main(command) == 0
    text = capsys.readouterr().out
    assert "50.0 (1/2; " in text and "Instructions: 2, paths: 1." in text


def test_segments_of_duet_and_mapgpt_have_the_scores_of_the_flat_trajectory(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = walked("1_1", "012")
    for name, path in (("duet", [["0"], ["1", "2"], [], ["3", "4", "5"]]), ("mapgpt", [[id] for id in "012345"])):
        (tmp_path / name).mkdir()
        nested = {"instr_id": "1_0", "trajectory": path}
        scans, tasks, agent = written(tmp_path / name, corridor(), nested, other)
        flat = tmp_path / name / "flat.json"
        flat.write_text(json.dumps([walked("1_0", "012345"), other]))
        command = ["evaluate", "r2r", "--scans", scans, "--tasks", tasks, "--json", "--submission", agent, str(flat)]
        assert main(command) == 0
        agents = json.loads(capsys.readouterr().out)["agents"]
        assert agents["agent"] == agents["flat"] and agents["flat"]["pl"] == pytest.approx(7.0)


def test_the_folder_of_mapgpt_is_a_submission(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """MapGPT writes a file for each instruction, and no file with all of them."""
    scans, tasks, _ = written(tmp_path, corridor())
    folder = tmp_path / "preds"
    folder.mkdir()
    command = ["evaluate", "r2r", "--scans", scans, "--tasks", tasks, "--json", "--submission", str(folder)]
    assert main(command) == 2 and "case_InstrID_*.json" in capsys.readouterr().err
    for id, path in (("1_0", "012345"), ("1_1", "012")):
        case = {
            "instr_id": id,
            "trajectory": [[v] for v in path],
            "a_t": [1],
            "scan": "row",
            "evaluation": {"spl": [1]},
        }
        (folder / f"case_InstrID_{id}.json").write_text(json.dumps(case))
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out)["agents"]["preds"]["pl"] == pytest.approx(7.0)
    (folder / "case_InstrID_2.json").write_text(json.dumps(walked("1_0", "012")))
    assert main(command) == 2
    error = capsys.readouterr().err
    assert "case_InstrID_2.json (1_0): this instr_id occurs twice" in error
    (folder / "case_InstrID_2.json").write_text("[]")
    assert main(command) == 2 and "case_InstrID_2.json has no instr_id" in capsys.readouterr().err


@pytest.mark.parametrize(
    "items, sentence",
    [
        ([walked("1_0", A)], "lacks 1 of 2 instructions, the first 1_1"),
        ([walked("1_0", A), walked("1_1", "12")], "begins at 1 and not at the start 0"),
        ([walked("1_0", A), walked("1_1", "03")], "no edge leads from 0 to 3"),
        ([walked("1_0", A), walked("1_1", "0x")], "viewpoint x is not in the graph"),
        ([walked("1_0", A), walked("1_0", A)], "item 1 (1_0): this instr_id occurs twice"),
        ([{"trajectory": []}], "item 0 has no instr_id"),
        ([walked("1_0", "")], "trajectory is []"),
        ([{"instr_id": "1_0", "trajectory": [["0"], ["1", 2]]}], "step 1 is ['1', 2]; it must be"),
        ([{"instr_id": "1_0", "trajectory": [[], []]}], "the segments of the trajectory are empty"),
        ([{"instr_id": "1_0", "trajectory": [["0", "north", 0]]}], "step 0: heading is north"),
    ],
)
def test_a_wrong_submission_is_refused_with_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], items: list[dict], sentence: str
) -> None:
    scans, tasks, agent = written(tmp_path, corridor(), *items)
    assert main(["evaluate", "r2r", "--scans", scans, "--tasks", tasks, "--submission", agent]) == 2
    error = capsys.readouterr().err
    assert sentence in error and "agent.json" in error


def test_tasks_that_do_not_fit_the_scans_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scans, tasks, agent = written(tmp_path, corridor(), walked("1_0", A), walked("1_1", A))
    for change, sentence in [
        ({"scan": "Louvre"}, "The scan Louvre is not listed"),
        ({"path": ["0", "2"]}, "path_id 1: no edge leads from 0 to 2"),
        ({"path": ["0"]}, "path_id 1 has a start and no goal"),
    ]:
        item = json.loads(Path(tasks).read_text())[0] | change
        (tmp_path / "R2R_wrong.json").write_text(json.dumps([item]))
        command = ["evaluate", "r2r", "--scans", scans, "--tasks", str(tmp_path / "R2R_wrong.json")]
        assert main([*command, "--submission", agent]) == 2
        assert sentence in capsys.readouterr().err
    with pytest.raises(InputError, match="is not a list of trajectories"):
        (tmp_path / "object.json").write_text("{}")
        read_submission(tmp_path / "object.json")
