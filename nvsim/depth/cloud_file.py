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
from nvsim.files.reading import reading
from nvsim.files.regular import opened

_AGAIN = "run `nvsim depth --project` again"
_MOST = 50_000_000  # points, 1.5 GB
_HEADER = 1 << 12  # bytes
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
    rows = np.empty(len(cloud.points), _LAYOUT)
    for names, values in (("xyz", cloud.points), (("nx", "ny", "nz"), cloud.normals)):
        for axis, name in enumerate(names):
            rows[name] = values[:, axis]
    for channel, name in enumerate(("red", "green", "blue")):
        rows[name] = cloud.colors[:, channel]
    rows["views"] = cloud.views
    properties = [f"property {_TYPES[_LAYOUT[name].str]} {name}" for name in _LAYOUT.names or ()]
    header = ["ply", "format binary_little_endian 1.0", "comment Vertical Axis: z", f"element vertex {len(rows)}"]
    text = "\n".join([*header, *properties, "end_header", ""])
    with atomic.replacing(path) as temporary, open(temporary, "wb") as file:
        file.write(text.encode("ascii"))
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
        data = np.frombuffer(file.read(rows.count * _LAYOUT.itemsize), _LAYOUT)
        points, normals = (
            np.stack([data[name] for name in names], axis=1) for names in (("x", "y", "z"), ("nx", "ny", "nz"))
        )
        if len(data) < rows.count or not (np.isfinite(points).all() and np.isfinite(normals).all()):
            raise InputError(f"{path} has invalid points; {_AGAIN}.")
        colors = np.stack([data[name] for name in ("red", "green", "blue")], axis=1)
        return FusedCloud(points, colors, normals, data["views"].copy())


def as_cloud(fused: FusedCloud) -> Cloud:
    """The fused cloud as the point cloud of a capture."""
    return Cloud(fused.points, fused.colors, "images", fused.normals)
