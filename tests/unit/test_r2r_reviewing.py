"""Tasks under review: verdicts come back from the disk, and an edited graph names the paths that it breaks."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.graph.types import Edge, NavGraph, Viewpoint, edge
from nvsim.r2r.metrics.distances import Distances
from nvsim.r2r.reviewing import export_reviewed, read_folder, scored_episodes, task_error
from nvsim.r2r.tasks.task import Task, read_tasks, write_tasks

TASK = Task(7, "house", ("a", "b", "c"), 1.5, ("Go on.",), 4.0)


def test_verdicts_come_back_and_the_generated_file_stays(tmp_path: Path) -> None:
    file = write_tasks(tmp_path / "R2R_train.json", [TASK, replace(TASK, path_id=8)])
    before = file.read_bytes()
    folder = read_folder(tmp_path)
    key = folder.entries[0].key
    folder.review.set_state(key, "accepted")
    folder.review.set_instructions(key, ["Walk to the sofa."])
    folder.review.write(folder.review_file)
    again = read_folder(tmp_path)
    assert again.review[key] == folder.review[key] and file.read_bytes() == before
    written = export_reviewed(again.entries, again.review, tmp_path / "reviewed")
    assert read_tasks(written[0]) == [replace(TASK, instructions=("Walk to the sofa.",))]
    assert len(read_folder(tmp_path).entries) == 2


def test_changes_are_undone_one_by_one(tmp_path: Path) -> None:
    write_tasks(tmp_path / "R2R_train.json", [TASK])
    folder = read_folder(tmp_path)
    key = folder.entries[0].key
    folder.review.set_state(key, "rejected")
    folder.review.set_state(key, "accepted")
    assert folder.review.undo() == key and folder.review[key].state == "rejected"
    assert folder.review.undo() == key and folder.review[key].state == "" and folder.review.undo() is None


def test_nothing_accepted_writes_nothing(tmp_path: Path) -> None:
    write_tasks(tmp_path / "R2R_train.json", [TASK])
    folder = read_folder(tmp_path)
    with pytest.raises(InputError, match="accepted"):
        export_reviewed(folder.entries, folder.review, tmp_path / "reviewed")
    assert not (tmp_path / "reviewed").exists()


def _fault(edges: str, places: dict[str, tuple[float, float, float]]) -> str:
    graph = NavGraph(
        "house",
        {id: Viewpoint(id, place) for id, place in places.items()},
        {(e[0], e[1]): Edge(e[0], e[1]) for e in edges.split()},
    )
    return task_error(TASK, Distances(graph))


def test_an_edited_graph_names_what_it_breaks() -> None:
    places = {"a": (0.0, 0.0, 1.5), "b": (2.0, 2.0, 1.5), "c": (4.0, 0.0, 1.5)}
    assert _fault("ab bc", places) == ""
    assert "no edge leads from" in _fault("ab", places)
    assert "not in the graph" in _fault("ab", {id: places[id] for id in "ab"})
    # By hand: 2 sqrt(8) = 5.66 m over b, 4 m straight.
    assert _fault("ab bc ac", places) == "a path 1.66 m shorter leads to the goal"


def test_the_command_writes_what_was_accepted_and_with_unread_all_but_the_rejected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_tasks(tmp_path / "R2R_train.json", [replace(TASK, path_id=id) for id in (1, 2, 3)])
    folder = read_folder(tmp_path)
    first, second, _ = (entry.key for entry in folder.entries)
    folder.review.set_state(first, "accepted")
    folder.review.set_instructions(first, ["Walk to the sofa."])
    folder.review.set_state(second, "rejected")
    folder.review.write(folder.review_file)
    assert main(["export", "reviewed", str(tmp_path), "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["splits"]
    assert row == {"split": "R2R_train", "tasks": 3, "accepted": 1, "rejected": 1, "unread": 1, "rewritten": 1}
    written = read_tasks(tmp_path / "reviewed" / "R2R_train.json")
    assert [(task.path_id, task.instructions) for task in written] == [(1, ("Walk to the sofa.",))]
    assert main(["export", "reviewed", str(tmp_path / "R2R_train.json"), "--unread", "--out", str(tmp_path / "o")]) == 0
    assert [task.path_id for task in read_tasks(tmp_path / "o" / "R2R_train.json")] == [1, 3]
    capsys.readouterr()
    assert main(["export", "reviewed", str(tmp_path), "--out", str(tmp_path)]) == 2
    assert "choose another folder" in capsys.readouterr().err
    # The folder of the review is updated; another folder with the same name is not overwritten.
    assert main(["export", "reviewed", str(tmp_path)]) == 0
    assert main(["export", "reviewed", str(tmp_path), "--out", str(tmp_path / "reviewed")]) == 0
    mine = write_tasks(tmp_path / "mine" / "reviewed" / "R2R_train.json", [replace(TASK, path_id=9)])
    capsys.readouterr()
    assert main(["export", "reviewed", str(tmp_path), "--out", str(mine.parent)]) == 2
    assert "choose another folder" in capsys.readouterr().err
    assert [task.path_id for task in read_tasks(mine)] == [9]


def test_files_of_several_folders_have_no_common_review(tmp_path: Path) -> None:
    files = [write_tasks(tmp_path / name / "R2R_train.json", [TASK]) for name in ("a", "b")]
    with pytest.raises(InputError, match="several folders"):
        read_folder(*files)


def test_each_instruction_is_scored_by_its_own_trajectory() -> None:
    at = {"a": (0.0, 0.0, 1.5), "b": (0.0, 4.0, 1.5), "c": (0.0, 8.0, 1.5)}
    edges = [edge("a", "b"), edge("b", "c")]
    graph = NavGraph("house", {id: Viewpoint(id, p) for id, p in at.items()}, {e.key: e for e in edges})
    task = replace(TASK, instructions=("Go on.", "Walk.", "Run."))
    walks = {"7_0": [("a", 0.0, 0.0)], "7_2": [(id, 0.0, 0.0) for id in "abc"]}
    found = scored_episodes([task, replace(task, path_id=8)], walks, Distances(graph))
    assert {id: (one.ne, one.success, one.spl) for id, one in found.items()} == {
        "7_0": (8.0, False, 0.0),
        "7_2": (0.0, True, 1.0),
    }
