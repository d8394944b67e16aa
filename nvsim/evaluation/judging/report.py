"""Write the table of judges as text, CSV and LaTeX, their reasons as sunburst charts, and every verdict as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from itertools import cycle, groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.judging.compared_images import ContestantImages
from nvsim.evaluation.judging.verdicts import JudgeVerdicts, reasons_by_category, table_rows
from nvsim.evaluation.table import Column, csv_table, text_table
from nvsim.figures import FAINT, save_figure, style
from nvsim.files import atomic

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLORS = ("#3a6ea5", "#c47828", "#825aa0", "#3c8c96", "#786e5a")
_SIDES = {True: ("#50965a", "#9fc5a4"), False: ("#be5046", "#db9f99")}  # of positive reasons: their sum, categories
_NAMED = 4 / 360  # smaller shares have no name
_SIZE = 1.55  # height of the drawing in radii of the outer ring, from the center
_LINE = 0.085  # distance of names in radii


@style()
def draw_sunburst(title: str, counts: Mapping[tuple[str, bool, str], int]) -> Figure:
    """Draw (model, whether positive, category) -> number of reasons. Sectors are clockwise from the top."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    figure = Figure((6.0, 5.0))
    figure.suptitle(title, y=0.98)
    axes = figure.add_axes((0, 0.09, 1, 0.86))
    total = sum(counts.values())
    models = list(dict.fromkeys(who for who, _, _ in counts))
    sectors = sorted(counts.items(), key=lambda item: (models.index(item[0][0]), not item[0][1], -item[1]))
    sides: dict[tuple[str, bool], int] = {}
    shares = dict.fromkeys(models, 0)
    for (who, good, _), n in sectors:
        sides[who, good] = sides.get((who, good), 0) + n
        shares[who] += n
    colors = dict(zip(models, cycle(_COLORS)))
    edge = {"edgecolor": "white", "linewidth": 0.7}
    ring = partial(axes.pie, startangle=90, counterclock=False)
    if total:
        ring(list(shares.values()), colors=list(colors.values()), radius=0.54, wedgeprops={"width": 0.32, **edge})
        ring(
            list(sides.values()),
            colors=[_SIDES[good][0] for _, good in sides],
            labels=["" if n < _NAMED * total else "+" if good else "\N{MINUS SIGN}" for (_, good), n in sides.items()],
            labeldistance=0.63 / 0.72,
            textprops={"ha": "center", "color": "white", "weight": "bold"},
            radius=0.72,
            wedgeprops={"width": 0.18, **edge},
        )
        outer = [_SIDES[good][1] for (_, good, _), _ in sectors]
        ring([n for _, n in sectors], colors=outer, wedgeprops={"width": 0.28, **edge})
        _name_sectors(axes, [f"{key[2]} ({n})" for key, n in sectors], np.array([n for _, n in sectors]) / total)
    axes.text(0, 0, f"{total}\nreasons" if total else "No reasons were given.", ha="center", va="center")
    axes.set(ylim=(-_SIZE, _SIZE), xlim=(-2.2, 2.2), aspect="equal")
    axes.set_axis_off()
    handles = [Patch(color=colors[who], label=f"{who} ({100 * n / max(total, 1):.0f} %)") for who, n in shares.items()]
    handles += [
        Patch(color=_SIDES[True][0], label="+ positive"),
        Patch(color=_SIDES[False][0], label="\N{MINUS SIGN} negative"),
    ]
    figure.legend(handles=handles, loc="lower center", ncols=3)
    return figure


def _name_sectors(axes: Axes, names: list[str], shares: NDArray[np.float64]) -> None:
    """Write the names of sectors on both sides of the outer ring, at different heights."""
    angles = 2 * np.pi * (np.cumsum(shares) - shares / 2)
    ends = np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    for side, on_side in ((1, ends[:, 0] >= 0), (-1, ends[:, 0] < 0)):
        rows = np.flatnonzero(on_side & (shares > _NAMED))
        rows = rows[np.argsort(ends[rows, 1])]
        steps = _LINE * np.arange(len(rows))
        # From the lowest name up, each is one line above the one below, and none is above the edge.
        heights = (
            steps + np.maximum.accumulate(np.maximum(1.12 * ends[rows, 1], -_SIZE) - steps) if len(rows) else steps
        )
        heights = np.minimum(heights, _SIZE - _LINE + steps - steps[-1:])
        for row, height in zip(rows, heights, strict=True):
            axes.annotate(
                names[row],
                ends[row],
                (side * 1.22, height),
                ha="left" if side > 0 else "right",
                va="center",
                arrowprops={
                    "arrowstyle": "-",
                    "color": FAINT,
                    "linewidth": 0.6,
                    "relpos": (side < 0, 0.5),
                    "shrinkB": 0,
                },
            )


