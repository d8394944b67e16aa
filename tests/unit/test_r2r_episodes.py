"""Actions lead along the path to its end and touch nothing; the files are those that VLN-CE and StreamVLN read."""

from __future__ import annotations

import gzip
import json
import math
from pathlib import Path

import numpy as np
import pytest
from boxed_scan import Block, export_blocks, flat_house
from numpy.typing import NDArray

from nvsim.cli.main import main
from nvsim.r2r.episodes.episode import Episode, Scene, in_habitat, rotation_of, tokens
from nvsim.r2r.surroundings.layers import layers_of
from nvsim.r2r.surroundings.visibility import views_from_viewpoints
from nvsim.r2r.tasks.splitting import Impassable
from nvsim.r2r.tasks.task import Task

ROBOT = 0.25


def scene_in(folder: Path, door: float) -> tuple[list[Block], Scene]:
    blocks, graph = flat_house(door)
    root = export_blocks(folder, blocks, graph)
    return blocks, Scene(graph, list(layers_of(list(views_from_viewpoints(root, graph)), graph)))


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Block], Scene]:
    return scene_in(tmp_path_factory.mktemp("wide"), 0.9)


def replayed(start: NDArray[np.float64], heading: float, actions: list[int]) -> NDArray[np.float64]:
    """(N, 2) places 2.5 cm apart of one who does the actions."""
    place, places = np.array(start, float), [np.array(start, float)]
    for action in actions:
        heading += math.radians({2: -15, 3: 15}.get(action, 0))
        if action == 1:
            for _ in range(10):
                place = place + 0.025 * np.array([math.sin(heading), math.cos(heading)])
                places.append(place)
    return np.array(places)


def touched(blocks: list[Block], places: NDArray[np.float64]) -> float:
    """Meters to the nearest box in the way of a robot."""
    standing = [block for block in blocks if block.hi[2] > 0.05 and block.lo[2] < 1.7]
    return min(float(block.meters_to(places).min()) for block in standing)


@pytest.mark.parametrize("path, heading", [("abcfgh", 0.0), ("hgfce", 2.0), ("iha"[:2] + "gfcb", 5.5), ("adeb", 1.0)])
def test_actions_lead_to_the_goal_and_touch_nothing(
    house: tuple[list[Block], Scene], path: str, heading: float
) -> None:
    blocks, scene = house
    episode = scene.episode(Task(1, "boxes", tuple(path), heading, ("Go.",)))
    assert isinstance(episode, Episode)
    actions = list(episode.walk.actions)
    assert actions[-1] == 0 and 0 not in actions[:-1] and set(actions) <= {0, 1, 2, 3}
    places = replayed(episode.walk.places[0], heading, actions)
    assert np.hypot(*(places[-1] - episode.path[-1, :2])) <= 0.3 + 1e-9
    assert touched(blocks, places) >= ROBOT
    assert len(episode.walk.places) == len(episode.walk.headings) == len(actions) == len(episode.floors)
    meters = np.linalg.norm(np.diff(episode.path, axis=0), axis=1).sum()
    assert actions.count(1) * 0.25 <= 1.25 * meters + 0.5


def test_a_path_through_a_door_that_is_too_narrow_has_no_episode(tmp_path: Path) -> None:
    _, scene = scene_in(tmp_path, 0.45)
    assert scene.episode(Task(1, "boxes", ("b", "c", "f", "g"), 0.0)) is None
    assert scene.episode(Task(2, "boxes", ("a", "b", "e", "d"), 0.0)) is not None
    assert scene.impassable().edges == (("c", "f"),) and scene.impassable().ends == ()


