"""Compute features of objects from their boxes in the 36 views, in the HDF5 files of agents for REVERIE and SOON.

A dataset "<scan>_<viewpoint>" of (N, width) float32 has a row for each object with boxes there. Its attributes are
obj_ids (N) text, directions (N, 2) heading and elevation in radians, sizes (N, 2) width and height of the largest box,
that box in bboxes (N, 4), and its view in viewindexs (N). Pixels are those of views of 640x480. A row is the mean of up
to three boxes, the largest ones.

Sources: VLN-DUET, map_nav_src/reverie/data_utils.py and map_nav_src/soon/data_utils.py; VLN-HAMT,
finetune_src/reverie/data_utils.py.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.events import Listener, Progress
from nvsim.files import atomic
from nvsim.geometry.directions import HEIGHT, VFOV, WIDTH, heading_and_elevation
from nvsim.r2r.features.backbone import Backbone, Float32, Image, Width
from nvsim.r2r.features.exported_scan import ExportedScan, ViewSource
from nvsim.r2r.features.feature_files import quietly_written

BoxForm = Literal["size", "corners"]
"""The last two numbers of a box: its width and height, as VLN-HAMT reads them, or its right and lower end, as SOON."""
Boxes = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""SCAN_VIEWPOINT -> object -> `visible_pos` and `bbox2d`, the content of BBoxes.json."""
FILES: dict[str, BoxForm] = {"objects.hdf5": "size", "objects_corners.hdf5": "corners"}
STAGE = "features"
_AVERAGED = 3  # boxes of an object
_NOTHING = {"none": {"visible_pos": [12], "bbox2d": [[0, 0, WIDTH, HEIGHT]]}}
_FOCAL = HEIGHT / 2 / math.tan(VFOV / 2)


def write_object_features(
    scans: Sequence[ExportedScan],
    boxes: Boxes,
    backbone: Backbone,
    width: int,
    folder: Path,
    listen: Listener,
) -> None:
    """Writes the features of the objects in `boxes`, `width` numbers each, to FILES in `folder`.

    Raises InputError if views are missing or damaged, or if writing fails.
    """
    import h5py

    rows = list(_rows(scans, boxes, backbone, Width(backbone.width, width), listen))
    for name, form in FILES.items():
        with (
            atomic.replacement_file(folder / name) as temporary,
            quietly_written(temporary) as quiet,
            h5py.File(quiet, "w") as file,
        ):
            file.attrs["backbone"] = backbone.name
            for key, features, ids, views, found in rows:
                if form == "size" and not boxes.get(key):
                    continue
                data = file.create_dataset(key, data=features)
                data.attrs["obj_ids"] = list(ids)
                data.attrs["directions"] = np.array([_direction(v, box) for v, box in zip(views, found)], np.float32)
                data.attrs["sizes"] = found[:, 2:].astype(np.float32)
                ends = np.concatenate([found[:, :2], found[:, :2] + found[:, 2:]], axis=1)
                data.attrs["bboxes"] = (found if form == "size" else ends).astype(np.float32)
                data.attrs["viewindexs"] = np.array(views)
                quiet.check()


def _rows(
    scans: Sequence[ExportedScan], boxes: Boxes, backbone: Backbone, fit: Width, listen: Listener
) -> Iterator[tuple[str, Float32, Sequence[str], list[int], NDArray[np.int64]]]:
    """Yields the key, the features (N, width), the ids, and view and box (N, 4) of the largest box of each object."""
    places = [(scan, i) for scan in scans for i in range(len(scan.viewpoints))]
    for done, (scan, i) in enumerate(places, 1):
        key = f"{scan.id}_{scan.viewpoints[i]}"
        things = boxes.get(key) or _NOTHING
        chosen = [_largest(one) for one in things.values()]
        parts = _parts(scan, i, chosen, backbone)
        batches = [parts[at : at + backbone.batch] for at in range(0, len(parts), backbone.batch)]
        features = np.concatenate([backbone.features([image for _, image in batch]) for batch in batches])
        whose = np.array([n for n, _ in parts])
        means = np.stack([features[whose == n, : backbone.width].mean(axis=0) for n in range(len(chosen))])
        first = [found[0] for found in chosen]
        yield key, fit(means), tuple(things), [view for view, _ in first], np.array([box for _, box in first])
        listen(Progress(STAGE, done, len(places), scan.id))


def _parts(
    scan: ExportedScan, index: int, chosen: Sequence[Sequence[tuple[int, Sequence[int]]]], backbone: Backbone
) -> list[tuple[int, NDArray[Any]]]:
    """Returns the prepared image of each chosen (view, box) of the objects, with the number of the object."""
    views = itertools.count()

    def cut(image: Image) -> list[tuple[int, NDArray[Any]]]:
        view, scale = next(views), image.shape[1] / WIDTH
        boxes = [(n, box) for n, found in enumerate(chosen) for at, box in found if at == view]
        return [(n, backbone.prepared(_part(image, box, scale))) for n, box in boxes]

    return list(itertools.chain.from_iterable(ViewSource(scan).each_view(index, cut)[0]))


def _largest(thing: Mapping[str, Any]) -> list[tuple[int, Sequence[int]]]:
    found = zip(thing["visible_pos"], thing["bbox2d"], strict=True)
    return sorted(found, key=lambda one: -one[1][2] * one[1][3])[:_AVERAGED]


def _part(image: Image, box: Sequence[int], scale: float) -> Image:
    x, y, w, h = (round(scale * value) for value in box)
    return np.ascontiguousarray(image[y : y + max(h, 1), x : x + max(w, 1)])


def _direction(view: int, box: NDArray[np.int64]) -> tuple[float, float]:
    """The heading in [0, 2 pi) and the elevation of the middle of a box."""
    heading, elevation = heading_and_elevation(view)
    right = (box[0] + box[2] / 2 - WIDTH / 2) / _FOCAL
    up = (HEIGHT / 2 - box[1] - box[3] / 2) / _FOCAL
    ahead = math.cos(elevation) - up * math.sin(elevation)
    rise = math.sin(elevation) + up * math.cos(elevation)
    return (heading + math.atan2(right, ahead)) % (2 * math.pi), math.atan2(rise, math.hypot(right, ahead))
