"""The results of evaluations as tables. Does not use Qt."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nvsim.files.csv_text import csv_text
from nvsim.files.opening import read_end
from nvsim.plain_text import capitalized
from nvsim.project.jobs.joblist import Job
from nvsim.project.work import EVALUATIONS, WORK

SUMMARY = "Summary"
_FIGURE, _VALUE = "figure", "value"  # the columns of a summary
_MOST = 16 << 20  # maximum number of bytes read from the end of a job's output
_WORDS = {
    "psnr": "PSNR", "ssim": "SSIM", "lpips": "LPIPS", "iou": "IoU", "miou": "mean IoU", "m2": "m²",
    "nonfloor": "no floor",
}  # fmt: skip
_NAMES = {
    "nodes": "viewpoints", "node_validity": "validity of viewpoints", "edge_validity": "validity of edges",
    "node_validity_robot": "validity of viewpoints, for a robot",
    "edge_validity_robot": "validity of edges, for a robot",
    "reachable_m2": "reachable floor, m²", "largest_component": "share of viewpoints in the largest component",
    "isolated": "viewpoints without an edge", "mean_degree": "edges per viewpoint, mean",
    "stair_edges": "edges between storeys",
    "stair_edge_validity": "validity of edges between storeys",
    "stair_edge_validity_robot": "validity of edges between storeys, for a robot",
    "valid_stair_edges": "valid edges between storeys",
    "valid_stair_edges_robot": "valid edges between storeys, for a robot",
    "edge_length": "length of edges, mean, m", "edge_length_max": "length of the longest edge, m",
    "degree_p5": "edges per viewpoint, 5th percentile", "degree_p95": "edges per viewpoint, 95th percentile",
    "edge_length_p5": "length of edges, 5th percentile, m", "edge_length_p95": "length of edges, 95th percentile, m",
    "nearest": "nearest other viewpoint, median, m", "nearest_mean": "nearest other viewpoint, mean, m",
    "tied": "pairs with two shortest paths", "tied_episodes": "pairs 4 to 6 edges apart with two shortest paths",
    "near_pairs_1.5": "pairs under 1.5 m apart",
    "near_far_1.5": "share of pairs under 1.5 m that are over 3 m apart in the graph",
    "near_pairs_2.5": "pairs under 2.5 m apart",
    "near_far_2.5": "share of pairs under 2.5 m that are over 3 m apart in the graph",
    "detour": "path in the graph / path on the map, median",
    "detour_p95": "path in the graph / path on the map, 95th percentile",
    "unreachable": "pairs connected only on the map", "detour_pairs": "pairs measured for detours",
    "valid_nodes": "valid viewpoints", "valid_edges": "valid edges",
    "valid_nodes_robot": "valid viewpoints, for a robot", "valid_edges_robot": "valid edges, for a robot",
    "coverage_without_hazy": "coverage without hazy viewpoints",
    "coverage_seen_without_hazy": "coverage of the observed floor without hazy viewpoints",
    "clustering": "clustering coefficient",
    "coverage_seen": "coverage of the observed floor", "seen_m2": "reachable observed floor, m²",
}  # fmt: skip

_BOUNDS = {"_low": "lower end of the 95 % interval", "_high": "upper end of the 95 % interval"}


@dataclass(frozen=True)
class ResultTable:
    """A table: column names and rows of values; None is a missing value."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    def numbers(self, column: int) -> list[float]:
        """The values of a column, NaN for values that are not numbers."""
        return [float(v) if _is_number(v) else float("nan") for v in (row[column] for row in self.rows)]

    @property
    def is_summary(self) -> bool:
        """Whether the rows are a summary: the name of a figure, and its value."""
        return self.columns == (_FIGURE, _VALUE)

    @property
    def columns_to_plot(self) -> list[int]:
        """The columns to plot: those with different numbers that are not an index. None for a summary, whose rows have
        different units."""
        found: list[int] = []
        if self.is_summary:
            return found
        for i, name in enumerate(self.columns):
            values = {row[i] for row in self.rows if _is_number(row[i])}
            if len(values) > 1 and name not in ("frame", "view", "submap", "frames"):
                found.append(i)
        return found

    def separated(self, by: str) -> str:
        """The table as text with the separator `by`, with quotes if needed."""
        return csv_text([[result_title(c) for c in self.columns], *self.rows], by)


