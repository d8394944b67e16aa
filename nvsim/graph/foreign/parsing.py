"""Parse the text of a connectivity file into a document. The JSON scanner of the standard library reads everything but
the lists of flags. These contain no brackets, so they are cut out as a whole."""

from __future__ import annotations

import json
import math
import re
from json.decoder import scanstring  # type: ignore[attr-defined]
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError, value_text
from nvsim.graph.connectivity import is_name, json_number, position_in
from nvsim.graph.foreign.document import FLAGS, Document, Entry, FlagStyle, Member, read_flags
from nvsim.graph.types import Viewpoint

_SPACE = re.compile(r"[ \t\r\n]*")
_DECODER = json.JSONDecoder()
_USED = ("image_id", "pose", "included", "height")
_FREE_CELLS = 1 << 24
_FREE_MEMBERS, _TEXT_PER_MEMBER, _MOST_KEYS = 1 << 15, 64, 1000
"""Limits of a file in addition to what its length allows: flags of the matrices, and keys. Keys need much more memory
than their text."""
_ADVICE = "give an R2R connectivity file"


def parse(text: str, path: str) -> Document:
    """Parse the text of a file; `path` is its name in messages. Raises InputError with the entry and the reason.

    One-way edges, entries that list themselves, and lists of a wrong length are accepted. The last two are recorded as
    faults of their entries.
    """
    at = _space(text, 1 if text.startswith("\ufeff") else 0)
    if text[at : at + 1] != "[":
        raise InputError(f"{path} does not hold a list of viewpoints; {_ADVICE}.")
    start = at = _space(text, at + 1)
    entries: list[Entry] = []
    between: list[str] = []
    rows: dict[str, list[NDArray[np.bool_]]] = {key: [] for key in FLAGS}
    closing = 0
    opening = text[:start]
    names: set[str] = set()
    most = math.isqrt(max(_FREE_CELLS, len(text)))
    budget = _FREE_MEMBERS + len(text) // _TEXT_PER_MEMBER
    while text[at : at + 1] != "]" or entries:
        where = f"{path}, entry {len(entries)}"
        if len(entries) == most:
            raise InputError(
                f"{path} has more than {most} entries, but is too short to hold a list of flags for each; {_ADVICE}."
            )
        try:
            entry, found, end = _entry(text, at, where)
        except json.JSONDecodeError as error:
            raise InputError(f"{where}, line {error.lineno}: {error.msg}; {_ADVICE}.") from error
        budget -= len(entry.members)
        if budget < 0:
            raise InputError(f"{where} has more keys than a viewpoint can have; {_ADVICE}.")
        if entry.viewpoint.id in names:
            raise InputError(f"{where}: image_id {entry.viewpoint.id} is used twice; give every viewpoint its own id.")
        names.add(entry.viewpoint.id)
        entries.append(entry)
        for key in FLAGS:
            rows[key].append(found.get(key, np.zeros(0, np.bool_)))
        closing = end
        at = _space(text, end)
        if text[at : at + 1] == "]":
            break
        if text[at : at + 1] != ",":
            raise InputError(f"{where} is not followed by a comma or the end of the list; {_ADVICE}.")
        at = _space(text, at + 1)
        between.append(text[end:at])
    if not entries:
        closing = at
    rest = _space(text, text.index("]", closing) + 1)
    if rest != len(text):
        raise InputError(f"{path} has text after the end of the list; {_ADVICE}.")
    count = len(entries)
    flags = {key: _matrix(rows[key], count) for key in FLAGS}
    entries = [_with_list_faults(e, i, {key: rows[key][i] for key in FLAGS}, count) for i, e in enumerate(entries)]
    return Document(tuple(entries), opening, text[closing:], tuple(between), flags)


