"""Verdicts on pairs of images, and the paper's points for them: 1 for a win in both orders, 0.5 for a tie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, Literal

import numpy as np

from nvsim.evaluation.interval import wilson
from nvsim.evaluation.judging.compared_images import ContestantImages

Preference = Literal["first", "second", "tie"]


@dataclass(frozen=True)
class Reason:
    """A reason for or against an image: the model that rendered it, positive or negative, the category, and a text."""

    contestant: str
    good: bool
    category: str
    words: str


@dataclass(frozen=True)
class Verdict:
    """The verdict on the images of `a` and `b` in one view.

    won    name of the winner, "" for a tie, None if there is no usable answer; `why` then has the reason
    said   the preference in each order, for the transcript
    """

    view: str
    kind: str
    a: str
    b: str
    won: str | None
    why: str = ""
    said: tuple[str, ...] = ()
    reasons: tuple[Reason, ...] = ()


@dataclass(frozen=True)
class JudgeVerdicts:
    """All verdicts of one judge. what: a description of the judge; why: the reason if there are no verdicts."""

    judge: str
    what: str
    verdicts: Sequence[Verdict] = field(default_factory=tuple)
    why: str = ""


def pairs_of(contestants: Sequence[str]) -> list[tuple[str, str]]:
    """All pairs, in order."""
    return list(combinations(contestants, 2))


def consistent_winner(a: str, b: str, forth: Preference, back: Preference) -> str:
    """The winner of two comparisons: the first showed `a` first, the second `b`. "" if they do not agree."""
    there = {"first": a, "second": b, "tie": ""}[forth]
    again = {"first": b, "second": a, "tie": ""}[back]
    return there if there == again else ""


def table_rows(judged: Sequence[JudgeVerdicts], shown: Sequence[ContestantImages]) -> list[dict[str, Any]]:
    """One row for each judge and pair; `a` has more points than `b`. A judge without verdicts has one row with `why`.

    Columns: judge, a, b, pairs, unanswered, points_a, points_b, share_a (of the pairs, in percent) with its 95 %
    interval (Wilson), ties, tie_rate, and the shares of seen and of novel views alone."""
    rows: list[dict[str, Any]] = []
    contestants = list(shown[0].images)
    for one in judged:
        if one.why:
            rows.append({"judge": one.judge, "what": one.what, "why": one.why})
            continue
        for a, b in pairs_of(contestants):
            mine = [v for v in one.verdicts if (v.a, v.b) == (a, b)]
            rows.append({"judge": one.judge, "what": one.what, "why": "", **_figures(a, b, mine)})
    return rows


def _figures(a: str, b: str, verdicts: Sequence[Verdict]) -> dict[str, Any]:
    decided = [v for v in verdicts if v.won is not None]
    points = np.array([_points(v, a) for v in decided], np.float64)
    if len(points) and points.mean() < 0.5:
        a, b, points = b, a, 1 - points
    found: dict[str, Any] = {"a": a, "b": b, "pairs": len(decided), "unanswered": len(verdicts) - len(decided)}
    if not len(points):
        return found
    # Points vary less than wins and losses would, so with ties this interval is too wide rather than too narrow.
    low, high = wilson(float(points.sum()), len(points))
    found |= {
        "points_a": float(points.sum()),
        "points_b": float((1 - points).sum()),
        "share_a": 100 * float(points.mean()),
        "share_low": 100 * low,
        "share_high": 100 * high,
        "ties": int((points == 0.5).sum()),
        "tie_rate": 100 * float((points == 0.5).mean()),
    }
    for kind in ("seen", "novel"):
        of = points[[v.kind == kind for v in decided]]
        found[f"{kind}_pairs"], found[f"{kind}_share"] = len(of), 100 * float(of.mean()) if len(of) else None
    return found


def _points(verdict: Verdict, a: str) -> float:
    return 0.5 if verdict.won == "" else float(verdict.won == a)


def reasons_by_category(judged: Sequence[JudgeVerdicts]) -> Mapping[tuple[str, bool, str], int]:
    """(model, whether positive, category) -> number of reasons, in descending order."""
    found: dict[tuple[str, bool, str], int] = {}
    for reason in (r for one in judged for v in one.verdicts for r in v.reasons):
        key = reason.contestant, reason.good, reason.category
        found[key] = found.get(key, 0) + 1
    return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))
