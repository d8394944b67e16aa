"""The results of a fuzzing run: totals, a table by reader, and the faults by cause."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import Any

from fuzzing.isolation import KINDS, Fault, Pool


def figures(pool: Pool) -> dict[str, Any]:
    """Numbers of `inputs` and of their outcomes, in total and by reader, with mean milliseconds and maximum MiB."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    time: Counter[str] = Counter()
    most: dict[str, float] = defaultdict(float)
    for index, kind, milliseconds, growth in pool.outcomes():
        name = pool.plan.reader(index).name
        counts[name][KINDS[kind]] += 1
        time[name] += milliseconds
        most[name] = max(most[name], growth)
    rows = {
        name: {
            "inputs": found.total(),
            **_kinds(found),
            "milliseconds": round(time[name] / found.total(), 2),
            "most MiB": round(most[name], 1),
        }
        for name, found in sorted(counts.items())
    }
    everything = sum(counts.values(), Counter())
    return {"inputs": everything.total(), **_kinds(everything), "readers": rows}


def _kinds(found: Counter[str]) -> dict[str, int]:
    return {
        "refused": found["refused"] + found["unclear"],
        "accepted": found["accepted"],
        "tracebacks": found["traceback"],
        "hangs": found["hang"],
        "memory": found["memory"],
        "unclear": found["unclear"],
    }


def causes(faults: Sequence[Fault]) -> list[tuple[int, Fault]]:
    """The number of faults of each cause (reader, kind, location, error type), and the first fault of each."""
    groups: dict[tuple[str, ...], list[Fault]] = defaultdict(list)
    for fault in sorted(faults, key=lambda f: f.index):
        words = "" if fault.kind in ("memory", "unclear") else fault.error.split(":")[0]
        groups[fault.reader, fault.kind, fault.where, words].append(fault)
    return sorted(((len(g), g[0]) for g in groups.values()), key=lambda pair: -pair[0])


def table(found: dict[str, Any]) -> str:
    """The results as a text table."""
    columns = ("inputs", "refused", "accepted", "tracebacks", "hangs", "memory", "unclear", "milliseconds", "most MiB")
    wide = max(map(len, found["readers"]), default=6)
    lines = [f"{'reader':{wide}} " + " ".join(f"{c:>{max(8, len(c))}}" for c in columns)]
    for name, row in (*found["readers"].items(), ("all", found)):
        lines.append(f"{name:{wide}} " + " ".join(f"{row.get(c, '')!s:>{max(8, len(c))}}" for c in columns))
    return "\n".join(lines)