def _entry(text: str, at: int, where: str) -> tuple[Entry, dict[str, NDArray[np.bool_]], int]:
    """Return the entry that begins at `at`, its flags, and its end."""
    if text[at : at + 1] != "{":
        raise InputError(f"{where} is not an object; every viewpoint needs image_id, pose and unobstructed.")
    members: list[Member] = []
    flags: dict[str, NDArray[np.bool_]] = {}
    values: dict[str, Any] = {}
    lead = at
    while True:
        begin = at = _space(text, at + 1)
        if text[at : at + 1] != '"':
            raise json.JSONDecodeError("a key in quotes is expected", text, at)
        key, at = scanstring(text, at + 1, True)
        at = _space(text, at)
        if text[at : at + 1] != ":":
            raise json.JSONDecodeError("a colon is expected", text, at)
        at = _space(text, at + 1)
        if key in values:
            raise InputError(f"{where} has the key {key[:40]!r} twice; keep one of them.")
        if len(values) == _MOST_KEYS:
            raise InputError(f"{where} has more than {_MOST_KEYS} keys; {_ADVICE}.")
        value: str | FlagStyle
        if key in FLAGS:
            end = text.find("]", at) + 1
            if text[at : at + 1] != "[" or not end:
                raise InputError(f"{where}: {key} must be a list of booleans, one for every entry of the file.")
            try:
                flags[key], style = read_flags(text[at:end])
            except ValueError as error:
                raise InputError(f"{where}: {key} {error}.") from error
            values[key] = None
            value = text[at:end] if style is None else style
        else:
            try:
                values[key], end = _DECODER.raw_decode(text, at)
            except RecursionError as error:
                raise InputError(f"{where}: {key[:40]} is nested too deeply; {_ADVICE}.") from error
            except json.JSONDecodeError:
                raise
            except ValueError as error:  # a number with thousands of digits
                raise InputError(f"{where}: {key[:40]} holds a number with too many digits; {_ADVICE}.") from error
            if key not in _USED:
                values[key] = None  # its text is kept; the value would only use memory
            value = text[at:end]
        members.append(Member(text[lead:begin], text[begin:at], key, value))
        lead = end
        at = _space(text, end)
        if text[at : at + 1] == "}":
            break
        if text[at : at + 1] != ",":
            raise json.JSONDecodeError("a comma or the end of the object is expected", text, at)
    if "unobstructed" not in flags:
        raise InputError(f"{where} has no unobstructed; every viewpoint needs image_id, pose and unobstructed.")
    return Entry(_viewpoint(values, where), tuple(members), text[lead : at + 1]), flags, at + 1


def _viewpoint(values: dict[str, Any], where: str) -> Viewpoint:
    id = values.get("image_id")
    if not is_name(id):
        raise InputError(f"{where}: image_id is {value_text(id)}; it must be a name.")
    included = values.get("included", True)
    if not isinstance(included, bool | int) or included not in (0, 1):
        raise InputError(f"{where}: included is {value_text(included)}; it must be true or false.")
    height = json_number(values.get("height", 1.5), f"{where}: height")
    return Viewpoint(id, position_in(values.get("pose"), where), height, -1, bool(included), "file")


def _with_list_faults(entry: Entry, index: int, rows: dict[str, NDArray[np.bool_]], count: int) -> Entry:
    """Return the entry with the faults of its lists. A list of a wrong length is kept as text."""
    faults = []
    for key in FLAGS:
        held = entry.text(key)
        if held is not None and len(rows[key]) != count:
            faults.append(("length", f"lists {len(rows[key])} flags as {key} but the file has {count} entries"))
            if isinstance(held, FlagStyle):
                entry = entry.with_value(key, held.write(rows[key]))
    if index < len(rows["unobstructed"]) and rows["unobstructed"][index]:
        faults.append(("self", "lists an edge to itself"))
    return entry if not faults else Entry(entry.viewpoint, entry.members, entry.closing, tuple(faults))


def _matrix(rows: list[NDArray[np.bool_]], count: int) -> NDArray[np.bool_]:
    """(count, count) bool; short rows are filled with False, long rows are cut."""
    matrix = np.zeros((count, count), np.bool_)
    for i, row in enumerate(rows):
        matrix[i, : min(count, len(row))] = row[:count]
    return matrix


def _space(text: str, at: int) -> int:
    found = _SPACE.match(text, at)
    return found.end() if found else at
