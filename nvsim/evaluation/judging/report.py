"""Write the table of judges as text, CSV and LaTeX, their reasons as sunburst charts, and every verdict as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import Any

from nvsim.evaluation.judging.contestants import Shown
from nvsim.evaluation.judging.sunburst import draw_sunburst
from nvsim.evaluation.judging.verdicts import Judged, reasons_by_category, table_rows
from nvsim.evaluation.table import Column, csv_table, text_table
from nvsim.figures import save_figure
from nvsim.files import atomic

_COLUMNS = (
    Column("pair", "pair (the winner first)"),
    Column("points", "points %"),
    Column("interval", "95 %"),
    Column("ties", "ties %"),
    Column("seen_share", "seen", "points %", 0),
    Column("novel_share", "novel", "points %", 0),
    Column("pairs", "pairs", "", 0),
)


def text_of(judged: Sequence[Judged], shown: Sequence[Shown]) -> str:
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


def write_report(judged: Sequence[Judged], shown: Sequence[Shown], folder: Path) -> list[Path]:
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
