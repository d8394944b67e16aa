"""Update a document after its graph was edited. Touched entries change as little as possible; all others stay
unchanged."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.foreign.document import FLAGS, Document, Entry, FlagStyle, Member
from nvsim.graph.types import EdgeKey, NavGraph, Viewpoint

_NUMBER = re.compile(r"-?\d[\d.eE+-]*")
_PLACE = (3, 7, 11)  # indices of x, y and z in a pose
_LEVEL = "[1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1]"  # facing +y, like the poses of NVSim's exports
Matrices = dict[str, NDArray[np.bool_]]


def edges_in(document: Document) -> tuple[tuple[EdgeKey, ...], frozenset[EdgeKey]]:
    """Return the keys of all edges in file order, and those of one-way edges. An edge from an entry to itself is
    ignored, as in the simulator."""
    free = document.flags["unobstructed"]
    either = np.triu(free | free.T, 1)
    ids = [entry.viewpoint.id for entry in document.entries]

    def keys(pairs: NDArray[np.bool_]) -> Iterable[EdgeKey]:
        for i, j in np.argwhere(pairs).tolist():
            yield (ids[i], ids[j]) if ids[i] < ids[j] else (ids[j], ids[i])

    return tuple(keys(either)), frozenset(keys(either & (free != free.T)))


def rewrite_document(document: Document, before: NavGraph, after: NavGraph) -> Document:
    """Return the document of graph `after`, where `document` is that of graph `before`.

    Visibility does not change; a new viewpoint sees the viewpoints that it is joined to. A moved viewpoint keeps the
    rotation of its pose. One-way edges and entries with faulty lists are corrected only if a user marked them as
    reviewed.
    """
    source = _sources(before, after)
    flags = _matrices(document, before, after, source)
    whole = source == list(range(len(document.entries)))
    style = _style(document)
    entries = []
    for i, (viewpoint, origin) in enumerate(zip(after.viewpoints.values(), source)):
        if origin < 0:
            entries.append(_new_entry(document, viewpoint, style))
            continue
        entry = _changed_entry(document.entries[origin], viewpoint)
        entries.append(_with_lists(entry, i, flags, document.flags if whole else None, style))
    if whole:
        return replace(document, entries=tuple(entries), flags=flags)
    return replace(document, entries=tuple(entries), between=_separators(document, source), flags=flags)


def _with_lists(
    entry: Entry, i: int, flags: Matrices, before: Mapping[str, NDArray[np.bool_]] | None, style: FlagStyle
) -> Entry:
    """Return the entry at `i` with lists in a regular style if their text is outdated. `before` holds the previous
    flags if the viewpoints are unchanged, otherwise None."""
    faults = [f for f in entry.faults if f[0] != "self" or flags["unobstructed"][i, i]]
    for key in FLAGS:
        kept = before is not None and np.array_equal(flags[key][i], before[key][i])
        mended = bool(entry.faults) and entry.viewpoint.reviewed
        if isinstance(entry.text(key), str) and (mended or not kept):
            entry = entry.with_value(key, style)
            faults = [f for f in faults if f[0] != "length" or f" as {key} " not in f[1]]
    return entry if len(faults) == len(entry.faults) else replace(entry, faults=tuple(faults))


def _sources(before: NavGraph, after: NavGraph) -> list[int]:
    """Return the index in `before` of every viewpoint of `after`, -1 for a new one. A new id at exactly the position of
    a removed viewpoint counts as a new name."""
    index = {id: i for i, id in enumerate(before.viewpoints)}
    gone = {
        v.position: i for (id, v), i in zip(before.viewpoints.items(), index.values()) if id not in after.viewpoints
    }
    return [index.get(id, -1) if id in index else gone.pop(v.position, -1) for id, v in after.viewpoints.items()]


def _matrices(document: Document, before: NavGraph, after: NavGraph, source: Sequence[int]) -> Matrices:
    rows = np.array(source, np.int64)
    kept = np.flatnonzero(rows >= 0)
    flags: Matrices = {}
    for key in FLAGS:
        old = document.flags[key]
        if source == list(range(len(old))):
            flags[key] = old.copy()
        else:
            flags[key] = np.zeros((len(rows), len(rows)), np.bool_)
            flags[key][np.ix_(kept, kept)] = old[np.ix_(rows[kept], rows[kept])]
    index = {id: i for i, id in enumerate(after.viewpoints)}
    names = list(before.viewpoints)
    now = {names[origin]: i for i, origin in enumerate(source) if origin >= 0}
    free, seen = flags["unobstructed"], flags["visible"]
    was = {_pair(now[a], now[b]) for a, b in before.edges if a in now and b in now}
    held = {_pair(index[a], index[b]): edge for (a, b), edge in after.edges.items()}
    for i, j in was - held.keys():
        free[i, j] = free[j, i] = False
    for (i, j), edge in held.items():
        if (i, j) not in was or edge.reviewed:
            free[i, j] = free[j, i] = True
        if source[i] < 0 or source[j] < 0:
            seen[i, j] = seen[j, i] = True
    for i, viewpoint in enumerate(after.viewpoints.values()):
        if viewpoint.reviewed:
            free[i, i] = False
    return flags


def _pair(i: int, j: int) -> tuple[int, int]:
    return (i, j) if i < j else (j, i)


def _changed_entry(entry: Entry, now: Viewpoint) -> Entry:
    """Return the entry with new text for the members whose values changed."""
    was = entry.viewpoint
    if was == now:
        return entry
    entry = replace(entry, viewpoint=now)
    if was.id != now.id:
        entry = entry.with_value("image_id", json.dumps(now.id))
    if was.position != now.position:
        entry = entry.with_value("pose", _pose_text(str(entry.text("pose")), was.position, now.position))
    if was.included != now.included:
        digits = entry.text("included") in ("0", "1")
        entry = entry.with_value("included", str(int(now.included)) if digits else json.dumps(now.included))
    if was.height != now.height:
        entry = entry.with_value("height", repr(float(now.height)))
    return entry


def _pose_text(pose: str, was: Sequence[float], now: Sequence[float]) -> str:
    """Return the text of a pose with another position. Unchanged numbers keep their text."""
    changed = {k: repr(float(to)) for k, at, to in zip(_PLACE, was, now) if at != to}
    return _with_numbers(pose, changed)


def _with_numbers(text: str, changed: Mapping[int, str]) -> str:
    found = list(_NUMBER.finditer(text))
    for k in sorted(changed, reverse=True):
        text = text[: found[k].start()] + changed[k] + text[found[k].end() :]
    return text


def _style(document: Document) -> FlagStyle:
    """Return the style of new lists: that of the first regular list in the file."""
    for entry in document.entries:
        for member in entry.members:
            if isinstance(member.value, FlagStyle):
                return member.value
    return FlagStyle()


def _new_entry(document: Document, viewpoint: Viewpoint, style: FlagStyle) -> Entry:
    """Return an entry in the layout of the first entry of the file, with only the six keys of the format."""
    values: dict[str, str | FlagStyle] = {
        "image_id": json.dumps(viewpoint.id),
        "pose": "",
        "included": json.dumps(viewpoint.included),
        "visible": style,
        "unobstructed": style,
        "height": repr(float(viewpoint.height)),
    }
    level = dict(zip(_PLACE, (repr(float(value)) for value in viewpoint.position)))
    if not document.entries:
        values["pose"] = _with_numbers(_LEVEL, level)
        leads = ["{", *[", "] * 5]
        members = tuple(Member(a, f'"{k}": ', k, v) for a, (k, v) in zip(leads, values.items()))
        return Entry(viewpoint, members, "}")
    pattern = document.entries[0]
    pose = {k: number.group() for k, number in enumerate(_NUMBER.finditer(_LEVEL))} | level
    values["pose"] = _with_numbers(str(pattern.text("pose")), pose)
    leads = [m.lead for m in pattern.members]
    known = [m for m in pattern.members if m.key in values]
    further = leads[1] if len(leads) > 1 else ", "
    members = tuple(Member(leads[0] if i == 0 else further, m.name, m.key, values[m.key]) for i, m in enumerate(known))
    return Entry(viewpoint, members, pattern.closing)


def _separators(document: Document, source: Sequence[int]) -> tuple[str, ...]:
    usual = document.between[0] if document.between else ", "
    return tuple(document.between[k - 1] if k > 0 else usual for k in source[1:])
