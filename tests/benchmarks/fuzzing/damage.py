"""Damage that needs no knowledge of a file format: bytes, lines, numbers, words."""

from __future__ import annotations

import random
import re
import struct

from fuzzing.reader import Place

NUMBERS = (
    *("0", "-0", "-1", "1", "2", "255", "256", "65535", "65536", "2147483647", "2147483648", "-2147483649"),
    *("4294967295", "4294967296", "9223372036854775807", "9223372036854775808", "18446744073709551616"),
    *("1e9", "1e38", "1e39", "1e308", "1e309", "-1e308", "1e-320", "nan", "NaN", "inf", "-Infinity", "0x10", "1_0"),
    *("9" * 400, "9" * 5000, "0." + "0" * 5000 + "1", "1e99999999", "٣", "１２", "", "-", "+5", "1,5", "True"),
)
WORDS = (
    *("", " ", "\0", "a\0b", "\ud800", "\udfff\ud800", "<img src=x onerror=alert(1)>", "../../../../etc/passwd"),
    *("/etc/passwd", "/dev/zero", "x" * 300, "x" * 100_000, "%s%n", "$(id)", "{0}", "\u202e", "é" * 200, "con", "."),
    *("..", "/", "~", "~nobody/x", "\n", "a\nb", "\r", "null", "file:///etc/passwd", "\\\\host\\share", "-"),
)
STRANGERS = (
    *(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\1\0\0\0\1", b"PK\x05\x06" + b"\0" * 18, b"\x1f\x8b\x08\0\0\0\0\0\0\xff"),
    *(
        b"SQLite format 3\0" + b"\0" * 84,
        b"ply\nformat ascii 1.0\nend_header\n",
        b'{"frames": []}',
        b"\x93NUMPY\1\0v\0",
    ),
    b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"4d" * 32 + b"\nsize 12345\n",
    b"<!DOCTYPE html>\n<html><head><title>404</title></head><body>Not Found</body></html>\n" + b" " * 4000,
    b"/annex/objects/SHA256E-s31390--4d7a214614ab2935\n",
    b"\x00\x05\x16\x07\x00\x02\x00\x00Mac OS X        " + b"\0" * 60,
)
"""The first bytes of files of other kinds, and placeholders of files that were not downloaded."""
_INTEGERS = (0, 1, -1, 127, 128, 255, 256, 32767, 65535, 1 << 20, (1 << 31) - 1, -(1 << 31), (1 << 32) - 1)
_LONG = (*_INTEGERS, 1 << 40, (1 << 62), (1 << 63) - 1, -(1 << 63))
_FLOATS = (0.0, -1.0, 1e-38, 3e38, float("nan"), float("inf"), float("-inf"), 1e9)
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_./]+")


class Damage:
    """The random choices of one input, and their description in words."""

    def __init__(self, dice: random.Random) -> None:
        self.dice = dice
        self.said: list[str] = []

    def say(self, text: str) -> None:
        self.said.append(text[:160])

    def place(self, size: int) -> int:
        """A random offset. Half of the offsets are in the first 160 bytes, which contain headers."""
        if size <= 1:
            return 0
        if self.dice.random() < 0.5:
            return self.dice.randrange(min(size, 160))
        return self.dice.randrange(size)

    def bytes(self, data: bytes, other: bytes = b"") -> bytes:
        """Applies one random change to bytes of any format. `other` is another file, from which bytes may be
        spliced."""
        how = self.dice.choice((_flip, _flip, _overwrite, _value, _value, _value, _cut, _cut, _extend, _drop, _repeat))
        if other and self.dice.random() < 0.08:
            return self._spliced(data, other)
        return how(self, data)

    def text(self, data: bytes) -> bytes:
        """Applies one random change to lines, numbers, or words."""
        how = self.dice.choice((_line, _line, _number, _number, _number, _word, _word, _nested, _line_end))
        return how(self, data)

    def whole(self, data: bytes, other: bytes) -> bytes:
        """Replaces the whole file by other content."""
        if self.dice.random() < 0.25:
            place = Place(self.dice.choice(Place.KINDS))
            self.say(place.decode())
            return place
        which = self.dice.randrange(9)
        self.say(f"whole file {which}")
        return (
            *(b"", b"\0" * self.dice.choice((1, 100, 10_000)), self.dice.randbytes(self.dice.randrange(1, 4000))),
            *(other, b"null", b"[" * 100_000, b'{"a":' * 50_000, b"\xff\xfe" + data[:500], b"9" * 5000),
        )[which]

    def number(self) -> str:
        return self.dice.choice(NUMBERS)

    def word(self) -> str:
        return self.dice.choice(WORDS)

    def _spliced(self, data: bytes, other: bytes) -> bytes:
        at, start = self.place(len(data)), self.dice.randrange(len(other))
        piece = other[start : start + self.dice.randrange(1, 512)]
        self.say(f"{len(piece)} bytes of another file at {at}")
        return data[:at] + piece + data[at + (len(piece) if self.dice.random() < 0.5 else 0) :]