def test_sampled_paths_avoid_a_door_that_is_too_narrow(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    blocks, graph = flat_house(0.45)
    scans, out = export_blocks(tmp_path / "scans", blocks, graph), tmp_path / "tasks"
    command = ["export", "tasks", "--scans", str(scans), "--out", str(out), "--fewest-edges", "2"]
    command += ["--least-meters", "3", "--train", "20", "--val-seen", "4", "--val-unseen", "0"]

    def through_the_door() -> list[bool]:
        tasks = [task for name in ("train", "val_seen") for task in json.loads((out / f"R2R_{name}.json").read_text())]
        return [{"c", "f"} <= set(task["path"]) for task in tasks]

    assert main([*command, "--json"]) == 0
    assert any(through_the_door())
    capsys.readouterr()
    assert main([*command, "--vlnce"]) == 0
    told = capsys.readouterr()
    crossing = through_the_door()
    assert crossing and not any(crossing)
    assert f"{len(crossing)} of {len(crossing)} paths have episodes." in told.out
    assert "avoid 1 edge too narrow for a robot (c to f)" in " ".join((told.out + told.err).split())
    assert json.loads((out / "tasks.json").read_text())["impassable"]["boxes"] == {"edges": [["c", "f"]], "ends": []}


def test_what_a_cloud_knows_is_not_touched(house: tuple[list[Block], Scene], tmp_path: Path) -> None:
    blocks, graph = flat_house()
    storeys = list(layers_of(list(views_from_viewpoints(export_blocks(tmp_path, blocks, graph), graph)), graph))
    post = np.stack(np.meshgrid(np.arange(8.9, 9.2, 0.03), np.arange(0.0, 1.6, 0.03), 1.0), axis=-1).reshape(-1, 3)
    task = Task(1, "boxes", ("f", "g", "h"), 1.5)
    assert Scene(graph, storeys).episode(task) is not None
    assert Scene(graph, storeys, post).episode(task) is None
    assert Scene(graph, storeys).impassable() == Impassable()
    assert Scene(graph, storeys, post).impassable() == Impassable((("g", "h"),))
    at_g = Scene(graph, storeys, post - [0.85, 0.0, 0.0])  # around (8.2, 0.8)
    assert at_g.episode(task) is None and at_g.impassable().ends == ("g",)


@pytest.mark.parametrize("degrees", [0, 30, 90, 200, 315])
def test_rotations_turn_habitats_ahead_to_where_one_looks(degrees: float) -> None:
    heading = math.radians(degrees)
    x, y, z, w = rotation_of(heading)
    axis, ahead = np.array([x, y, z]), np.array([0.0, 0.0, -1.0])
    turned = ahead + 2 * np.cross(axis, np.cross(axis, ahead) + w * ahead)
    ours = np.array([[math.sin(heading), math.cos(heading), 0.0]])
    assert turned == pytest.approx(np.array(in_habitat(ours)[0]), abs=2e-3)
    assert in_habitat(np.array([[0.0, 0.0, 2.0]]))[0] == [0.0, 2.0, 0.0]  # up is y


def test_files_are_as_their_readers_want_them(tmp_path: Path) -> None:
    blocks, graph = flat_house()
    scans, out = export_blocks(tmp_path / "scans", blocks, graph), tmp_path / "tasks"
    few = ["--fewest-edges", "2", "--least-meters", "3", "--train", "6", "--val-seen", "2", "--val-unseen", "0"]
    command = ["export", "tasks", "--scans", str(scans), "--out", str(out), *few]
    assert main([*command, "--vlnce", "--streamvln", "--json"]) == 0
    tasks = {task["path_id"]: task for task in json.loads((out / "R2R_train.json").read_text())}
    with gzip.open(out / "vlnce/train/train.json.gz", "rt") as file:
        data = json.load(file)
    with gzip.open(out / "vlnce/train/train_gt.json.gz", "rt") as file:
        truth = json.load(file)
    words = data["instruction_vocab"]["word_list"]
    assert words[:2] == ["<pad>", "<unk>"] and len(set(words)) == len(words)
    assert (
        len({item["episode_id"] for item in data["episodes"]}) == len(data["episodes"]) == len(truth) == 3 * len(tasks)
    )
    for item in data["episodes"]:
        task, acted = tasks[item["trajectory_id"]], truth[str(item["episode_id"])]
        text, numbers = item["instruction"]["instruction_text"], item["instruction"]["instruction_tokens"]
        assert text in task["instructions"] and len(numbers) == 200
        known = [words[n] if words[n] != "<unk>" else None for n in numbers if n]
        assert all(a is None or a == b for a, b in zip(known, tokens(text))) and len(known) == len(tokens(text))
        places = [graph.viewpoints[id].position for id in task["path"]]
        assert item["reference_path"] == [[round(x, 3), round(z - 1.5, 3), round(-y, 3)] for x, y, z in places]
        assert item["start_position"] == item["reference_path"][0]
        assert item["goals"] == [{"position": item["reference_path"][-1], "radius": 3.0}]
        assert item["start_rotation"] == rotation_of(task["heading"]) and item["scene_id"].endswith("boxes.glb")
        assert len(acted["locations"]) == len(acted["actions"]) and acted["forward_steps"] == acted["actions"].count(1)
    for item in json.loads((out / "streamvln/train/annotations.json").read_text()):
        actions = truth[str(100 * item["id"])]["actions"]
        assert item["actions"] == [-1, *actions[:-1]] and item["instructions"] == tasks[item["id"]]["instructions"]
    # Without them, those of before go: they were of other paths.
    assert main([*command, "--seed", "1"]) == 0
    assert not (out / "vlnce/train/train.json.gz").exists() and (out / "surroundings.json").exists()


def test_episodes_need_strips_with_depth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from task_samples import exported, house

    scans = exported(tmp_path, house("one", 5))
    assert main(["export", "tasks", "--scans", str(scans), "--out", str(tmp_path / "t"), "--vlnce"]) == 2
    assert "no strips with depth" in capsys.readouterr().err and not (tmp_path / "t").exists()
