"""Describes the result that a stage replaces when it runs again, for the command line and the window."""

from __future__ import annotations

import time
from typing import Any

from nvsim.events import Listener, Log
from nvsim.project import results
from nvsim.project.project import Project
from nvsim.project.results import Result, Row


def what_is_replaced(project: Project, stage: str, only: tuple[int, ...] = ()) -> str:
    """One sentence about the result that the stage replaces when it runs, and how long it stays in use. `only` limits
    it to these submaps. "" if there is no result."""
    found = results.in_use(project.connection, project.root, stage)
    if found is None:
        return ""
    former = stage == "train" and results.is_former(project.connection, stage)
    if stage == "train" and only and not former and found.rows:
        found = Result({p: r for p, r in found.rows.items() if p in only}, {}, {})
        if not found.rows:
            return ""
    if stage in ("import", "submaps", "map"):
        end = "the old one stays until the new one is finished"
    else:
        end = "the old ones stay until the new ones are finished"
    if former:
        end = "the old ones stay until the new ones of all submaps are finished"
    kept = results.kept(project.connection, stage) is not None
    instead = "replaces the earlier result, which `nvsim restore` can restore until then"
    then = instead if kept else "can be restored afterwards"
    return f"{stage} replaces {describe(found, stage, former)}; {end}, and {then}."


def listen_to_what_is_replaced(project: Project, stage: str, listen: Listener, only: tuple[int, ...] = ()) -> None:
    """Sends the sentence of `what_is_replaced` to `listen`."""
    sentence = what_is_replaced(project, stage, only)
    if sentence:
        listen(Log(sentence, stage))


def describe(result: Result, stage: str, former: bool = False) -> str:
    """A result in words, for example "the models of 3 submaps (2000 steps, finished 2026-11-22 05:31)"."""
    what, figures = _what(result, stage)
    ended = max((row.finished for row in result.rows.values()), default=0.0)
    when = [time.strftime("finished %Y-%m-%d %H:%M", time.localtime(ended))] if ended else []
    about = ", ".join([*figures, *when])
    return f"{what}{' of the previous cut' if former else ''}{f' ({about})' if about else ''}"


def _what(result: Result, stage: str) -> tuple[str, list[str]]:
    rows: dict[int, Row] = result.rows
    summary: dict[str, Any] = rows[min(rows)].summary if rows else {}
    if stage == "train":
        models = len(rows) or sum(name.startswith("models/") for name in result.places)
        steps = sorted({int(r.summary["steps"]) for r in rows.values() if "steps" in r.summary})
        figures = [f"{' and '.join(map(str, steps))} steps"] if steps else []
        return f"the {'model' if models == 1 else 'models'} of {_count(models, 'submap')}", figures
    if stage == "depth":
        skipped = summary.get("skipped")
        what = (
            "the decision that no depth is estimated"
            if skipped
            else f"the depth of {_count(summary.get('frames', 0), 'frame')}"
        )
        return what, []
    if stage == "floors":
        return f"the floor masks of {_count(summary.get('frames', 0), 'frame')}", []
    if stage == "submaps":
        return f"the cut into {_count(summary.get('submaps', 0), 'submap')}", []
    if stage == "import":
        return f"the capture of {_count(summary.get('frames', 0), 'frame')}", []
    size = [_count(summary.get("viewpoints", 0), "viewpoint"), _count(summary.get("edges", 0), "edge")]
    return "the navigation graph and its edits", size


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}{'' if number == 1 else 's'}"