def _flip(d: Damage, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(d.dice.choice((1, 1, 1, 2, 8))):
        if changed:
            at = d.place(len(changed))
            changed[at] ^= 1 << d.dice.randrange(8)
            d.say(f"bit at {at}")
    return bytes(changed)


def _overwrite(d: Damage, data: bytes) -> bytes:
    at, count = d.place(len(data)), d.dice.choice((1, 2, 4, 16, 256))
    d.say(f"{count} random bytes at {at}")
    fill = d.dice.choice((d.dice.randbytes(count), b"\0" * count, b"\xff" * count))
    return data[:at] + fill + data[at + count :]


def _value(d: Damage, data: bytes) -> bytes:
    """Writes a number in a binary form that headers use."""
    code = d.dice.choice("BHIQIQfd")
    order = d.dice.choice("<<<>")
    size = struct.calcsize(order + code)
    at = d.place(len(data))
    at -= at % size if d.dice.random() < 0.5 else 0
    value: int | float
    if code in "fd":
        value = d.dice.choice(_FLOATS)
    else:
        value = d.dice.choice(_LONG) & ((1 << 8 * size) - 1)
    d.say(f"{order}{code} {value} at {at}")
    return data[:at] + struct.pack(order + code, value) + data[at + size :]


def _cut(d: Damage, data: bytes) -> bytes:
    at = d.place(len(data)) if d.dice.random() < 0.7 else max(0, len(data) - d.dice.randrange(1, 33))
    d.say(f"cut at {at} of {len(data)}")
    return data[:at]


def _extend(d: Damage, data: bytes) -> bytes:
    more = d.dice.choice((b"\0", d.dice.randbytes(16), b"\0" * 4096, data[: 1 << 16], d.dice.randbytes(3000)))
    d.say(f"{len(more)} bytes more")
    return data + more


def _drop(d: Damage, data: bytes) -> bytes:
    at, count = d.place(len(data)), d.dice.choice((1, 3, 4, 8, 100))
    d.say(f"{count} bytes gone at {at}")
    return data[:at] + data[at + count :]


def _repeat(d: Damage, data: bytes) -> bytes:
    at, count = d.place(len(data)), d.dice.choice((1, 4, 8, 100, 1000))
    d.say(f"{count} bytes twice at {at}")
    return data[: at + count] + data[at:]


def _line(d: Damage, data: bytes) -> bytes:
    lines = data.split(b"\n")
    i, j = d.dice.randrange(len(lines)), d.dice.randrange(len(lines))
    what = d.dice.choice(("twice", "gone", "swapped", "emptied", "halved", "joined"))
    d.say(f"line {i + 1} {what}")
    if what == "twice":
        lines.insert(j, lines[i])
    elif what == "gone":
        del lines[i]
    elif what == "swapped":
        lines[i], lines[j] = lines[j], lines[i]
    elif what == "emptied":
        lines[i] = b""
    elif what == "halved":
        lines[i] = lines[i][: len(lines[i]) // 2]
    else:
        lines[i : i + 2] = [b" ".join(lines[i : i + 2])]
    return b"\n".join(lines)


def _number(d: Damage, data: bytes) -> bytes:
    new = d.number().encode("utf-8", "surrogatepass")
    return _replaced(d, data, _NUMBER, new)


def _word(d: Damage, data: bytes) -> bytes:
    return _replaced(d, data, _WORD, d.word().encode("utf-8", "surrogatepass"))


def _replaced(d: Damage, data: bytes, pattern: re.Pattern[bytes], new: bytes) -> bytes:
    # The search starts at a random offset, so that a long file is not searched as a whole.
    found = pattern.search(data, d.place(len(data))) or pattern.search(data)
    if found is None:
        return data + new
    d.say(f"{found.group()[:30]!r} at {found.start()} is {new[:30]!r}")
    return data[: found.start()] + new + data[found.end() :]


def _nested(d: Damage, data: bytes) -> bytes:
    at = d.place(len(data))
    piece = d.dice.choice((b"[", b"(", b'{"a":', b"-", b"not ", b"\t", b'"', b"((")) * d.dice.choice((3, 1000, 40_000))
    d.say(f"{piece[:6]!r} {len(piece)} bytes long at {at}")
    return data[:at] + piece + data[at:]


def _line_end(d: Damage, data: bytes) -> bytes:
    new = d.dice.choice((b"\r\n", b"\r", b"\0", b"\x85", "\u2028".encode(), b"", b" " * 5000))
    d.say(f"line ends are {new[:8]!r}")
    return data.replace(b"\n", new, d.dice.choice((-1, 1, 3)))
