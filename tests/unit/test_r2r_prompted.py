"""Models that see are asked for instructions and for the way, over HTTP; answers become tasks and trajectories."""

from __future__ import annotations

import base64
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import networkx as nx
import numpy as np
import pytest
from endpoint_server import Asked, Behavior, Reply, Service, said, serving, words_of, wrong
from export_samples import save_jpeg, sky, strip
from task_samples import as_agents_load, exported, house

from nvsim.cli.main import main
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.graph.types import NavGraph
from nvsim.r2r.prompted.mapgpt_episode import Places
from nvsim.r2r.prompted.views import bearing
from nvsim.r2r.tasks.task import read_tasks

GRAPH = house("one", 6)


@pytest.fixture(autouse=True)
def no_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.delenv("NVSIM_ENDPOINT_KEY", raising=False)


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A house whose colors say where one looks."""
    root = exported(tmp_path_factory.mktemp("scans"), GRAPH)
    first, *others = GRAPH.viewpoints
    folder = root / GRAPH.scan / "matterport_skybox_images"
    save_jpeg(folder / f"{first}_skybox_small.jpg", strip())
    for id in others:
        os.link(folder / f"{first}_skybox_small.jpg", folder / f"{id}_skybox_small.jpg")
    return root


def asking(service: Service, *more: str) -> list[str]:
    quick = ["--first-wait", "0.001", "--timeout", "5", "--image-width", "64", "--yes"]
    return ["--endpoint", service.url, "--model", "seer", *quick, *more]


def small(scans: Path, out: Path, *more: str) -> list[str]:
    few = ["--train", "6", "--val-seen", "2", "--val-unseen", "4"]
    return ["export", "tasks", "--scans", str(scans), "--out", str(out), *few, *more]


def writer(n: int, asked: Asked) -> Reply:
    """Three instructions that say how many images were sent."""
    texts = [
        f"Walk the way that {len(asked.images)} images show, wording {k} of {hash(asked.words)}." for k in range(3)
    ]
    return said("Here you are:\n```json\n" + json.dumps({"instructions": texts}) + "\n```", 900, 60)


def test_instructions_are_asked_with_views_along_the_path(
    scans: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(small(scans, tmp_path / "plain")) == 0
    with serving(writer) as service:
        command = small(
            scans, tmp_path / "asked", "--joined", "2", *asking(service), "--price-in", "1", "--price-out", "4"
        )
        assert main(command) == 0
        first = capsys.readouterr()
        assert main(command) == 0  # all answers are there
        again = capsys.readouterr()
    assert (
        "To seer at http://127.0.0.1" in first.err
        and "12 requests with" in first.err
        and "price at most 0." in first.err
    )
    assert "nothing: all 12 answers are stored" in again.err and len(service.asked) == 12
    about = json.loads((tmp_path / "asked" / "tasks.json").read_text())["instructions"]["endpoint"]
    assert about["model"] == "seer" and about["paths"] == 12 and about["generated_instead"] == {}
    assert about["tokens_in"] == 12 * 900 and about["price"] == pytest.approx(12 * (900 + 4 * 60) / 1e6)
    total = 0
    for split in ("train", "val_seen", "val_unseen"):
        plain = read_tasks(tmp_path / "plain" / f"R2R_{split}.json")
        told = read_tasks(tmp_path / "asked" / f"R2R_{split}.json")
        for before, after in zip(plain, told, strict=True):
            assert before.path == after.path and len(after.instructions) == 3
            # The start, every step, and the goal to four sides.
            assert f"that {1 + len(after.path) - 1 + 4} images show" in after.instructions[0]
            assert about["generated"][str(after.path_id)] == list(before.instructions)
            total += 1
    assert total == 12
    told_of = {t.path_id: t for s in ("train", "val_seen") for t in read_tasks(tmp_path / "asked" / f"R2R_{s}.json")}
    for joined in json.loads((tmp_path / "asked" / "R4R_train.json").read_text()):
        assert told_of[joined["first_path_id"]].instructions[0] in joined["instructions"][0]


def test_the_views_look_along_the_path(scans: Path, tmp_path: Path) -> None:
    with serving(writer) as service:
        assert main(small(scans, tmp_path / "asked", *asking(service))) == 0
    tasks = [t for s in ("train", "val_seen", "val_unseen") for t in read_tasks(tmp_path / "asked" / f"R2R_{s}.json")]
    by_heading = {}
    for asked in service.asked:
        meters = tuple(re.findall(r"Step \d+: [^.]*?(\d+\.\d) m", asked.words))
        by_heading.setdefault(meters, []).append(asked)
    checked = 0
    for task in tasks:
        ways = [bearing(GRAPH, a, b) for a, b in zip(task.path, task.path[1:])]
        for asked in by_heading[tuple(f"{way.meters:.1f}" for way in ways)]:
            headings = [task.heading, *(way.heading for way in ways)]
            middles = [_middle(url) for url in asked.images[: len(headings)]]
            wanted = [
                sky(Camera(Intrinsics(1, 1, 1, 1, 0.5, 0.5), camera_pose(np.zeros(3), h or 0)).rays()[0, 0])
                for h in headings
            ]
            if np.abs(np.array(middles) - np.array(wanted, float)).max() < 8:
                checked += 1
                break
        else:
            pytest.fail(f"nobody was asked for {task.path_id}")
    assert checked == 12


def _middle(url: str) -> np.ndarray:
    data = base64.b64decode(url.partition(",")[2])
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert image.shape == (48, 64, 3)
    return image[22:26, 30:34].reshape(-1, 3).mean(axis=0)


def test_paths_that_the_model_will_not_describe_keep_what_was_made_here(
    scans: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def moody(n: int, asked: Asked) -> Reply:
        meters = re.findall(r"(\d+\.\d) m", words_of(asked.body["messages"][1]))
        mood = round(10 * sum(map(float, meters))) % 4
        if mood == 0:
            return said(None, refusal="I do not describe homes.")
        if mood == 1:
            return said('{"instructions": ["only one of them here"]}')
        if mood == 2 and len(asked.body["messages"]) == 2:
            return said('{"instructions": ["same words here", "same words here", "other words here"]}')
        return writer(n, asked)

    with serving(moody) as service:
        assert main(small(scans, tmp_path, *asking(service))) == 0
    err = capsys.readouterr().err
    about = json.loads((tmp_path / "tasks.json").read_text())["instructions"]["endpoint"]
    lacking = about["generated_instead"]
    assert 0 < about["paths"] < 12 and len(lacking) == 12 - about["paths"]
    assert any("it refused (I do not describe homes.)" in why for why in lacking.values())
    assert any("there were 1 instructions and not 3" in why for why in lacking.values())
    for split in ("train", "val_seen", "val_unseen"):
        for task in read_tasks(tmp_path / f"R2R_{split}.json"):
            assert ("images show" in task.instructions[0]) == (str(task.path_id) not in lacking)
            assert (f"path_id {task.path_id} has no instructions from the model" in err) == (
                str(task.path_id) in lacking
            )


def test_nothing_is_sent_and_nothing_written_without_consent(
    scans: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with serving(writer) as service:
        command = small(scans, tmp_path / "out", *asking(service))
        command.remove("--yes")
        assert main(command) == 2
        monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
        monkeypatch.setattr("sys.stdin.readline", lambda: "\n", raising=False)
        assert main(command) == 2
    assert not service.asked and not (tmp_path / "out").exists()
    err = capsys.readouterr().err
    assert "give --yes" in err and "Send this? [y/N]" in err and "12 requests" in err


def test_an_endpoint_that_fails_writes_no_dataset_and_the_next_call_goes_on(scans: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with serving(lambda n, asked: writer(n, asked) if n < 5 else wrong(401, "expired")) as service:
        assert main(small(scans, out, *asking(service, "--parallel", "1"))) == 2
        assert not list(out.glob("*.json")) and len(service.asked) == 6
        service.behave = writer
        assert main(small(scans, out, *asking(service))) == 0
    assert len(service.asked) == 6 + 7 and (out / "R2R_train.json").is_file()


# The agent ------------------------------------------------------------------------------------------------------------


def oracle(graph: NavGraph, goals: dict[str, str], starts: dict[str, str]) -> Behavior:
    """Takes the shortest path to the goal that the instruction names, using only the prompt."""
    agents = as_agents_load(graph)

    def behave(n: int, asked: Asked) -> Reply:
        name = re.search(r"Instruction: go to (\w+)", asked.words)
        actions = dict(re.findall(r"^([A-Z]): (.*)$", asked.words, re.MULTILINE))
        walked = [int(k) for k in re.search(r"Trajectory: ([\d ]+)", asked.words)[1].split()]
        places = Places(graph, starts[name[1]])
        for number in walked[1:]:
            places.move_to(next(id for id, k in places.number.items() if k == number))
        assert len(asked.images) == min(20, len(places.seen_from) - (places.current in places.seen_from))
        stop = next((letter for letter, words in actions.items() if words.startswith("stop")), None)
        if places.current == goals[name[1]]:
            letter = stop or "A"  # too early to stop: off and back
        else:
            to = nx.shortest_path(agents, places.current, goals[name[1]], "weight")[1]
            number = places.number[to]
            letter = next(a for a, words in actions.items() if re.search(rf"to place {number}\b", words))
        return said(json.dumps({"thought": "on my way", "plan": f"{len(walked)} places", "action": letter}), 1000, 30)

    return behave


@pytest.fixture
def tasks(scans: Path, tmp_path: Path) -> Path:
    """Eight paths that are told by name."""
    assert (
        main(["export", "tasks", "--scans", str(scans), "--out", str(tmp_path), "--train", "8", "--instructions", "1"])
        == 0
    )
    path = tmp_path / "R2R_train.json"
    items = json.loads(path.read_text())
    for item in items:
        item["instructions"] = [f"go to goal{item['path_id']} please"]
    path.write_text(json.dumps(items))
    return path


def ends(tasks: Path) -> tuple[dict[str, str], dict[str, str]]:
    found = {f"goal{t.path_id}": t.path for t in read_tasks(tasks)}
    return {n: p[-1] for n, p in found.items()}, {n: p[0] for n, p in found.items()}


def agent(scans: Path, tasks: Path, out: Path, *more: str) -> list[str]:
    return ["r2r", "agent", "mapgpt", "--scans", str(scans), "--tasks", str(tasks), "--out", str(out), *more]


def test_an_agent_whose_model_knows_the_way_arrives(
    scans: Path, tasks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mapgpt.json"
    with serving(oracle(GRAPH, *ends(tasks))) as service:
        capsys.readouterr()
        assert main(agent(scans, tasks, out, *asking(service, "--json"))) == 0
        ran = capsys.readouterr()
        figures = json.loads(ran.out.splitlines()[-1])
        sent = len(service.asked)
        assert main(agent(scans, tasks, out, *asking(service, "--json"))) == 0
        assert len(service.asked) == sent
    edges = sum(len(t.path) - 1 for t in read_tasks(tasks))
    assert figures["stopped"] == 8 and sent == edges + 8 == figures["asked"]
    assert f"{edges + 8} requests" in ran.err or "requests with" in ran.err
    assert (
        main(["evaluate", "r2r", "--scans", str(scans), "--tasks", str(tasks), "--submission", str(out), "--json"]) == 0
    )
    scored = json.loads(capsys.readouterr().out.splitlines()[-1])["agents"]["mapgpt"]
    assert (
        scored["success"] == 1
        and scored["ne"] == 0
        and scored["spl"] == pytest.approx(1)
        and scored["ndtw"] == pytest.approx(1)
    )


def test_every_step_says_what_is_known_of_the_map(scans: Path, tasks: Path, tmp_path: Path) -> None:
    with serving(oracle(GRAPH, *ends(tasks))) as service:
        assert main(agent(scans, tasks, tmp_path / "a.json", *asking(service, "--parallel", "1"))) == 0
    one = [a.words for a in service.asked if "goal1 " in a.words]
    assert [re.search(r"Step (\d+) of at most 15", words)[1] for words in one] == [str(k + 1) for k in range(len(one))]
    assert "History:\nNone yet." in one[0] and "Plan: None yet." in one[0] and "stop here" not in one[2]
    assert (
        re.search(r"Step 1: (go straight ahead|turn \w+( \w+)? and go) \d\.\d m, to place", one[1])
        and "Plan: 1 places" in one[1]
        and "stop here" in one[3]
    )
    # All edges that the words name are edges, and all places that one was at have all of theirs.
    task = read_tasks(tasks)[0]
    places = Places(GRAPH, task.path[0])
    for id in task.path[1:]:
        places.move_to(id)
    ids = {number: id for id, number in places.number.items()}
    lines = re.findall(r"Place (\d+) is joined to ([\d, ]+)\.", one[-1])
    assert {ids[int(k)] for k, _ in lines} == set(task.path)
    for k, others in lines:
        assert {ids[int(o)] for o in others.split(", ")} == set(GRAPH.neighbors(ids[int(k)]))


def test_an_agent_that_always_goes_ahead_goes_ahead(scans: Path, tasks: Path, tmp_path: Path) -> None:
    """The first action is the nearest to where one looks; after the last step the episode ends where it is."""
    with serving(lambda n, asked: said('{"action": "(a) ahead", "plan": 7}')) as service:
        assert main(agent(scans, tasks, tmp_path / "a.json", *asking(service, "--steps", "5"))) == 0
    walked = {item["instr_id"]: item["trajectory"] for item in json.loads((tmp_path / "a.json").read_text())}
    for task in read_tasks(tasks):
        here, facing, expected = task.path[0], task.heading, [task.path[0]]
        for _ in range(5):
            x, y, _ = GRAPH.viewpoints[here].position
            around = {
                id: math.atan2(GRAPH.viewpoints[id].position[0] - x, GRAPH.viewpoints[id].position[1] - y)
                for id in GRAPH.neighbors(here)
            }
            here = min(around, key=lambda id: abs((around[id] - facing + math.pi) % (2 * math.pi) - math.pi))
            facing = around[here]
            expected.append(here)
        assert [pose[0] for pose in walked[f"{task.path_id}_0"]] == expected


def test_bad_answers_end_an_episode_where_it_is(
    scans: Path, tasks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def moody(n: int, asked: Asked) -> Reply:
        goal = int(re.search(r"go to goal(\d+)", asked.body["messages"][1]["content"][0]["text"])[1])
        later = "Trajectory: 0\n" not in asked.body["messages"][1]["content"][0]["text"]
        if goal % 3 == 0 and later:
            return said('{"action": "Z"}')
        if goal % 3 == 1 and later:
            return said(None, refusal="No more.")
        stop = re.search(r"^([A-Z]): stop", asked.words, re.MULTILINE)
        return said(json.dumps({"action": stop[1] if stop else "A"}))

    out = tmp_path / "a.json"
    with serving(moody) as service:
        assert main(agent(scans, tasks, out, *asking(service))) == 0
    err = capsys.readouterr().err
    for task in read_tasks(tasks):
        id = f"{task.path_id}_0"
        record = json.loads((tmp_path / "a.episodes" / f"{id}.json").read_text())
        if task.path_id % 3 == 2:
            assert record["ended"] == "stop" and len(record["trajectory"]) == 4
        else:
            words = '"action" must be one letter' if task.path_id % 3 == 0 else "it refused (No more.)"
            assert record["ended"] == "unanswered" and words in record["why"] and len(record["trajectory"]) == 2
            assert f"{id} ends at step 2: {record['why']}" in err
    assert main(["evaluate", "r2r", "--scans", str(scans), "--tasks", str(tasks), "--submission", str(out)]) == 0


def test_without_any_usable_answer_the_commands_fail(
    scans: Path, tasks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with serving(lambda n, asked: said(None, refusal="Never.")) as service:
        assert main(agent(scans, tasks, tmp_path / "a.json", *asking(service))) == 1
        assert capsys.readouterr().err.splitlines()[-1].startswith("error: no answer of ")
        assert main(small(scans, tmp_path / "tasks", *asking(service))) == 1
        assert capsys.readouterr().err.splitlines()[-1].startswith("error: no answer of ")
    assert (tmp_path / "a.json").exists() and (tmp_path / "tasks" / "R2R_train.json").exists()


def test_a_missing_package_is_reported_before_any_work(
    scans: Path, tasks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = sorted(tmp_path.iterdir())
    for name in ("httpx2", "lmdb"):
        monkeypatch.setitem(sys.modules, name, None)
    endpoint = ["--endpoint", "http://localhost/v1", "--model", "m", "--yes"]
    judged = ["evaluate", "judge", "--folders", str(tmp_path), str(scans), "--out", str(tmp_path / "judge")]
    for command in (
        [*small(scans, tmp_path / "tasks"), *endpoint],
        [*agent(scans, tasks, tmp_path / "a.json"), *endpoint],
        [*judged, "--judges", "m@http://localhost/v1", "--yes"],
    ):
        assert main(command) == 2 and "pip install 'nvsim[endpoint]'" in capsys.readouterr().err
    features = ["export", "features", str(scans), "--projection", "--out", str(tmp_path / "features")]
    assert main([*features, "--layout", "vit-b16", "eva-g"]) == 2
    assert "the extra navgpt2" in capsys.readouterr().err and sorted(tmp_path.iterdir()) == before


def test_a_budget_ends_the_run_and_what_was_done_stays(
    scans: Path, tasks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "a.json"
    with serving(oracle(GRAPH, *ends(tasks))) as service:
        limited = ["--parallel", "2", "--budget-tokens", "25000"]
        assert main(agent(scans, tasks, out, *asking(service, *limited))) == 2
        assert "The budget is spent" in capsys.readouterr().err and not out.exists()
        sent = len(service.asked)
        assert sent * 1030 <= 25000 and list((tmp_path / "a.episodes").glob("*_0.json"))
        # Episodes that were finished count as well: the same budget holds over both calls.
        assert main(agent(scans, tasks, out, *asking(service, *limited))) == 2
        assert sent <= len(service.asked) <= 25000 // 1030
        assert main(agent(scans, tasks, out, *asking(service))) == 0
    assert len(service.asked) == sum(len(t.path) for t in read_tasks(tasks))


def test_after_a_kill_the_agent_goes_on_and_asks_nothing_twice(scans: Path, tasks: Path, tmp_path: Path) -> None:
    know = oracle(GRAPH, *ends(tasks))

    def hangs(n: int, asked: Asked) -> Reply:
        return know(n, asked) if n < 17 else Reply("{}", after=30)

    out = tmp_path / "a.json"
    with serving(hangs) as service:
        options = agent(scans, tasks, out, *asking(service, "--parallel", "1", "--timeout", "60"))
        process = subprocess.Popen([sys.executable, "-m", "nvsim", *options], stderr=subprocess.DEVNULL)
        try:
            until = time.monotonic() + 60
            while len(service.asked) < 18 and time.monotonic() < until and process.poll() is None:
                time.sleep(0.01)
            os.kill(process.pid, signal.SIGKILL)
        finally:
            process.kill()
            process.wait()
        assert len(service.asked) == 18 and not out.exists()
        service.behave = know
        assert main(options) == 0
    keys = [json.dumps(asked.body, sort_keys=True) for asked in service.asked if asked.answered]
    assert len(keys) == len(set(keys)) == sum(len(t.path) for t in read_tasks(tasks)) == len(service.asked) - 1


def test_what_cannot_be_run_is_said(
    scans: Path, tasks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(command: list[str]) -> str:
        capsys.readouterr()
        assert main(command) == 2
        return capsys.readouterr().err

    out = tmp_path / "a.json"
    assert "give --endpoint URL" in refused(agent(scans, tasks, out))
    here: list[Any] = ["--endpoint", "http://127.0.0.1:9/v1", "--model", "m"]
    assert "asks no model" in refused(["r2r", "agent", "random", *agent(scans, tasks, out)[3:], *here])
    bad = tmp_path / "prompt.txt"
    bad.write_text("[system]\n[user]\n$instruction\n[again]\n")
    assert "$trajectory is missing" in refused(agent(scans, tasks, out, *here, "--prompt", str(bad)))
    plain = tmp_path / "plain.json"
    plain.write_text(json.dumps([{**item, "instructions": []} for item in json.loads(tasks.read_text())]))
    assert "has no instruction" in refused(agent(scans, plain, out, *here))
    assert "--instructions 0 excludes them" in refused(small(scans, tmp_path / "o", "--instructions", "0", *here))
    assert "needs prices" in refused(small(scans, tmp_path / "o", "--budget-money", "3", *here))
