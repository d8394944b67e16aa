"""Write the tables of an ablation as text, CSV and images."""

from __future__ import annotations

from pathlib import Path

from nvsim.evaluation.ablation import AblationResult, AblationTable
from nvsim.evaluation.ablation_runs import ABLATION, COMPARISON
from nvsim.evaluation.comparison import draw_comparison
from nvsim.evaluation.table import ALPHA, NOVEL, WITH_FLOOR, WITHOUT_FLOOR, Column, csv_table, text_table
from nvsim.files import atomic

_HEADS = {
    ABLATION: "Ablation: every row adds to the one above it",
    COMPARISON: "Presets, with equal steps, image size and Gaussians",
}
_COST = (Column("seconds", "seconds", "training", 0), Column("gaussians", "Gaussians", "training", 0))


def text_of(outcome: AblationResult, lpips_why: str) -> str:
    """The tables with notes. An asterisk marks the best value of a column."""
    parts = []
    for name, table in outcome.tables.items():
        columns = [Column("title", "experiment"), *WITH_FLOOR, *WITHOUT_FLOOR, *ALPHA]
        if any(row.get("novel_psnr") is not None for row in table.rows):
            columns += NOVEL
        parts.append(f"{_HEADS[name]}\n\n{text_table([*columns, *_COST], table.rows, mark_best=True)}")
    count = max((row["frames"] for table in outcome.tables.values() for row in table.rows), default=0)
    notes = [f"Means over {count} held-out frames; seconds and Gaussians are sums over the submaps."]
    if lpips_why:
        notes.append(f"LPIPS is empty: {lpips_why}.")
    return "\n".join([*parts, *notes]) + "\n"


def write_report(outcome: AblationResult, folder: Path, lpips_why: str) -> list[Path]:
    """Writes tables.txt, and a CSV file and an image per table; returns their paths. Raises InputError if the disk
    refuses."""
    files = [folder / "tables.txt"]
    atomic.write_text(files[0], text_of(outcome, lpips_why))
    for name, table in outcome.tables.items():
        files += [folder / f"{name}.csv", folder / f"{name}.png"]
        atomic.write_text(files[-2], csv_of(table))
        draw_comparison(files[-1], [row["title"] for row in table.rows], outcome.shown, table.tiles)
    return files


def csv_of(table: AblationTable) -> str:
    """One line per row, seed, and submap, and one line per row with the means."""
    first = ["row", "title", "seed", "submap"]
    rows = [{**row, "seed": "mean", "submap": "mean"} for row in table.rows] + table.parts
    return csv_table([*first, *dict.fromkeys(k for r in rows for k in r if k not in first)], rows)
