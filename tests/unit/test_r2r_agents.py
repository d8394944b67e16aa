"""Agents without a model follow their definitions in the simulator, and get the correct scores."""

from __future__ import annotations

import json
import math
from collections import Counter
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from export_samples import random_graph
from scipy.stats import chisquare
from task_samples import as_agents_load, exported, house

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.r2r.agents.baselines import paper_random_agent, random_agent, shortest_agent
from nvsim.r2r.agents.benchmark import run_agent
from nvsim.r2r.metrics.submission import Pose
from nvsim.r2r.simulator import SimState
from nvsim.r2r.tasks.shortest import PathBounds
from nvsim.r2r.tasks.splitting import PathCounts, sample_tasks
from nvsim.r2r.tasks.task import Task

STEP = math.radians(30)


def tasks_in(*graphs: NavGraph, count: int = 100) -> list[Task]:
    return list(sample_tasks(graphs, (), PathBounds(), PathCounts(count, 0, 0, unseen_share=0.1)).splits["train"])


def moves(trajectory: list[Pose]) -> tuple[str, ...]:
    """The viewpoints, each stay once."""
    return (trajectory[0][0], *(b[0] for a, b in pairwise(trajectory) if a[0] != b[0]))


def test_shortest_walks_every_path_as_it_was_sampled(tmp_path: Path) -> None:
    # The second graph climbs: neighbors lie up to 60 degrees above and below.
    graphs = [house("one"), random_graph("two", 60, 4, reach=3.5)]
    tasks = tasks_in(*graphs, count=150)
    agent = shortest_agent({graph.scan: graph for graph in graphs})
    walked = run_agent(agent, tasks, exported(tmp_path, *graphs) / "connectivity")
    assert {t.scan for t in tasks} == {"one", "two"} and list(walked) == [f"{t.path_id}_0" for t in tasks]
    for task in tasks:
        assert moves(walked[f"{task.path_id}_0"]) == task.path


def test_shortest_turns_the_shorter_way_and_goes_once_it_looks_there(tmp_path: Path) -> None:
    at = {"a": (0, 0), "b": (2 * math.sin(math.radians(85)), 2 * math.cos(math.radians(85)))}  # b is at 85 degrees
    graph = NavGraph(
        "pair", {id: Viewpoint(id, (*map(float, p), 1.5)) for id, p in at.items()}, {("a", "b"): edge("a", "b")}
    )
    graphs = exported(tmp_path, graph) / "connectivity"
    for begin, headings in [(0, [0, 30, 60, 60]), (210, [210, 180, 150, 120, 90, 90]), (90, [90, 90])]:
        task = Task(1, "pair", ("a", "b"), math.radians(begin))
        (walked,) = run_agent(shortest_agent({"pair": graph}), [task], graphs).values()
        assert [round(math.degrees(heading)) for _, heading, _ in walked] == headings
        assert [id for id, _, _ in walked] == ["a"] * (len(headings) - 1) + ["b"]


def test_shortest_says_when_a_way_goes_straight_up(tmp_path: Path) -> None:
    viewpoints = {id: Viewpoint(id, (0.0, 0.0, z)) for id, z in (("low", 1.0), ("high", 4.0))}
    graph = NavGraph("shaft", viewpoints, {("high", "low"): edge("low", "high")})
    with pytest.raises(InputError, match="No view from low in the scan shaft leads to high"):
        run_agent(
            shortest_agent({"shaft": graph}),
            [Task(1, "shaft", ("low", "high"), 0.0)],
            exported(tmp_path, graph) / "connectivity",
        )


def test_random_turns_right_then_goes_five_times_to_what_is_ahead(tmp_path: Path) -> None:
    graph = house("one")
    at = {id: np.array(v.position) for id, v in graph.viewpoints.items()}
    tasks = tasks_in(graph, count=400)
    walked = run_agent(random_agent(3), tasks, exported(tmp_path, graph) / "connectivity")
    turned = Counter()
    for task in tasks:
        trajectory = walked[f"{task.path_id}_0"]
        assert len(trajectory) <= 31
        assert len(moves(trajectory)) == 6 or len(trajectory) == 31
        gone = [a[0] != b[0] for a, b in pairwise(trajectory)]
        for (here, heading, _), (there, after, level) in pairwise(trajectory):
            assert level == 0.0
            # The nearest of all neighbors to the middle of the view, which shows 40 degrees either side.
            off = {
                id: abs((math.atan2(*(at[id] - at[here])[:2]) - heading + math.pi) % (2 * math.pi) - math.pi)
                for id in graph.neighbors(here)
            }
            if there != here:
                assert off[there] == min(off.values()) <= math.radians(40.01) and after == heading
            else:
                assert (after - heading) % (2 * math.pi) == pytest.approx(STEP, abs=1e-5)
        turned[gone.index(True)] += 1  # turns for want of a way among them
    assert len(turned) >= 12 and max(turned) < 24