@dataclass(frozen=True)
class EvaluationResult:
    """One evaluation: key, title, time of its end (seconds since the epoch, 0 if unknown), and tables."""

    key: str
    title: str
    at: float
    tables: tuple[ResultTable, ...]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def result_title(name: str) -> str:
    """The display name of a result: psnr_floor -> "PSNR floor"."""
    for end, words in _BOUNDS.items():
        if name.removesuffix(end) in _NAMES and name.endswith(end):
            return f"{_NAMES[name.removesuffix(end)]}, {words}"
    return _NAMES.get(name) or " ".join(_WORDS.get(word, word) for word in name.split("_"))


def value_words(value: object) -> str:
    """Formats a value for a table cell."""
    if value is None:
        return "–"
    if isinstance(value, float):
        size = abs(value)
        return f"{value:,.0f}" if size >= 1000 else f"{value:.2f}" if size >= 10 else f"{value:.4f}"
    return str(value)


def tables_of(figures: Mapping[str, Any]) -> tuple[ResultTable, ...]:
    """Converts the results of an evaluation to tables: plain values become the summary; lists of objects and objects of
    objects become separate tables."""
    plain = [(k, v) for k, v in figures.items() if not isinstance(v, dict | list | tuple)]
    tables = []
    if plain:
        tables.append(ResultTable(SUMMARY, (_FIGURE, _VALUE), tuple((result_title(k), v) for k, v in plain)))
    for name, value in figures.items():
        if isinstance(value, dict) and value and all(isinstance(v, dict) for v in value.values()):
            first = name.removesuffix("s")
            tables.append(_table(name, [{first: k, **v} for k, v in value.items()]))
        elif isinstance(value, dict):
            tables += [_table(k, v) for k, v in value.items() if _is_rows(v)]
        elif _is_rows(value):
            tables.append(_table(name, value))
    return tuple(tables)


def _is_rows(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)


def _table(name: str, rows: Sequence[Mapping[str, Any]]) -> ResultTable:
    columns = [c for c in dict.fromkeys(k for r in rows for k in r) if any(_is_single_value(r.get(c)) for r in rows)]
    cells = tuple(tuple(r.get(c) if _is_single_value(r.get(c)) else None for c in columns) for r in rows)
    return ResultTable(capitalized(result_title(name)), tuple(columns), cells)


def _is_single_value(value: object) -> bool:
    return value is not None and not isinstance(value, dict | list | tuple)


def result_of_job(job: Job) -> EvaluationResult | None:
    """The result that a successful evaluation printed last; None for other jobs."""
    if job.order.verb not in EVALUATIONS or job.status.state != "done":
        return None
    try:
        lines = read_end(job.output, _MOST).decode(errors="replace").splitlines()
    except OSError:
        return None
    for line in reversed(lines):
        try:
            figures = json.loads(line)
        except (ValueError, RecursionError):
            continue
        if isinstance(figures, dict):
            return EvaluationResult(
                f"job {job.number}", job.order.title, job.status.finished or 0.0, tables_of(figures)
            )
    return None


def stored_result(name: str, at: float, figures: Mapping[str, Any]) -> EvaluationResult:
    """A result that a command stored in the project."""
    verb = f"evaluate {name}"
    title = f"{WORK[verb].title} (stored)" if verb in WORK else f"{result_title(name)} (stored)"
    return EvaluationResult(f"stored {name}", title, at, tables_of(figures))


def save_table(table: ResultTable, path: Path) -> None:
    """Writes a table as CSV. Raises InputError if the file cannot be written."""
    from nvsim.files.atomic import write_text

    write_text(path, table.separated(","))