_COLUMNS = (
    Column("pair", "pair (the winner first)"),
    Column("points", "points %"),
    Column("interval", "95 %"),
    Column("ties", "ties %"),
    Column("seen_share", "seen", "points %", 0),
    Column("novel_share", "novel", "points %", 0),
    Column("pairs", "pairs", "", 0),
)


def text_of(judged: Sequence[JudgeVerdicts], shown: Sequence[ContestantImages]) -> str:
    """One block per judge, and notes that explain the columns."""
    blocks = []
    for judge, rows in groupby(table_rows(judged, shown), key=lambda row: row["judge"]):
        mine = list(rows)
        head = f"{judge}: {mine[0]['what']}"
        if mine[0]["why"]:
            blocks.append(f"{head}\n- ({mine[0]['why']})\n")
            continue
        lines = text_table(_COLUMNS, [_cells(row) for row in mine])
        unanswered = sum(row["unanswered"] for row in mine)
        note = f"Skipped, because there is no usable verdict: {unanswered} pairs.\n" if unanswered else ""
        blocks.append(f"{head}\n{lines}{note}")
    seen = sum(view.kind == "seen" for view in shown)
    notes = (
        f"{seen} seen and {len(shown) - seen} novel views. A win in both orders is 1 point, else both get 0.5.\n"
        "In brackets: points and number of ties. The 95 % intervals (Wilson) treat points as cases.\n"
    )
    return "\n".join([*blocks, notes])


def write_report(judged: Sequence[JudgeVerdicts], shown: Sequence[ContestantImages], folder: Path) -> list[Path]:
    """Writes judge.txt, judge.csv, judge.tex, and verdicts.json. Writes a sunburst chart for each judge that gave
    reasons, and one for all judges. Returns their paths. Raises InputError if the disk refuses."""
    rows = table_rows(judged, shown)
    files = [folder / name for name in ("judge.txt", "judge.csv", "judge.tex", "verdicts.json")]
    atomic.write_text(files[0], text_of(judged, shown))
    names = ["judge", "what", "why"]
    names += [name for name in dict.fromkeys(key for row in rows for key in row) if name not in names]
    atomic.write_text(files[1], csv_table(names, rows))
    atomic.write_text(files[2], _latex(rows))
    atomic.write_text(files[3], json.dumps([asdict(one) for one in judged], indent=1) + "\n")
    reasoned = [one for one in judged if any(v.reasons for v in one.verdicts)]
    charts = [(f"reasons-{file_name(one.judge)}", f"Reasons of {one.judge}", [one]) for one in reasoned]
    if len(reasoned) > 1:
        charts.append(("reasons", "Reasons of all judges", reasoned))
    for name, title, judges in charts:
        figure = draw_sunburst(title, reasons_by_category(judges))
        files += [save_figure(figure, folder / f"{name}.{kind}") for kind in ("svg", "png")]
    return files


def file_name(judge: str) -> str:
    """The judge's name as part of a file name: characters other than ASCII letters and digits become underscores."""
    return "".join(c if c.isascii() and c.isalnum() else "_" for c in judge)[:80]


def _cells(row: Mapping[str, Any]) -> dict[str, Any]:
    pair = f"{row['a']} vs. {row['b']}"
    if "share_a" not in row:
        return {"pair": pair, "pairs": row["pairs"]}
    return {
        "pair": pair,
        "points": f"{row['share_a']:.0f} ({row['points_a']:g})",
        "interval": f"{row['share_low']:.0f} to {row['share_high']:.0f}",
        "ties": f"{row['tie_rate']:.0f} ({row['ties']})",
        "seen_share": row["seen_share"],
        "novel_share": row["novel_share"],
        "pairs": row["pairs"],
    }


def _latex(rows: Sequence[Mapping[str, Any]]) -> str:
    lines = [r"\begin{tabular}{l|c|c}", r"\toprule", r"Pair (winner bold) & Win points (\%) & Tie rate (\%) \\"]
    for judge, mine in groupby(rows, key=lambda row: row["judge"]):
        lines += [r"\midrule", rf"\multicolumn{{3}}{{l}}{{\textbf{{{_tex(judge)}}}}} \\"]
        for row in mine:
            if row["why"]:
                lines.append(rf"\multicolumn{{3}}{{l}}{{-- ({_tex(row['why'])})}} \\")
            elif "share_a" in row:
                points = rf"{row['share_a']:.0f}\% ({row['points_a']:g})"
                ties = rf"{row['tie_rate']:.0f}\% ({row['ties']})"
                lines.append(rf"\textbf{{{_tex(row['a'])}}} vs. {_tex(row['b'])} & {points} & {ties} \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _tex(text: str) -> str:
    escaped = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    return "".join(escaped.get(c, f"\\{c}" if c in "&%$#_{}" else c) for c in text)
