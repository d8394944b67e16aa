"""Damage that uses the structure of a file, so that it also changes the content of archives and of files with
checksums."""

from __future__ import annotations

from collections.abc import Callable

from fuzzing import archives, databases, pictures, trees
from fuzzing.damage import Damage
from fuzzing.reader import Place

_LARGEST = 1 << 20  # bytes; larger files get no further damage
Form = Callable[[Damage, bytes], bytes]
_ENDS = (b"end_header\n", b"DATA binary\n", b"DATA ascii\n", b"DATA binary_compressed\n", b"\ndata\n")


def binary(d: Damage, data: bytes) -> bytes:
    return d.bytes(data)


def text(d: Damage, data: bytes) -> bytes:
    return d.text(data) if d.dice.random() < 0.85 else d.bytes(data)


def headed(d: Damage, data: bytes) -> bytes:
    """Damages a file with a text header and a binary body."""
    at = max((data.find(end) + len(end) for end in _ENDS if data.find(end) >= 0), default=min(len(data), 400))
    if d.dice.random() < 0.65:
        return d.text(data[:at]) + data[at:]
    return data[:at] + d.bytes(data[at:]) if d.dice.random() < 0.7 else d.bytes(data)


FORMS: dict[str, Form] = {
    "binary": binary,
    "text": text,
    "headed": headed,
    "json": trees.json_tree,
    "lines of json": trees.json_lines,
    "tensors": trees.tensors,
    "picture": pictures.picture,
    "zip": archives.zipped,
    "gzip": archives.gzipped,
    "evidence": archives.evidence,
    "sqlite": databases.database,
}


def damaged(d: Damage, data: bytes, form: str, other: bytes) -> bytes:
    """`data` with one to three pieces of damage, according to its `form`."""
    for _ in range(d.dice.choice((1, 1, 1, 1, 2, 3))):
        if len(data) > _LARGEST or isinstance(data, Place):
            break
        draw = d.dice.random()
        if draw < 0.02:
            data = d.whole(data, other)
        elif draw < 0.17:
            data = d.bytes(data, other)
        else:
            data = _by_form(d, data, form)
    return data


def _by_form(d: Damage, data: bytes, form: str) -> bytes:
    try:
        return FORMS[form](d, data)
    except Exception as error:  # earlier damage can make the file invalid for its form
        d.say(f"no longer a valid {form} ({type(error).__name__})")
        return d.bytes(data)
