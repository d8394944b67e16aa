"""Numbers of hundreds of digits in JSON files: no float can hold them, and every reader says where they are."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from task_samples import exported, house

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.files.opening import is_number, parse_integer, parse_json
from nvsim.geometry.camera_path import read_camera_path
from nvsim.graph.connectivity import read_connectivity
from nvsim.graph.edits import EditError
from nvsim.graph.foreign import ForeignFile
from nvsim.graph.operations import apply, parse_line
from nvsim.r2r.metrics.submission import read_submission
from nvsim.r2r.simulator import Simulator
from nvsim.r2r.simulator.conventions import InvalidValue
from nvsim.r2r.simulator.scan import read_scan
from nvsim.r2r.tasks.task import read_tasks

HUGE = [10**400, -(10**400), 10**4299]
BEYOND = "1" + "0" * 5000  # which Python itself refuses to read


@pytest.fixture
def graph_file(tmp_path: Path) -> Path:
    exported(tmp_path, house("s"))
    (path,) = tmp_path.rglob("s_connectivity.json")
    return path


def spoiled(path: Path, change: Callable[[Any, Any], None], number: int | str) -> Path:
    """The file with a number in it that no float can hold."""
    tree = json.loads(path.read_text())
    change(tree, 987654321)
    path.write_text(json.dumps(tree).replace("987654321", str(number)))
    return path


def in_pose(tree: Any, number: int) -> None:
    tree[1]["pose"][3] = number


def in_height(tree: Any, number: int) -> None:
    tree[1]["height"] = number


def in_flags(tree: Any, number: int) -> None:
    tree[1]["unobstructed"][0] = number


@pytest.mark.parametrize("number", [*map(str, HUGE), BEYOND], ids=lambda digits: str(len(digits)))
@pytest.mark.parametrize("change", [in_pose, in_height, in_flags])
def test_a_connectivity_file_is_refused_with_the_entry(
    graph_file: Path, change: Callable[[Any, Any], None], number: str
) -> None:
    spoiled(graph_file, change, number)
    for read in (read_connectivity, ForeignFile.open):
        with pytest.raises(InputError, match="connectivity" if number == BEYOND else "entry 1|viewpoint 1"):
            read(graph_file)
    if change is not in_height:  # which the simulator does not read
        with pytest.raises(InvalidValue, match="connectivity" if number == BEYOND else "entry 1.*not a finite number"):
            read_scan(graph_file, "s")


def test_the_simulator_raises_what_callers_expect(graph_file: Path) -> None:
    spoiled(graph_file, in_pose, 10**400)
    simulator = Simulator()
    simulator.setNavGraphPath(str(graph_file.parent))
    simulator.setRenderingEnabled(False)
    simulator.initialize()
    (first, *_) = (entry["image_id"] for entry in json.loads(graph_file.read_text()))
    with pytest.raises(InvalidValue, match="entry 1"):
        simulator.newEpisode(["s"], [first], [0.0], [0.0])


@pytest.mark.parametrize("number", [*map(str, HUGE), BEYOND], ids=lambda digits: str(len(digits)))
def test_tasks_and_trajectories_are_refused_with_the_item(tmp_path: Path, number: str) -> None:
    task = {"path_id": 1, "scan": "s", "path": ["a", "b"], "heading": 0.5, "distance": 2.0, "instructions": []}
    for key in ("path_id", "heading", "distance"):
        path = tmp_path / f"{key}.json"
        path.write_text(json.dumps([{**task, key: 987654321}]).replace("987654321", number))
        with pytest.raises(InputError, match="tasks" if number == BEYOND else f"item 0: {key} is"):
            read_tasks(path)
    path = tmp_path / "submission.json"
    path.write_text('[{"instr_id": "1_0", "trajectory": [["a", NUMBER, 0]]}]'.replace("NUMBER", number))
    with pytest.raises(InputError, match="submission" if number == BEYOND else r"item 0 \(1_0\), step 0: heading"):
        read_submission(path)


@pytest.mark.parametrize("number", [*map(str, HUGE), BEYOND], ids=lambda digits: str(len(digits)))
def test_edits_of_scripts_and_of_the_command_line_are_refused(
    graph_file: Path, number: str, capsys: pytest.CaptureFixture[str]
) -> None:
    graph = house("s")
    (first, *_) = graph.viewpoints
    for line in (
        '{"edit": "move_viewpoint", "id": "ID", "position": [0, NUMBER, 0]}',
        '{"edit": "set_height", "ids": ["ID"], "height": NUMBER}',
        '{"edit": "align_viewpoints", "ids": ["ID"], "spacing": NUMBER}',
    ):
        with pytest.raises(EditError):
            name, values = parse_line(line.replace("ID", first).replace("NUMBER", number))
            apply(graph, name, values)
    assert main(["graph", "edit", str(graph_file), "join_near", "--set", f"distance={number}"]) == 2
    assert "a bug in NVSim" not in capsys.readouterr().err


def test_a_camera_path_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "path.json"
    path.write_text(f'{{"format": 1, "seconds": {10**400}, "keys": [{{"position": [0, 0, {10**400}]}}]}}')
    with pytest.raises(InputError):
        read_camera_path(path)


def test_whole_numbers_stay_exact_as_far_as_a_float_reaches() -> None:
    assert parse_integer("12345678901234567890123") == 12345678901234567890123
    assert parse_integer("-" + "9" * 298) == -int("9" * 298)
    assert parse_integer("9" * 400) == float("inf") and parse_integer("-" + "9" * 400) == -float("inf")
    assert parse_json(Path("x"), "[1, 2.5]", "a list", "") == [1, 2.5]


def test_what_counts_as_a_number() -> None:
    assert is_number(1) and is_number(-2.5) and is_number(10**300)
    for value in (True, "1", None, float("nan"), float("inf"), 10**400, -(10**5000)):
        assert not is_number(value)
