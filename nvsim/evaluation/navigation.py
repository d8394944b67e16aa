"""The paper's table of agents on R2R tasks (its fifth): metrics of each agent with counts and intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from nvsim.evaluation.interval import grouped_mean, grouped_share
from nvsim.evaluation.table import Column, text_table
from nvsim.r2r.metrics.scores import METRICS, NEAR, Scores

_SHARES = ("success", "oracle_success")
_UNBOUNDED = ("pl", "ne", "steps")
_TABLE = (("ne", "NE m", 1, 2), ("success", "SR %", 100, 1), ("oracle_success", "OSR %", 100, 1)) + (
    ("spl", "SPL %", 100, 1),
    ("pl", "PL m", 1, 2),
)
_MORE = (("ndtw", "nDTW %", 100, 1), ("sdtw", "SDTW %", 100, 1), ("cls", "CLS %", 100, 1)) + (
    ("spl_path", "SPL by path %", 100, 1),
    ("steps", "steps", 1, 1),
)


def figures_of(scores: Scores) -> dict[str, Any]:
    """Means of all metrics, as fractions and meters: NAME, and NAME_low and NAME_high, the ends of a 95 % interval over
    paths. Also the counts `instructions`, `paths`, `successes`, and `oracle_successes`."""
    found: dict[str, Any] = {
        "instructions": len(scores.instr_ids),
        "paths": len(np.unique(scores.path_ids)),
        "successes": int(scores.success.sum()),
        "oracle_successes": int(scores.oracle_success.sum()),
    }
    for name in METRICS:
        values = getattr(scores, name)
        low, high = (grouped_share if name in _SHARES else grouped_mean)(values, scores.path_ids)
        found[name] = float(values.mean())
        if math.isfinite(low):  # no metric is negative, and most are fractions of at most 1
            low, high = max(low, 0.0), high if name in _UNBOUNDED else min(high, 1.0)
        found[f"{name}_low"], found[f"{name}_high"] = low, high
    return found


def text_of(agents: Mapping[str, dict[str, Any]]) -> str:
    """The table of agents by name, a second table with metrics that the paper does not have, and notes."""
    first = next(iter(agents.values()))
    notes = [
        f"Instructions: {first['instructions']}, paths: {first['paths']}. In brackets: 95 % intervals over paths "
        f"(of shares by Wilson). Success: nearer than {NEAR:g} m along the graph.",
        "SPL uses the shortest path from start to goal, as in R2R; SPL by path uses the length of the reference path.",
    ]
    return "\n".join([_block(agents, _TABLE), _block(agents, _MORE), *notes]) + "\n"


def _block(agents: Mapping[str, dict[str, Any]], shown: Sequence[tuple[str, str, int, int]]) -> str:
    columns = [Column("agent", "agent"), *(Column(name, title) for name, title, _, _ in shown)]
    rows = [
        {"agent": agent, **{name: _cell(found, name, unit, decimals) for name, _, unit, decimals in shown}}
        for agent, found in agents.items()
    ]
    return text_table(columns, rows)


def _cell(found: Mapping[str, Any], name: str, unit: int, decimals: int) -> str:
    value, *ends = (unit * found[name + suffix] for suffix in ("", "_low", "_high"))
    counts = {"success": "successes", "oracle_success": "oracle_successes"}.get(name)
    inside = [f"{found[counts]}/{found['instructions']}"] if counts else []
    if all(map(math.isfinite, ends)):
        inside.append(" to ".join(f"{end:.{decimals}f}" for end in ends))
    return f"{value:.{decimals}f}" + (f" ({'; '.join(inside)})" if inside else "")
