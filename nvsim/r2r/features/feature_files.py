"""Writes features to the HDF5 and TSV files that agents read.

HDF5: a dataset "<scan>_<viewpoint>" of (36, width) float32, gzip, with scanId, viewpointId, image_w, image_h, vfov.
TSV: no header, scanId, viewpointId, image_w, image_h, vfov, base64 of (36, width) float32. Views are in the order of
viewIndex. The record of how the features were made is in the attributes of the HDF5 file, or in a JSON file beside the
TSV.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from nvsim.files import atomic
from nvsim.r2r.features.backbone import Float32
from nvsim.r2r.features.quiet_file import quietly_written


@dataclass(frozen=True)
class Place:
    """The source of a row: scan, viewpoint, and width and height of its views in pixels."""

    scan: str
    viewpoint: str
    size: tuple[int, int]


Rows = Iterable[tuple[Place, Float32]]
About = dict[str, str | int]


def write_hdf5(path: Path, rows: Rows, about: About, vfov: int) -> None:
    """Writes (36, width) float32 rows and their record. `vfov` is in degrees. Raises InputError if writing fails."""
    import h5py

    with atomic.replacing(path) as temporary, quietly_written(temporary) as quiet, h5py.File(quiet, "w") as file:
        file.attrs.update(about)
        for place, row in rows:
            data = file.create_dataset(f"{place.scan}_{place.viewpoint}", data=row, compression="gzip")
            data.attrs["scanId"], data.attrs["viewpointId"] = place.scan, place.viewpoint
            data.attrs["image_w"], data.attrs["image_h"] = place.size
            data.attrs["vfov"] = vfov
            quiet.check()


def write_tsv(path: Path, rows: Rows, about: About, vfov: int) -> None:
    """Writes (36, width) float32 rows and their record. `vfov` is in degrees. Raises InputError if writing fails."""
    with atomic.replacing(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        for place, row in rows:
            values = base64.b64encode(row.tobytes()).decode("ascii")
            file.write("\t".join([place.scan, place.viewpoint, *map(str, place.size), str(vfov), values]) + "\n")
    atomic.write_text(about_of(path), json.dumps(about, indent=1) + "\n")


def about_of(tsv: Path) -> Path:
    """Returns the path of the JSON file beside a TSV."""
    return tsv.with_suffix(".json")
