"""Write a calibration as text, CSV, JSON and a chart."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.calibrated import Calibration, Judge
from nvsim.evaluation.chart import Curve, Panel, draw_chart
from nvsim.evaluation.table import Column, csv_table, text_table
from nvsim.files import atomic
from nvsim.mapping.criteria import CRITERIA

_POINT, _ROBOT, _SHARE, _COVERAGE = (25, 105, 200), (225, 130, 20), (120, 120, 120), (46, 125, 84)
_NOW, _SUGGESTED = (60, 60, 60), (200, 40, 120)
_VALID = ("validity", "low", "high")
_SHOWN = (
    ("threshold", "loosest", 2),
    ("validity", "valid", 4),
    ("low", "from", 4),
    ("edges_change", "edges", 0),
    ("coverage_change", "coverage", 4),
    ("beyond", "beyond", 0),
)
_ROW = 3  # criteria per row of the chart


def text_of(found: Calibration) -> str:
    """The current metrics and the suggestion for every threshold, with notes."""
    judges = get_args(Judge)
    columns = [Column("criterion", "threshold"), Column("now", "now")]
    for judge in judges:
        columns += [Column(f"{judge}_{key}", title, f"free for a {judge}", n) for key, title, n in _SHOWN]
    rows = []
    for field in found.sweeps:
        mine = {row["judge"]: row for row in found.suggested if row["criterion"] == field}
        row: dict[str, Any] = {"criterion": field, "now": mine[judges[0]]["now"]}
        for judge in judges:
            row |= {f"{judge}_{key}": mine[judge].get(key) for key, _, _ in _SHOWN}
        rows.append(row)
    now = found.now
    lines = [
        f"Of {now['corridors']} corridors {now['accepted']} are accepted. "
        f"Free for a point: {_sure(now, '')}; for a robot: {_sure(now, '_robot')}. "
        f"{now['viewpoints']} viewpoints, {now['edges']} edges, coverage {now['coverage']:.4f}.",
        "",
        f"Loosest thresholds whose validity has a 95 % interval above {found.want:g}, with the others unchanged:",
        "",
        text_table(columns, rows),
        "edges and coverage: change of the graph. from: lower end of the interval. beyond: newly open steps towards "
        "places without a viewpoint, which only a new build can add.",
    ]
    return "\n".join([*lines, *([found.why_none] if found.why_none else [])]) + "\n"


def _sure(row: dict[str, Any], suffix: str) -> str:
    return f"{row['validity' + suffix]:.4f} ({row['low' + suffix]:.4f} to {row['high' + suffix]:.4f})"


def write_calibration(found: Calibration, folder: Path) -> list[Path]:
    """Writes calibration.csv (one line per criterion and threshold), .json, .svg and .png into `folder`; returns their
    paths. Raises InputError if the disk refuses."""
    rows = [{"criterion": name, **row} for name, sweep in found.sweeps.items() for row in sweep]
    files = [folder / "calibration.csv", folder / "calibration.json"]
    atomic.write_text(files[0], csv_table(list(rows[0]), rows))
    atomic.write_text(files[1], json.dumps(asdict(found), indent=1) + "\n")
    return files + draw_chart(folder / "calibration", _panels(found))


def _panels(found: Calibration) -> list[list[Panel]]:
    """For every criterion a panel of validity, and below it a panel of accepted share and coverage."""
    names = {c.field: f"{c.field}: {c.name} {'below' if c.below else 'above'}" for c in CRITERIA}
    pairs = [_of_one(found, field, names[field]) for field in found.sweeps]
    parts = [pairs[i : i + _ROW] for i in range(0, len(pairs), _ROW)]
    return [[pair[k] for pair in part] for part in parts for k in (0, 1)]


def _of_one(found: Calibration, field: str, title: str) -> tuple[Panel, Panel]:
    rows = found.sweeps[field]
    shown = [row for row in rows if row["accepted"]]  # validity is undefined without accepted corridors
    at = {"now": next(s["now"] for s in found.suggested if s["criterion"] == field)}
    for row in found.suggested:
        if row["criterion"] == field and row["judge"] == "robot" and row["threshold"] is not None:
            at["suggested, robot"] = row["threshold"]
    marks = [(x, name, _NOW if name == "now" else _SUGGESTED) for name, x in at.items()]
    validity = [
        Curve(name, colour, _column(shown, "threshold"), *(_column(shown, k + suffix) for k in _VALID))
        for name, colour, suffix in (("valid, point", _POINT, ""), ("valid, robot", _ROBOT, "_robot"))
    ]
    lowest = min([0.9, *(row["low_robot"] for row in shown if row["accepted"] >= 20)])
    kept = [
        Curve("accepted", _SHARE, _column(rows, "threshold"), _column(rows, "share")),
        Curve("coverage", _COVERAGE, _column(rows, "threshold"), _column(rows, "coverage")),
    ]
    return (
        Panel(title, validity, np.floor(lowest * 10) / 10, marks, found.want),
        Panel("", kept, 0.0, marks),
    )


def _column(rows: Sequence[dict[str, Any]], key: str) -> NDArray[np.float64]:
    return np.array([row[key] for row in rows], np.float64)
