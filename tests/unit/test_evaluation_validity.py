"""The table of validities without any training: its columns, and how it is written."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from columns import Columns, flat_floor, room

from nvsim.evaluation.graph import evaluate_graph
from nvsim.evaluation.validity import COLUMNS, ValidityCell, ValidityTable, with_criteria
from nvsim.evaluation.validity_report import csv_of, latex_of, text_of, write_validity
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import decide

OCCUPANCY, WALK = room(6, 4), np.array([[1.0, 2.0, 1.2], [3.0, 2.0, 1.2]])


def test_a_column_asks_for_its_criteria_alone() -> None:
    config = MappingConfig(view_size=96)
    world = Columns(room(4, 4), noise=0.2)
    graph = build_map(
        world, WALK, flat_floor, world.support, MappingConfig(view_size=96, row_alpha=0.4), scan="t"
    ).graph

    def words(criteria: tuple[str, ...]) -> set[str]:
        asked = with_criteria(config, criteria)
        assert asked is not None
        return {decide(e, asked) for e in graph.evidence.values()}

    assert words(("alpha", "normal")) == {decide(e, config) for e in graph.evidence.values()} >= {"open", "alpha"}
    assert "normal" not in words(("alpha",)) and "alpha" in words(("alpha",))
    assert "alpha" not in words(("normal",)) and "normal" in words(("normal",))
    assert "unknown" in words(("normal",)), "known floor is asked for whatever the column says"
    assert with_criteria(config, ("alpha", "nonsense")) is None and with_criteria(config, ()) is None
    assert with_criteria(config, COLUMNS[0]) == config


@pytest.fixture
def table() -> ValidityTable:
    """One model has a map of three viewpoints, one outside the room; the other has none."""
    places = {"a": (1, 1), "b": (4, 1), "c": (-2, 2)}
    viewpoints = {id: Viewpoint(id, (x, y, 1.2)) for id, (x, y) in places.items()}
    graph = NavGraph("t", viewpoints, {("a", "b"): edge("a", "b"), ("a", "c"): edge("a", "c")})
    figures = {**evaluate_graph(graph, OCCUPANCY, WALK[:, :2], seen=lambda xy: xy[..., 0] < 3), "seconds": 1.5}
    criteria = ("alpha", "normal")
    cells = [
        ValidityCell("nvsim", criteria, figures, graph),
        ValidityCell("3dgs", criteria, {}, None, "Nobody can stand anywhere."),
    ]
    return ValidityTable(("nvsim", "3dgs"), (criteria,), cells, "Skipped: depth; no such criterion.", 2, 1, 0)


def test_counts_and_intervals_stand_beside_the_shares(table: ValidityTable) -> None:
    text = text_of(table)
    assert "66.7 (2/3; 20.8 to 93.9)" in text and "50.0 (1/2; 9.5 to 90.5)" in text
    assert "3dgs, alpha & normal: Nobody can stand" in text and "Skipped: depth" in text
    first, second = csv.DictReader(io.StringIO(csv_of(table)))
    assert float(first["coverage"]) == table.cells[0].figures["coverage"] and first["criteria"] == "alpha+normal"
    assert second["why"].startswith("Nobody") and second["nodes"] == ""


def test_latex_has_a_cell_for_every_model_and_column(table: ValidityTable) -> None:
    text = latex_of(table)
    assert text.count("{") == text.count("}") and "Alpha\\&Normal" in text and "(2/3), 20.8--93.9" in text
    bodies = [line for line in text.splitlines() if line.endswith("\\\\")]
    assert len(bodies) == 1 + 4 * 2
    for line in bodies:
        assert line.replace("\\&", "").count("&") == 2, line
    assert sum("3dgs & -" in line for line in bodies) == 4


def test_an_empty_map_has_no_validity(table: ValidityTable) -> None:
    figures = evaluate_graph(NavGraph("t"), OCCUPANCY, WALK[:, :2])
    empty = ValidityTable(("m",), (("alpha",),), [ValidityCell("m", ("alpha",), figures, NavGraph("t"))], "", 0, 0, 1)
    assert "0/0" not in text_of(empty) + latex_of(empty)


def test_a_picture_of_every_map_is_written(table: ValidityTable, tmp_path: Path) -> None:
    files = {f.name: f for f in write_validity(table, tmp_path / "out", OCCUPANCY, WALK[:, :2])}
    assert set(files) == {"validity.txt", "validity.csv", "validity.tex", "nvsim_alpha-normal.png"}
    assert cv2.imread(str(files["nvsim_alpha-normal.png"])).std() > 10
