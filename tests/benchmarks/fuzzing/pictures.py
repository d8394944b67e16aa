"""Images with wrong sizes in their headers but valid checksums."""

from __future__ import annotations

import re
import struct
import zlib

from fuzzing.damage import Damage

_SIDES = (0, 1, 3, 255, 4000, 20_000, 32_767, 65_535, 1_000_000, (1 << 31) - 1, (1 << 32) - 1)


def picture(d: Damage, data: bytes) -> bytes:
    if d.dice.random() < 0.45:
        return d.bytes(data)
    if data[:8] == b"\x89PNG\r\n\x1a\n":
        return _png(d, data)
    if data[:2] == b"\xff\xd8":
        return _jpeg(d, data)
    if data[:4] == b"RIFF" and data[8:16] == b"WEBPVP8L" and len(data) > 25:
        return _webp(d, data)
    if re.match(rb"P[1-7]\s", data):
        return d.text(data[:30]) + data[30:]
    return d.bytes(data)


def _png(d: Damage, data: bytes) -> bytes:
    """Changes one chunk and corrects its CRC."""
    chunks, at = [], 8
    while at + 12 <= len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + size]))
        at += 12 + size
    if not chunks:
        return d.bytes(data)
    k = d.dice.randrange(len(chunks)) if d.dice.random() < 0.5 else 0
    kind, body = chunks[k]
    if kind == b"IHDR" and len(body) == 13 and d.dice.random() < 0.8:
        fields = list(struct.unpack(">IIBBBBB", body))
        which = d.dice.randrange(7)
        fields[which] = d.dice.choice(_SIDES) if which < 2 else d.dice.choice((0, 1, 2, 3, 4, 6, 8, 16, 255))
        if d.dice.random() < 0.3:
            fields[:2] = [d.dice.choice(_SIDES), d.dice.choice(_SIDES)]
        body = struct.pack(">IIBBBBB", *fields)
        d.say(f"IHDR {fields}")
    elif kind == b"IDAT" and d.dice.random() < 0.5:
        try:
            body = zlib.compress(d.bytes(zlib.decompress(body)), 1)
        except zlib.error:
            body = d.bytes(body)
    else:
        body = d.bytes(body)
        d.say(f"in {kind!r}")
    chunks[k] = (kind, body)
    lengths = [len(body) for _, body in chunks]
    if d.dice.random() < 0.1:
        lengths[k] = d.dice.choice((0, len(body) + 1, 1 << 20, 1_500_000_000, (1 << 31) - 1, (1 << 32) - 1))
        d.say(f"{kind!r} is {lengths[k]} bytes long")
    out = [data[:8]]
    for length, (kind, body) in zip(lengths, chunks, strict=True):
        out.append(struct.pack(">I", length) + kind + body + struct.pack(">I", zlib.crc32(kind + body)))
    return b"".join(out)


def _jpeg(d: Damage, data: bytes) -> bytes:
    found = re.search(rb"\xff[\xc0\xc1\xc2]\x00.\x08", data, re.DOTALL)
    if found is None or d.dice.random() < 0.4:
        return d.bytes(data)
    at = found.end()
    height, width = d.dice.choice(_SIDES) & 0xFFFF, d.dice.choice(_SIDES) & 0xFFFF
    d.say(f"SOF {width}x{height}")
    return data[:at] + struct.pack(">HH", height, width) + data[at + 4 :]


def _webp(d: Damage, data: bytes) -> bytes:
    """Changes the 14 bits of the width and of the height."""
    bits = int.from_bytes(data[21:25], "little")
    width, height = d.dice.choice(_SIDES) & 0x3FFF, d.dice.choice(_SIDES) & 0x3FFF
    d.say(f"VP8L {width + 1}x{height + 1}")
    return data[:21] + ((bits & ~0xFFFFFFF) | width | height << 14).to_bytes(4, "little") + data[25:]
