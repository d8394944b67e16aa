"""JSON with a node that is replaced, repeated, removed, or renamed; also the JSON header of safetensors."""

from __future__ import annotations

import json
import struct
from typing import Any

from fuzzing.damage import Damage

_RAW = "\ue000raw"
_NUMBERS: tuple[Any, ...] = (
    *(0, -1, 1, 2, 0.5, -0.0, 255, 65536, 2**31 - 1, 2**31, 2**53 + 1, 2**63, -(2**63) - 1, 2**64, 10**30, 10**400),
    *(1e308, -1e308, 1e-320, float("nan"), float("inf"), float("-inf")),
)


def json_tree(d: Damage, data: bytes) -> bytes:
    if d.dice.random() < 0.12:
        return d.text(data)
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError):
        return d.bytes(data)
    tree, raw = _changed(d, tree)
    try:
        text = json.dumps(tree, separators=(",", ":") if d.dice.random() < 0.5 else None)
    except (ValueError, RecursionError):
        return d.bytes(data)
    return text.replace(json.dumps(_RAW), raw).encode()


def json_lines(d: Damage, data: bytes) -> bytes:
    lines = data.split(b"\n")
    if d.dice.random() < 0.3 or not any(lines):
        return d.text(data)
    i = d.dice.choice([k for k, line in enumerate(lines) if line])
    d.say(f"line {i + 1}")
    lines[i] = json_tree(d, lines[i])
    return b"\n".join(lines)


def tensors(d: Damage, data: bytes) -> bytes:
    """Damages the JSON header of safetensors. Its length is corrected in most cases."""
    size = int.from_bytes(data[:8], "little")
    if d.dice.random() < 0.35 or size > len(data):
        return d.bytes(data)
    header = json_tree(d, data[8 : 8 + size])
    told = len(header) if d.dice.random() < 0.85 else d.dice.choice((0, 1, len(header) + 1, 1 << 31, 1 << 62))
    return struct.pack("<Q", told) + header + data[8 + size :]


def _changed(d: Damage, tree: Any) -> tuple[Any, str]:
    """Changes one node of the tree. Returns the tree, and the text that replaces the raw-text mark in it."""
    way: list[tuple[Any, Any]] = []
    node = tree
    while isinstance(node, dict | list) and node and (not way or d.dice.random() < 0.8):
        key = d.dice.choice(list(node)) if isinstance(node, dict) else d.dice.randrange(len(node))
        way.append((node, key))
        node = node[key]
    raw = "0"
    if not way:
        value, raw = _other(d, tree)
        return value, raw
    parent, key = way[-1]
    name = "".join(f"[{k}]" for _, k in way)[:80]
    what = d.dice.choice(("value", "value", "value", "value", "gone", "twice", "renamed", "swapped"))
    if what == "gone":
        del parent[key]
    elif what == "twice" and isinstance(parent, list):
        parent.insert(d.dice.randrange(len(parent) + 1), parent[key])
    elif what == "twice":
        parent[f"{key}2"] = parent[key]
    elif what == "renamed" and isinstance(parent, dict):
        parent[d.word()] = parent.pop(key)
    elif what == "swapped":
        other = d.dice.choice(list(parent)) if isinstance(parent, dict) else d.dice.randrange(len(parent))
        parent[key], parent[other] = parent[other], parent[key]
    else:
        parent[key], raw = _other(d, node)
        what = f"is {parent[key]!r:.40}" if raw == "0" else f"is {raw[:20]}"
    d.say(f"{name} {what}")
    return tree, raw


def _other(d: Damage, node: Any) -> tuple[Any, str]:
    draw = d.dice.randrange(12)
    if draw < 5:
        return d.dice.choice(_NUMBERS), "0"
    if draw < 8:
        return d.word(), "0"
    if draw == 8:
        return d.dice.choice((None, True, False, [], {}, [[]], [None], [0] * 2000, {"": 0})), "0"
    if draw == 9:
        return ([node] if d.dice.random() < 0.5 else {"0": node}), "0"
    if draw == 10:
        depth = d.dice.choice((3, 900, 100_000))
        return _RAW, "[" * depth + "]" * depth
    return _RAW, d.dice.choice(("9" * 5000, "1e999", "-Infinity", "NaN", '{"a":0,"a":1}', '"\\ud800"', "1.", "01"))
