"""ROS map_server pairs: a YAML file that names a grey image and says how grey becomes free, occupied or unknown.

Format: wiki.ros.org/map_server, section 2 (map format). Free is written as 254, occupied as 0, unknown as 205.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.decoding import decoded
from nvsim.files.reading import reading
from nvsim.files.regular import read_bytes
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap

_GREY = {int(FREE): 254, int(OCCUPIED): 0, int(UNKNOWN): 205}
# 0.196 keeps grey 205, whose occupancy is 0.19608, unknown.
_OCCUPIED_THRESHOLD, _FREE_THRESHOLD = 0.65, 0.196
_LONGEST = 1_000_000  # bytes of a YAML file
_FINEST, _COARSEST, _FARTHEST = 1e-4, 1e3, 1e7  # metres


@dataclass(frozen=True)
class _Description:
    image: str
    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    occupied: float
    free: float
    raw: bool


def read_ros_map(yaml_path: Path) -> OccupancyMap:
    """The map of `yaml_path` and the image that it names (PGM, PNG, ...).

    Raises InputError when a file is missing or unreadable, a key is missing or not a number, or the map is turned.
    """
    with reading(yaml_path, "a ROS map", "export the map again"):
        return _read(yaml_path)


def _read(yaml_path: Path) -> OccupancyMap:
    description = _parse(yaml_path)
    image_path = yaml_path.parent / description.image
    picture = _read_picture(image_path, yaml_path)
    # Every grey is judged once; a map has far more cells than greys.
    grey = np.linspace(0.0, 255.0, np.iinfo(picture.dtype).max + 1)
    states = np.full(grey.shape, UNKNOWN, np.uint8)
    if description.raw:
        states[(grey <= 100) & (grey >= 100 * description.occupied)] = OCCUPIED
        states[grey <= 100 * description.free] = FREE
    else:
        occupancy = grey / 255.0 if description.negate else (255.0 - grey) / 255.0
        states[occupancy > description.occupied] = OCCUPIED
        states[occupancy < description.free] = FREE
    return OccupancyMap(states[picture[::-1]], description.resolution, description.origin[:2])


def write_ros_map(occupancy: OccupancyMap, yaml_path: Path) -> Path:
    """Writes `yaml_path` and beside it a PGM of the same name; returns the path of the image.

    Raises InputError when the disk refuses.
    """
    image_path = yaml_path.with_suffix(".pgm")
    table = np.zeros(256, np.uint8)
    for state, value in _GREY.items():
        table[state] = value
    rows, columns = occupancy.cells.shape
    header = f"P5\n{columns} {rows}\n255\n".encode()
    atomic.write_bytes(image_path, header + table[occupancy.cells[::-1]].tobytes())
    x, y = occupancy.origin
    atomic.write_text(
        yaml_path,
        f"image: {image_path.name}\nresolution: {occupancy.resolution!r}\norigin: [{float(x)!r}, {float(y)!r}, 0.0]\n"
        f"negate: 0\noccupied_thresh: {_OCCUPIED_THRESHOLD}\nfree_thresh: {_FREE_THRESHOLD}\n",
    )
    return image_path


def _read_picture(path: Path, named_by: Path) -> NDArray[np.uint8 | np.uint16]:
    """(H, W) grey, from 0 to the largest number of its type."""
    import cv2

    try:
        data = read_bytes(path)
    except InputError as error:
        raise InputError(
            f"{str(error).rstrip('.')} ({named_by} names it as its image; put the image there or mend the line "
            "'image:')."
        ) from error
    picture = decoded(data, path, cv2.IMREAD_UNCHANGED, what="the image of a map", then="export the map again")
    if picture.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path} has pixels of type {picture.dtype}; export the map again with 8 or 16 bits.")
    if picture.ndim == 3:
        total = picture[..., :3].astype(np.uint32).sum(axis=-1)
        picture = (total // min(3, picture.shape[2])).astype(picture.dtype)
    return picture


def _parse(path: Path) -> _Description:
    """map_server's YAML is a flat mapping; its only list, the origin, may be in brackets or in dashes."""
    try:
        text = read_bytes(path, _LONGEST).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"Cannot read the map {path}: it is not text; name the .yaml file of a ROS map.") from error
    values: dict[str, tuple[int, str]] = {}
    items: list[str] = []
    key = ""
    for number, raw in enumerate(text.splitlines(), 1):
        content = raw.split("#", 1)[0].strip()
        if not content or content in ("---", "..."):
            continue
        if content.startswith("-") and key == "origin" and ":" not in content:
            items.append(content[1:].strip())
            continue
        name, colon, value = content.partition(":")
        if not colon:
            raise InputError(f"{path}, line {number}: expected 'key: value', found {content[:60]!r}.")
        key = name.strip()
        values[key] = (number, value.strip().strip("'\""))
    if items and "origin" in values:
        values["origin"] = (values["origin"][0], "[" + ", ".join(items) + "]")

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
    if abs(math.remainder(yaw, 2 * math.pi)) > 1e-4:
        raise InputError(f"{where} turns the map by {yaw} rad; turn the image instead and write yaw 0.")
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
    return _Description(
        values["image"][1],
        resolution,
        (x, y, yaw),
        negate[1].lower() in ("1", "true"),
        number_of("occupied_thresh", _OCCUPIED_THRESHOLD),
        number_of("free_thresh", _FREE_THRESHOLD),
        mode[1] == "raw",
    )


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where} is {text[:60]!r}; it must be a number.")
    return value
