"""The fused point cloud on disk: a PLY file that point cloud viewers open, with normals and observation counts."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from nvsim.capture.ply import binary_rows
from nvsim.capture.types import Cloud
from nvsim.depth.fusion import FusedCloud
from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.opening import opened
from nvsim.files.reading import reading

_AGAIN = "run `nvsim depth --project` again"
_MOST = 50_000_000  # points, 1.5 GB
_BLOCK = 1 << 20  # points that are converted at the same time, 30 MB
_HEADER = 1 << 12  # bytes
_RGB = "red", "green", "blue"
_LAYOUT = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")),
        *((name, "u1") for name in ("red", "green", "blue")),
        ("views", "<u2"),
    ]
)
_TYPES = {"<f4": "float", "|u1": "uchar", "<u2": "ushort"}


def write_cloud(path: Path, cloud: FusedCloud) -> None:
    """Write the point cloud atomically as binary little-endian PLY.

    The properties are x y z nx ny nz as float, red green blue as uchar, views as ushort. Raises InputError if the file
    cannot be written."""
    properties = [f"property {_TYPES[_LAYOUT[name].str]} {name}" for name in _LAYOUT.names or ()]
    count = len(cloud.points)
    header = ["ply", "format binary_little_endian 1.0", "comment Vertical Axis: z", f"element vertex {count}"]
    text = "\n".join([*header, *properties, "end_header", ""])
    with atomic.replacement_file(path) as temporary, open(temporary, "wb") as file:
        file.write(text.encode("ascii"))
        for start in range(0, count, _BLOCK):
            part = slice(start, start + _BLOCK)
            rows = np.empty(len(cloud.points[part]), _LAYOUT)
            for names, values in (("xyz", cloud.points), (("nx", "ny", "nz"), cloud.normals), (_RGB, cloud.colors)):
                for axis, name in enumerate(names):
                    rows[name] = values[part, axis]
            rows["views"] = cloud.views[part]
            rows.tofile(file)


def read_cloud_file(path: Path) -> FusedCloud:
    """The point cloud that `write_cloud` wrote. Raises InputError if the file is missing, damaged, of another format,
    or has more than 50 million points."""
    with reading(path, "a cloud of depth maps", _AGAIN), opened(path) as file:
        size = os.fstat(file.fileno()).st_size
        rows = binary_rows(path, file.read(_HEADER), size)
        if rows is None or rows.layout != _LAYOUT or rows.count > _MOST:
            raise InputError(f"{path} is not a cloud of depth maps; {_AGAIN}.")
        file.seek(rows.start)
        points, normals = (np.empty((rows.count, 3), np.float32) for _ in range(2))
        colors, views = np.empty((rows.count, 3), np.uint8), np.empty(rows.count, np.uint16)
        for start in range(0, rows.count, _BLOCK):
            part = slice(start, min(start + _BLOCK, rows.count))
            data = np.frombuffer(file.read((part.stop - start) * _LAYOUT.itemsize), _LAYOUT)
            if len(data) < part.stop - start:
                raise InputError(f"{path} is truncated; {_AGAIN}.")
            for names, values in (("xyz", points), (("nx", "ny", "nz"), normals), (_RGB, colors)):
                for axis, name in enumerate(names):
                    values[part, axis] = data[name]
            views[part] = data["views"]
            if not (np.isfinite(points[part]).all() and np.isfinite(normals[part]).all()):
                raise InputError(f"{path} has invalid points; {_AGAIN}.")
        return FusedCloud(points, colors, normals, views)


def as_cloud(fused: FusedCloud) -> Cloud:
    """The fused cloud as the point cloud of a capture."""
    return Cloud(fused.points, fused.colors, "images", fused.normals)