def test_first_turns_of_random_are_uniform() -> None:
    agent = random_agent(0)
    task = Task(1, "s", ("a", "b"), 0.0)
    ahead = cast(SimState, SimpleNamespace(navigableLocations=("a", "b")))  # every view shows a neighbor
    episodes = (agent.episode(f"{i}_0", task, ahead) for i in range(6000))
    counts = Counter(sum(not index for index, _, _ in episode) for episode in episodes)
    assert sorted(counts) == list(range(12)) and chisquare(list(counts.values())).pvalue > 0.001


def test_random_of_the_paper_goes_ten_times_to_any_neighbor_alike(tmp_path: Path) -> None:
    graph = house("one")
    agents = as_agents_load(graph)
    tasks = tasks_in(graph, count=400)
    walked = run_agent(paper_random_agent(1), tasks, exported(tmp_path, graph) / "connectivity")
    chosen: Counter[tuple[int, int]] = Counter()
    for task in tasks:
        ids = [pose[0] for pose in walked[f"{task.path_id}_0"]]
        assert len(ids) == 11 and ids[0] == task.path[0]
        for a, b in pairwise(ids):
            around = sorted(agents[a])
            chosen[len(around), around.index(b)] += 1
    for degree in {degree for degree, _ in chosen}:
        counts = [chosen[degree, i] for i in range(degree)]
        assert degree < 2 or chisquare(counts).pvalue > 0.001


def test_a_trajectory_depends_on_seed_and_instruction_alone(tmp_path: Path) -> None:
    graph = house("one")
    graphs, tasks = exported(tmp_path, graph) / "connectivity", tasks_in(graph, count=100)
    for agent in (random_agent, paper_random_agent):
        whole = run_agent(agent(1), tasks, graphs)
        assert run_agent(agent(1), tasks[70:40:-1], graphs).items() <= whole.items()
        assert run_agent(agent(2), tasks, graphs) != whole


def test_shortest_and_random_have_the_rows_that_they_must_have(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scans = exported(tmp_path, house("one", 8), house("two", 8, seed=1))
    assert main(["export", "tasks", "--scans", str(scans), "--out", str(tmp_path / "tasks")]) == 0
    tasks = str(tmp_path / "tasks" / "R2R_val_unseen.json")
    common = ["--scans", str(scans), "--tasks", tasks]
    for agent in ("shortest", "random", "random-paper"):
        assert main(["r2r", "agent", agent, *common, "--out", str(tmp_path / f"{agent}.json")]) == 0
    files = [str(tmp_path / f"{agent}.json") for agent in ("shortest", "random", "random-paper")]
    capsys.readouterr()
    assert main(["evaluate", "r2r", *common, "--agents", "shortest", "random", "random-paper", "--json"]) == 0
    run = json.loads(capsys.readouterr().out)["agents"]
    assert main(["evaluate", "r2r", *common, "--submission", *files, "--json"]) == 0
    submitted = json.loads(capsys.readouterr().out)["agents"]
    assert {name.upper(): figures for name, figures in submitted.items()} == run
    best = run["SHORTEST"]
    assert best["ne"] == 0 and best["success"] == best["oracle_success"] == 1
    assert [best[name] for name in ("spl", "spl_path", "ndtw", "sdtw", "cls")] == pytest.approx([1] * 5, abs=1e-6)
    assert all(run[name]["success"] < 0.5 and run[name]["ne"] > 3 for name in ("RANDOM", "RANDOM-PAPER"))


def test_nobody_to_score_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "r2r", "--scans", str(tmp_path), "--tasks", str(tmp_path / "x.json")]) == 2
    assert "no agent to score" in capsys.readouterr().err


def test_an_agent_whose_output_cannot_be_written_does_not_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from nvsim.cli.commands import r2r_agent

    monkeypatch.setattr(r2r_agent.Benchmark, "read", lambda *_: pytest.fail("the tasks were read"))
    command = ["r2r", "agent", "random", "--scans", str(tmp_path), "--split", "train", "--out", str(tmp_path)]
    assert main(command) == 2 and "it is a folder; name a file" in capsys.readouterr().err
