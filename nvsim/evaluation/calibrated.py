"""The result of `nvsim.evaluation.calibration`, and its report as text, CSV, JSON and a chart.

A separate module, because the window shows it without computing it.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, Literal, get_args

from nvsim.evaluation.interval import cases_needed
from nvsim.evaluation.table import Column, csv_table, text_table
from nvsim.figures import INK, WIDTH, save_figure, style
from nvsim.files import atomic
from nvsim.mapping.criteria import CRITERIA

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Judge = Literal["point", "robot"]


@dataclass(frozen=True, eq=False)
class Calibration:
    """A JSON-able calibration result.

    want        the requested validity
    now         metrics with the current thresholds
    sweeps      threshold name -> one row of metrics per value, with the other thresholds unchanged
    suggested   for each threshold, and for a point and a robot: the loosest value that reaches `want`, and its effect
                on the graph. `threshold` is None if no value reaches it

    A row contains threshold, corridors, accepted and its share; valid, validity, low and high (its 95 % interval); and
    recall, the share of free corridors that is accepted. The names with _robot give these metrics for a robot.
    viewpoints, edges and coverage describe the remaining graph. beyond counts newly open steps toward places without a
    viewpoint, which only a new build can add.
    """

    want: float
    now: dict[str, Any]
    sweeps: dict[str, list[dict[str, Any]]]
    suggested: list[dict[str, Any]]

    @property
    def why_none(self) -> str:
        """A sentence about the number of corridors that a suggestion needs. "" if every threshold has a suggestion."""
        if all(row["threshold"] is not None for row in self.suggested):
            return ""
        return (
            f"A lower bound of {self.want:g} needs at least {cases_needed(self.want)} accepted corridors, "
            f"all of them free; {self.now['accepted']} are accepted. Give a lower --want, or map a larger area."
        )


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
        f"Free for a point: {_validity_text(now, '')}; for a robot: {_validity_text(now, '_robot')}. "
        f"{now['viewpoints']} viewpoints, {now['edges']} edges, coverage {now['coverage']:.4f}.",
        "",
        f"Loosest thresholds whose validity has a 95 % interval above {found.want:g}, with the others unchanged:",
        "",
        text_table(columns, rows),
        "edges and coverage: change of the graph. from: lower end of the interval. beyond: newly open steps toward "
        "places without a viewpoint, which only a new build can add.",
    ]
    return "\n".join([*lines, *([found.why_none] if found.why_none else [])]) + "\n"


def _validity_text(row: dict[str, Any], suffix: str) -> str:
    return f"{row['validity' + suffix]:.4f} ({row['low' + suffix]:.4f} to {row['high' + suffix]:.4f})"


def write_calibration(found: Calibration, folder: Path) -> list[Path]:
    """Writes calibration.csv (one line per criterion and threshold), .json, .svg and .png into `folder`; returns their
    paths. Raises InputError if the disk refuses."""
    rows = [{"criterion": name, **row} for name, sweep in found.sweeps.items() for row in sweep]
    files = [folder / "calibration.csv", folder / "calibration.json"]
    atomic.write_text(files[0], csv_table(list(rows[0]), rows))
    atomic.write_text(files[1], json.dumps(asdict(found), indent=1) + "\n")
    chart = draw_calibration(found)
    return files + [save_figure(chart, folder / f"calibration.{kind}") for kind in ("svg", "png")]


@style()
def draw_calibration(found: Calibration) -> Figure:
    """Draws for every criterion a panel of validity, and below it a panel of accepted share and coverage."""
    from matplotlib.figure import Figure

    lines = -(-len(found.sweeps) // _ROW)
    figure = Figure((WIDTH, 2.7 * lines), layout="constrained")
    panels = figure.subplots(2 * lines, _ROW, squeeze=False)
    for axes in panels.flat:
        axes.set_visible(False)
    names = {c.field: f"{c.field}: {c.name} {'below' if c.below else 'above'}" for c in CRITERIA}
    for i, field in enumerate(found.sweeps):
        row, column = 2 * (i // _ROW), i % _ROW
        _draw_sweep(panels[row, column], panels[row + 1, column], found, field)
        panels[row, column].set_title(fill(names[field], 40), loc="left")
        panels[row + 1, column].set_xlabel("threshold")
    for row, name in enumerate(("validity", "share") * lines):
        panels[row, 0].set_ylabel(name)
    entries = {line.get_label(): line for axes in panels.flat for line in axes.lines if line.get_label()[0] != "_"}
    figure.legend(handles=list(entries.values()), loc="outside lower left", ncols=len(entries))
    return figure


def _draw_sweep(upper: Axes, lower: Axes, found: Calibration, field: str) -> None:
    rows = found.sweeps[field]
    shown = [row for row in rows if row["accepted"]]  # validity is undefined without accepted corridors
    x = [row["threshold"] for row in shown]
    for name, color, suffix in (("valid, point", "#1969c8", ""), ("valid, robot", "#e18214", "_robot")):
        value, low, high = ([row[key + suffix] for row in shown] for key in ("validity", "low", "high"))
        upper.fill_between(x, low, high, color=color, alpha=0.2, linewidth=0)
        upper.plot(x, value, color=color, label=name)
    upper.axhline(found.want, color=INK, linestyle="--", linewidth=0.7, label="requested")
    lowest = min([0.9, found.want, *(row["low_robot"] for row in shown if row["accepted"] >= 20)])
    for name, color, key in (("accepted", "#787878", "share"), ("coverage", "#2e7d54", "coverage")):
        lower.plot([row["threshold"] for row in rows], [row[key] for row in rows], color=color, label=name)
    mine = [row for row in found.suggested if row["criterion"] == field]
    robot = next((row["threshold"] for row in mine if row["judge"] == "robot"), None)
    for axes, bottom in ((upper, math.floor(lowest * 10) / 10), (lower, 0.0)):
        axes.set(visible=True, xlim=(-0.01, 1.01), ylim=(bottom, 1.01))
        axes.axvline(mine[0]["now"], color="#3c3c3c", linestyle=":", label="now")
        if robot is not None:
            axes.axvline(robot, color="#c82878", linestyle="-.", label="suggested, robot")
