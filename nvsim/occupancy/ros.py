"""ROS map_server pairs: a YAML file that names a gray image and maps gray values to free, occupied, and unknown cells.

Format: wiki.ros.org/map_server, section 2 (map format). Free is written as 254, occupied as 0, unknown as 205.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.images import decode_pixels
from nvsim.files.opening import parse_json, read_bytes
from nvsim.files.reading import reading
from nvsim.files.records import record_of
from nvsim.occupancy.ros_description import (
    FREE_THRESHOLD,
    OCCUPIED_THRESHOLD,
    description_text,
    find_image,
    parse_description,
    quoted,
)
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap, transformed_map

Source = Literal["lidar", "depth", "images", "trained"]
"""The data from which rays were cast: LiDAR scans, images of a depth camera, depth estimated from images, or the
rendered depth of trained models."""
MARK = "# nvsim:"


@dataclass(frozen=True)
class Provenance:
    """source                  data from which the map was made
    note                    method and caveats, as text
    from_height, to_height  meters over the floor between which objects are obstacles
    makers                  digests of the project and of the trajectory used to make the map
    """

    source: Source
    note: str
    from_height: float
    to_height: float
    makers: tuple[str, ...] = ()

    def line(self) -> str:
        """The comment line, without a line end."""
        return f"{MARK} {json.dumps(asdict(self), ensure_ascii=True)}"


def provenance_in(path: Path, text: str) -> Provenance | None:
    """The provenance in the `text` of the YAML file `path`; None if there is none. Raises InputError if the comment is
    damaged."""
    remarks = [line for line in text.splitlines() if line.startswith(MARK)]
    if not remarks:
        return None
    then = f"delete the line that begins with {MARK!r}, or build the map again"
    found = parse_json(path, remarks[0].removeprefix(MARK), "a map with a valid provenance", then)
    try:
        return record_of(Provenance, found)
    except ValueError as error:
        raise InputError(f"{path} has a provenance in an invalid form; {then}.") from error


_GRAY = {int(FREE): 254, int(OCCUPIED): 0, int(UNKNOWN): 205}


def read_ros_map(yaml_path: Path) -> OccupancyMap:
    """The map of `yaml_path` and the image that it names (PGM, PNG, ...).

    If the image is not at the named path, it is searched by name beside the YAML file, and a note reports it. A map
    with a rotated origin is resampled by `turned`.

    Raises InputError if a file is missing or unreadable, or if a key is missing or not a number.
    """
    with reading(yaml_path, "a ROS map", "export the map again"):
        return _read(yaml_path)


def read_provenance(yaml_path: Path) -> Provenance | None:
    """The provenance of the map; None if it has none, or if the file is not a YAML file. Raises InputError if the file
    cannot be read."""
    if yaml_path.suffix.lower() not in (".yaml", ".yml"):
        return None
    with reading(yaml_path, "a ROS map", "export the map again"):
        return provenance_in(yaml_path, description_text(yaml_path))


def _read(yaml_path: Path) -> OccupancyMap:
    description = parse_description(yaml_path, description_text(yaml_path))
    image_path, note = find_image(yaml_path, description.image)
    picture = _read_picture(image_path, yaml_path)
    # Every gray value is classified once, because a map has far more cells than gray values.
    gray = np.linspace(0.0, 255.0, np.iinfo(picture.dtype).max + 1)
    states = np.full(gray.shape, UNKNOWN, np.uint8)
    if description.raw:
        states[(gray <= 100) & (gray >= 100 * description.occupied)] = OCCUPIED
        states[gray <= 100 * description.free] = FREE
    else:
        occupancy = gray / 255.0 if description.negate else (255.0 - gray) / 255.0
        states[occupancy > description.occupied] = OCCUPIED
        states[occupancy < description.free] = FREE
    x, y, yaw = description.origin
    notes = (note,) if note else ()
    if yaw == 0:
        return OccupancyMap(states[picture[::-1]], description.resolution, (x, y), notes)
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    return transformed_map(OccupancyMap(states[picture[::-1]], description.resolution, (0.0, 0.0), notes), turn, (x, y))


def write_ros_map(occupancy: OccupancyMap, yaml_path: Path, provenance: Provenance | None = None) -> Path:
    """Write `yaml_path`, with its `provenance` as a comment, and a PGM beside it; returns the path of the image.

    The PGM has the stem of the YAML file. Both files are replaced together, after both are complete.

    Raises InputError if the files cannot be written.
    """
    image_path = yaml_path.with_suffix(".pgm")
    table = np.zeros(256, np.uint8)
    for state, value in _GRAY.items():
        table[state] = value
    rows, columns = occupancy.cells.shape
    header = f"P5\n{columns} {rows}\n255\n".encode()
    x, y = occupancy.origin
    remark = "" if provenance is None else f"{provenance.line()}\n"
    text = (
        f"{remark}image: {quoted(image_path.name)}\nresolution: {occupancy.resolution!r}\n"
        f"origin: [{float(x)!r}, {float(y)!r}, 0.0]\n"
        f"negate: 0\noccupied_thresh: {OCCUPIED_THRESHOLD}\nfree_thresh: {FREE_THRESHOLD}\nmode: trinary\n"
    )
    words = atomic.encode_text(yaml_path, text)
    with atomic.replacement_file(yaml_path) as description, atomic.replacement_file(image_path) as image:
        image.write_bytes(header + table[occupancy.cells[::-1]].tobytes())
        description.write_bytes(words)
    return image_path


def _read_picture(path: Path, named_by: Path) -> NDArray[np.uint8 | np.uint16]:
    """(H, W) gray values, from 0 to the largest number of the type."""
    import cv2

    try:
        data = read_bytes(path)
    except InputError as error:
        raise InputError(
            f"{str(error).rstrip('.')} ({named_by} names it as its image; put the image there or correct the line "
            "'image:')."
        ) from error
    picture = decode_pixels(data, path, cv2.IMREAD_UNCHANGED, what="the image of a map", then="export the map again")
    if picture.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path} has pixels of type {picture.dtype}; export the map again with 8 or 16 bits.")
    if picture.ndim == 3:
        total = picture[..., :3].astype(np.uint32).sum(axis=-1)
        picture = (total // min(3, picture.shape[2])).astype(picture.dtype)
    return picture
