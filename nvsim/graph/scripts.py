"""A history as a script: the lines that do again what was done."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

from nvsim.graph.delta import Delta, delta_between
from nvsim.graph.history import History


def script(history: History) -> list[str]:
    """JSON lines that lead from the first to the current step. A step without a named edit is written as a patch of its
    viewpoints and edges; where that does not say it all (evidence, another order), and where nobody edited but a job or
    another program changed the graph, as a comment."""
    lines = []
    for index, step in enumerate(history.steps[1 : history.index + 1], 1):
        if step.operation is not None:
            lines.append(json.dumps(step.operation))
        elif step.edit:
            found = _patch(delta_between(history.graph_at(index - 1), history.graph_at(index)), step.text)
            lines.append(f"# {step.text}" if found is None else json.dumps(found))
        elif step.outside:
            lines.append(f"# {step.text}")
    return lines


def _patch(delta: Delta, text: str) -> dict[str, Any] | None:
    if any(delta.orders) or not (delta.viewpoints or delta.edges or delta.no_viewpoints or delta.no_edges):
        return None
    values: dict[str, Any] = {
        "viewpoints": [dataclasses.asdict(v) for v in delta.viewpoints],
        "edges": [dataclasses.asdict(e) for e in delta.edges],
        "no_viewpoints": list(delta.no_viewpoints),
        "no_edges": [list(key) for key in delta.no_edges if not set(key) & set(delta.no_viewpoints)],
    }
    return {"edit": "patch", **{name: value for name, value in values.items() if value}, "text": text}
