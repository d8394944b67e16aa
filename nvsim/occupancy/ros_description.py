"""The YAML file of a ROS map: a flat mapping, whose only list, the origin, may be in brackets or in dashes."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.regular import read_bytes

# 0.196 keeps grey 205, whose occupancy is 0.19608, unknown.
OCCUPIED_THRESHOLD, FREE_THRESHOLD = 0.65, 0.196
_LONGEST = 1_000_000  # bytes
_FINEST, _COARSEST, _FARTHEST = 1e-4, 1e3, 1e7  # metres
_PLAIN = re.compile(r"[A-Za-z0-9_./+-]+")


@dataclass(frozen=True)
class Description:
    """image           the file, relative to the YAML file or absolute
    resolution      metres per cell
    origin          x and y in metres and yaw in radians, counter-clockwise, of the lower left corner of the image
    negate          whether white is occupied
    occupied, free  shares of black above and below which a cell is occupied or free
    raw             whether grey values are per cent of occupancy
    """

    image: str
    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    occupied: float
    free: float
    raw: bool


def description_text(path: Path) -> str:
    """The text of the YAML file. Raises InputError."""
    try:
        return read_bytes(path, _LONGEST).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"Cannot read the map {path}: it is not text; name the .yaml file of a ROS map.") from error


def quoted(name: str) -> str:
    """The name of a file as a value of YAML; JSON's quotes are YAML's."""
    return name if _PLAIN.fullmatch(name) else json.dumps(name, ensure_ascii=False)


def parse_description(path: Path, text: str) -> Description:
    """What `text` of the file `path` says. Raises InputError with the line where a key is missing or no number."""
    values = _values(path, text)

    def number_of(name: str, default: float | None = None) -> float:
        if name not in values:
            if default is None:
                raise InputError(f"{path} has no line '{name}:'; add it (see the ROS map_server format).")
            return default
        line, value = values[name]
        return _number(value, f"{path}, line {line}: {name}")

    for name in ("image", "origin"):
        if name not in values:
            raise InputError(f"{path} has no line '{name}:'; add it (see the ROS map_server format).")
    if not values["image"][1] or not values["image"][1].isprintable() or len(values["image"][1]) > 500:
        raise InputError(
            f"{path}, line {values['image'][0]}: image names no file; write the name of the map's image there."
        )
    line, value = values["origin"]
    parts = [p for p in value.strip("[]").split(",") if p.strip()]
    where = f"{path}, line {line}: origin"
    if len(parts) not in (2, 3):
        raise InputError(f"{where} is {value[:60]!r}; it must be [x, y, yaw].")
    x, y, yaw = (*(_number(p.strip(), where) for p in parts), 0.0)[:3]
    if max(abs(x), abs(y)) > _FARTHEST:
        raise InputError(f"{where} is {value[:60]!r}, more than {_FARTHEST:.0e} m away; write it in metres.")
    resolution = number_of("resolution")
    if not _FINEST <= resolution <= _COARSEST:
        raise InputError(
            f"{path}, line {values['resolution'][0]}: resolution is {resolution}; it must be positive, in metres per "
            "cell."
        )
    mode = values.get("mode", (0, "trinary"))
    if mode[1] not in ("trinary", "scale", "raw"):
        raise InputError(f"{path}, line {mode[0]}: mode {mode[1][:60]!r} is unknown; write trinary, scale or raw.")
    negate = values.get("negate", (0, "0"))
    if negate[1].lower() not in ("0", "1", "true", "false"):
        raise InputError(f"{path}, line {negate[0]}: negate is {negate[1][:60]!r}; write 0 or 1.")
    return Description(
        values["image"][1],
        resolution,
        (x, y, math.remainder(yaw, 2 * math.pi)),
        negate[1].lower() in ("1", "true"),
        number_of("occupied_thresh", OCCUPIED_THRESHOLD),
        number_of("free_thresh", FREE_THRESHOLD),
        mode[1] == "raw",
    )


def _values(path: Path, text: str) -> dict[str, tuple[int, str]]:
    """Key -> the number of its line, and its value."""
    values: dict[str, tuple[int, str]] = {}
    items: list[str] = []
    key = ""
    for number, raw in enumerate(text.splitlines(), 1):
        content = _without_remark(raw)
        if not content or content in ("---", "..."):
            continue
        if content.startswith("-") and key == "origin" and ":" not in content:
            items.append(content[1:].strip())
            continue
        name, colon, value = content.partition(":")
        if not colon:
            raise InputError(f"{path}, line {number}: expected 'key: value', found {content[:60]!r}.")
        key = name.strip()
        values[key] = (number, _plain(value.strip()))
    if items and "origin" in values:
        values["origin"] = (values["origin"][0], "[" + ", ".join(items) + "]")
    return values


def _without_remark(line: str) -> str:
    """A # begins a remark at the beginning of a line and after a space, where it is not in quotes."""
    quote = ""
    for i, c in enumerate(line):
        if quote:
            quote = "" if c == quote and line[i - 1] != "\\" else quote
        elif c in "'\"" and line[:i].rstrip().endswith(":"):
            quote = c
        elif c == "#" and (i == 0 or line[i - 1].isspace()):
            return line[:i].strip()
    return line.strip()


def _plain(value: str) -> str:
    """The value without its quotes."""
    if len(value) >= 2 and value[0] == value[-1] == '"':
        try:
            return str(json.loads(value))
        except ValueError:
            return value[1:-1]
    return value.strip("'\"")


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where} is {text[:60]!r}; it must be a number.")
    return value
