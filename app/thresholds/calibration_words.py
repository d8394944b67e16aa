"""What the page of calibration says: the cells of a threshold's row, the sentences beneath, how things stand."""

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
    """A threshold, its value now, the suggested one, and what that changes."""
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
    """What a threshold gives now, and with the suggestion."""
    found, suffix = state.found, _suffix(judge)
    assert found is not None
    now, then = state.now(field), state.suggestion(field, judge)
    words = f"Now {state.value(field):.2f}: {_figures(now, suffix)}. "
    if then["threshold"] is None:
        return words + (
            f"No value is surely {found.want:g} free: the best, {then['best_threshold']:.2f}, begins at "
            f"{then['best_low']:.3f}. That takes at least {needed(found.want)} ways that pass, all of them free; "
            f"{now['accepted']} pass now."
        )
    row = state.at(field, then["threshold"])
    words += f"{then['threshold']:.2f} instead: {_figures(row, suffix)}"
    steps = "step leads" if row["beyond"] == 1 else "steps lead"
    return words + (f"; {row['beyond']} {steps} on to new ground, for Build again." if row["beyond"] else ".")


def status(state: Calibrations, document: Document, chosen: str) -> str:
    """How things stand, or what is missing."""
    found = state.found
    if state.busy:
        return "Judging the graph under every value of every threshold…"
    if state.trouble:
        return plain(state.trouble, 600)
    if document.graph is None:
        return sentence(STAGE["map"].lacking)
    if document.project is None:
        return "A graph file holds no evidence to decide again; open a project."
    if found is None or state.map is None:
        return "Calculate says what every value of a threshold buys and costs, on an occupancy map as truth."
    if not state.is_of_this_graph:
        return "The graph has changed since: Calculate judges it as it is now."
    if found.want != state.want:
        return f"This is for surely {found.want:g}: Calculate looks for the loosest values of surely {state.want:g}."
    if chosen and state.moved(chosen):
        return "Other sliders have moved since: Calculate judges this one beside them."
    now, judge = found.now, "/".join(state.map.parts[-2:])
    return f"{now['accepted']:,} of {now['corridors']:,} ways passed, judged by {plain(judge, 60)}."


def _suffix(judge: Judge) -> str:
    return "" if judge == "point" else f"_{judge}"


def _figures(row: dict[str, Any], suffix: str) -> str:
    return (
        f"{row['validity' + suffix]:.3f} free ({row['low' + suffix]:.3f} to {row['high' + suffix]:.3f}), "
        f"{row['coverage']:.3f} covered, {row['edges']:,} edges"
    )
