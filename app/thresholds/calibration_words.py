"""The texts of the calibration panel: the cells of a row, the sentences below the list, and the status."""

from __future__ import annotations

from typing import Any

from app.look.plain_text import plain
from app.state.document import Document
from app.thresholds.calibrations import Calibrations
from app.thresholds.table import thresholds
from nvsim.evaluation.calibrated import Judge
from nvsim.evaluation.interval import needed
from nvsim.project.work import STAGE, sentence

_NAMES = {t.field: t.name for t in thresholds()}


def cells(state: Calibrations, field: str, judge: Judge) -> list[str]:
    """The cells of a row: threshold, current value, suggested value, and the effect of the suggestion."""
    now, then = state.now(field), state.suggestion(field, judge)
    free = f"{now['validity' + _suffix(judge)]:.3f}"
    found = [_NAMES.get(field, field), f"{state.value(field):.2f}"]
    if then["threshold"] is None:
        return [*found, "none", free, "", ""]
    row = state.at(field, then["threshold"])
    return [
        *(*found, f"{then['threshold']:.2f}", f"{free} → {then['validity']:.3f}"),
        *(f"{row['coverage'] - now['coverage']:+.3f}", f"{row['edges'] - now['edges']:+d}"),
    ]


def sentences(state: Calibrations, field: str, judge: Judge) -> str:
    """The figures of a threshold at its current value, and with the suggestion."""
    found, suffix = state.found, _suffix(judge)
    assert found is not None
    now, then = state.now(field), state.suggestion(field, judge)
    words = f"Now {state.value(field):.2f}: {_figures(now, suffix)}. "
    if then["threshold"] is None:
        return words + (
            f"No value is good enough for {found.want:g}: the interval of {then['best_threshold']:.2f} begins at "
            f"{then['best_low']:.3f}. A suggestion needs at least {needed(found.want)} accepted corridors, all of them "
            f"free; {now['accepted']} are accepted now."
        )
    row = state.at(field, then["threshold"])
    words += f"{then['threshold']:.2f} would give {_figures(row, suffix)}"
    steps = "step opens" if row["beyond"] == 1 else "steps open"
    return words + (f"; {row['beyond']} {steps} towards new places, use Build again." if row["beyond"] else ".")


def status(state: Calibrations, document: Document, chosen: str) -> str:
    """The status of the calibration, or the missing input."""
    found = state.found
    if state.busy:
        return "Evaluating the graph with every value of every threshold…"
    if state.trouble:
        return plain(state.trouble, 600)
    if document.graph is None:
        return sentence(STAGE["map"].lacking)
    if document.project is None:
        return "A graph file has no evidence to decide again; open a project."
    if found is None or state.map is None:
        return "Calculate compares every value of a threshold with an occupancy map as the ground truth."
    if not state.is_of_this_graph:
        return "The graph has changed since; select Calculate to evaluate it again."
    if found.want != state.want:
        return f"This is for surely {found.want:g}; select Calculate to find the loosest values for {state.want:g}."
    if chosen and state.moved(chosen):
        return "Other sliders have moved since; select Calculate to update the figures."
    now, judge = found.now, "/".join(state.map.parts[-2:])
    return f"{now['accepted']:,} of {now['corridors']:,} corridors are accepted, judged by {plain(judge, 60)}."


def _suffix(judge: Judge) -> str:
    return "" if judge == "point" else f"_{judge}"


def _figures(row: dict[str, Any], suffix: str) -> str:
    return (
        f"{row['validity' + suffix]:.3f} free ({row['low' + suffix]:.3f} to {row['high' + suffix]:.3f}), "
        f"{row['coverage']:.3f} covered, {row['edges']:,} edges"
    )
