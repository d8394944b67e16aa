"""Write the table of validities as text, CSV and LaTeX, with an image of every map."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.picture import draw_graph
from nvsim.evaluation.table import EMPTY, Column, csv_table, text_table
from nvsim.evaluation.validity import ValidityCell, ValidityTable
from nvsim.files import atomic
from nvsim.occupancy.types import OccupancyMap

_KINDS = ("node", "edge")


def text_of(table: ValidityTable) -> str:
    """One block per set of criteria, and a sentence for each cell without a map."""
    parts = []
    for criteria in table.columns:
        cells = [cell for cell in table.cells if cell.criteria == criteria]
        columns = [Column("model", " & ".join(criteria))]
        for kind in _KINDS:
            columns += [Column(f"{kind}{s}", n, f"valid {kind}s") for s, n in (("", "a point"), ("_robot", "a robot"))]
        columns += [
            Column("coverage", "all", "coverage", 3),
            Column("coverage_seen", "seen", "coverage", 3),
            Column("detour", "median", "detour", 2),
            Column("detour_p95", "95 %", "detour", 2),
        ]
        rows = [
            {**cell.figures, **{f"{k}{s}": _count_text(cell, k, s) for k in _KINDS for s in ("", "_robot")}}
            | {"model": cell.model}
            for cell in cells
        ]
        parts.append(text_table(columns, rows))
    notes = ["In brackets: valid / all, and the 95 % interval (Wilson) in percent."]
    notes += [f"{cell.model}, {' & '.join(cell.criteria)}: {cell.why}" for cell in table.cells if cell.why]
    return "\n".join([*parts, *notes, *([table.left_out] if table.left_out else [])]) + "\n"


def _count_text(cell: ValidityCell, kind: str, suffix: str) -> str:
    f, name = cell.figures, f"{kind}_validity{suffix}"
    if not f.get(f"{kind}s"):
        return EMPTY
    low, high = f[name + "_low"], f[name + "_high"]
    counts = f"{f[f'valid_{kind}s{suffix}']}/{f[f'{kind}s']}"
    return f"{100 * f[name]:.1f} ({counts}; {100 * low:.1f} to {100 * high:.1f})"


def csv_of(table: ValidityTable) -> str:
    """One line per cell, with all metrics."""
    rows = [
        {"model": cell.model, "criteria": "+".join(cell.criteria), "why": cell.why, **cell.figures}
        for cell in table.cells
    ]
    return csv_table(list(dict.fromkeys(name for row in rows for name in row)), rows)


def latex_of(table: ValidityTable) -> str:
    """A LaTeX table in the paper's form (its fourth table), for a point: valid share in percent, with counts and
    interval below. Coverage and detour of the maps are separate blocks. Needs booktabs, makecell and multirow."""
    heads = ["\\&".join(name.capitalize() for name in criteria) for criteria in table.columns]
    lines = [
        f"\\begin{{tabular}}{{l|l|{'c' * len(heads)}}}",
        "\\toprule",
        " & ".join(["", "\\textbf{Model}", *(f"\\textbf{{{head}}}" for head in heads)]) + " \\\\",
    ]
    blocks: list[tuple[str, Callable[[ValidityCell], str]]] = [
        ("Node", lambda cell: _latex_cell(cell, "node")),
        ("Edge", lambda cell: _latex_cell(cell, "edge")),
        ("Coverage", lambda cell: f"{100 * cell.figures['coverage']:.1f}"),
        ("Detour", lambda cell: f"{cell.figures['detour']:.2f} / {cell.figures['detour_p95']:.2f}"),
    ]
    for name, shown in blocks:
        lines.append("\\midrule")
        for i, model in enumerate(table.models):
            cells = [shown(cell) if cell.figures else "-" for cell in table.cells if cell.model == model]
            first = f"\\multirow{{{len(table.models)}}}{{*}}{{{name}}}" if i == 0 else ""
            lines.append(" & ".join([first, model, *cells]) + " \\\\")
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}"]) + "\n"


def _latex_cell(cell: ValidityCell, kind: str) -> str:
    f, name = cell.figures, f"{kind}_validity"
    if not f[f"{kind}s"]:
        return "-"
    low, high = 100 * f[name + "_low"], 100 * f[name + "_high"]
    counts = f"({f[f'valid_{kind}s']}/{f[f'{kind}s']}), {low:.1f}--{high:.1f}"
    return f"\\makecell{{{100 * f[name]:.1f} \\\\ {{\\scriptsize {counts}}}}}"


def write_validity(
    table: ValidityTable, folder: Path, occupancy: OccupancyMap, trajectory_xy: NDArray[np.floating]
) -> list[Path]:
    """Writes validity.txt, validity.csv, validity.tex and MODEL_CRITERIA.png for every map; returns their paths.
    trajectory_xy: (N, 2) meters, aligned frame. Raises InputError if the disk refuses."""
    texts = {"validity.txt": text_of(table), "validity.csv": csv_of(table), "validity.tex": latex_of(table)}
    files = []
    for name, text in texts.items():
        atomic.write_text(folder / name, text)
        files.append(folder / name)
    for cell in table.cells:
        if cell.graph is not None:
            path = folder / f"{cell.model}_{'-'.join(cell.criteria)}.png"
            files.append(draw_graph(cell.graph, occupancy, trajectory_xy, path))
    return files
