"""Tasks under review: verdicts come back from the disk, and an edited graph names the paths that it breaks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from nvsim.errors import InputError
from nvsim.graph.types import Edge, NavGraph, Viewpoint
from nvsim.r2r.metrics.distances import Distances
from nvsim.r2r.reviewing.faults import fault
from nvsim.r2r.reviewing.folder import export_reviewed, read_folder
from nvsim.r2r.tasks.task import Task
from nvsim.r2r.tasks.task_files import read_tasks, write_tasks

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
    return fault(TASK, Distances(graph))


def test_an_edited_graph_names_what_it_breaks() -> None:
    places = {"a": (0.0, 0.0, 1.5), "b": (2.0, 2.0, 1.5), "c": (4.0, 0.0, 1.5)}
    assert _fault("ab bc", places) == ""
    assert "no edge leads from" in _fault("ab", places)
    assert "not in the graph" in _fault("ab", {id: places[id] for id in "ab"})
    # By hand: 2 sqrt(8) = 5.66 m over b, 4 m straight.
    assert _fault("ab bc ac", places) == "a way 1.66 m shorter leads to the goal"
