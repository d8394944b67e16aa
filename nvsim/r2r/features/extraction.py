"""Extracts the features of all viewpoints of exported scans to the files of layouts. Resumes an interrupted run."""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
import struct
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim import __version__
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Progress, Warning
from nvsim.geometry.directions import VFOV, VIEWS
from nvsim.r2r.features.backbone import Backbone, Float32, Width
from nvsim.r2r.features.exported_scan import ExportedScan, ViewSource
from nvsim.r2r.features.feature_files import About, Rows, RowSource, description_path, write_hdf5, write_tsv
from nvsim.r2r.features.kept_rows import KeptRows, kept_rows
from nvsim.r2r.features.layouts import Layout

STAGE = "features"
_AHEAD = 2
"""Number of viewpoints whose views are read in advance."""
_SIZE = struct.Struct("<II")
"""Width and height of views in pixels, stored before each kept row."""
Prepared = tuple[list[NDArray[Any]], tuple[int, int]]


def with_images(scans: Sequence[ExportedScan], all_named: bool, listen: Listener) -> list[ExportedScan]:
    """Returns the scans that have images. An exported folder may list scans that have only a graph.

    Raises InputError if no scan has images, or if `all_named` is true and a scan has none.
    """
    without = [scan for scan in scans if not scan.has_images]
    if without and (all_named or len(without) == len(scans)):
        raise InputError(
            f"The scan {without[0].id} has neither views nor strips in {without[0].root}; export its images first."
        )
    for scan in without:
        listen(Warning(f"the scan {scan.id} has no images and is skipped", STAGE))
    return [scan for scan in scans if scan.has_images]


def extract(
    scans: Sequence[ExportedScan], layouts: Sequence[Layout], backbone: Backbone, folder: Path, listen: Listener
) -> list[Path]:
    """Writes the features of all viewpoints of `scans` to the file of each of `layouts` in `folder`; returns the
    written paths. The backbone sees each view once.

    Raises InputError if views are missing (before any computation) or damaged, if the backbone gives several rows for
    each view, or if writing fails.
    """
    if backbone.tokens != 1:
        raise InputError(
            f"{backbone.name} gives {backbone.tokens} rows of numbers for each view, but the layout {layouts[0].name} "
            "needs one row; name the pooled output in its description."
        )
    sources = [(scan, ViewSource(scan)) for scan in scans]
    places = [(scan, source, i) for scan, source in sources for i in range(len(scan.viewpoints))]
    if not places:
        raise InputError("The scans have no included viewpoints, so no features can be computed.")
    fingerprints = [source.fingerprint(i) for _, source, i in places]
    maker = hashlib.sha256(repr((backbone.digest, __version__)).encode()).hexdigest()
    keys = [f"{scan.id}_{scan.viewpoints[i]}" for scan, _, i in places]
    written: list[Path] = []
    with kept_rows(folder / layouts[0].file, maker) as kept:
        todo = [n for n, key in enumerate(keys) if not kept.contains(key, fingerprints[n])]
        done = len(places) - len(todo)
        if done:
            listen(Log(f"{done} of {len(places)} viewpoints are already computed", STAGE))
        with contextlib.closing(prefetch_views([places[n][1:] for n in todo], backbone)) as read:
            for n, (prepared, size) in zip(todo, read):
                row = np.ascontiguousarray(compute_in_batches(backbone, prepared), np.float32)
                kept.append(keys[n], fingerprints[n], _SIZE.pack(*size) + row.tobytes())
                done += 1
                listen(Progress(STAGE, done, len(places), places[n][0].id))
        for layout in layouts:
            rows = _place_rows(kept, keys, places, backbone.width + backbone.classes)
            files, about = _write_layout(layout, backbone, folder / layout.file, rows)
            number = f"{len(places)} viewpoints of {len(scans)} scan{'s' if len(scans) > 1 else ''}"
            words = f"{number}, {layout.width} numbers per view for {layout.name}"
            listen(Done(STAGE, words, {"written": [str(path) for path in files], "viewpoints": len(places), **about}))
            written += files
    return written


def _write_layout(layout: Layout, backbone: Backbone, target: Path, places: Rows) -> tuple[list[Path], About]:
    """Writes the file of a layout from the rows of the backbone. Returns the written paths, and the record of how the
    file was made."""
    fit, classes = Width(backbone.width, layout.width), backbone.classes if layout.classes else 0
    about = provenance(layout, backbone, f"{layout.width} numbers of each view: {fit.words}")
    about["logits"] = f"{classes} of ImageNet's classes behind them" if classes else "none"

    def fitted() -> Rows:
        for source, rows in places:
            values, logits = rows[:, : backbone.width], rows[:, backbone.width :][:, :classes]
            yield source, np.ascontiguousarray(np.concatenate([fit(values), logits], axis=1), np.float32)

    write = write_tsv if layout.is_tsv else write_hdf5
    write(target, fitted(), about, round(math.degrees(VFOV)))
    return [target, description_path(target)] if layout.is_tsv else [target], about


def provenance(layout: Layout, backbone: Backbone, features: str) -> About:
    """Returns the record of how a features file was made, which is stored with it."""
    return {
        "backbone": backbone.name,
        "features": features,
        "layout": f"{layout.name}, read by {layout.readers}",
        "made_by": f"NVSim {__version__}",
    }


def compute_in_batches(backbone: Backbone, prepared: Sequence[NDArray[Any]]) -> Float32:
    """Computes (N, tokens * width + classes) float32 for any number N of prepared images, in batches."""
    batches = range(0, len(prepared), backbone.batch)
    return np.concatenate([backbone.features(prepared[at : at + backbone.batch]) for at in batches])


def _place_rows(
    kept: KeptRows, keys: list[str], places: list[tuple[ExportedScan, ViewSource, int]], width: int
) -> Rows:
    for key, (scan, _, index) in zip(keys, places, strict=True):
        data = kept.get(key)
        if len(data) != _SIZE.size + 4 * VIEWS * width:
            raise InputError(f"{kept.path} has a row of another width for {key}; remove the file and start again.")
        size = _SIZE.unpack_from(data)
        row = np.frombuffer(data, np.float32, offset=_SIZE.size).reshape(VIEWS, width)
        yield RowSource(scan.id, scan.viewpoints[index], (size[0], size[1])), row


def prefetch_views(places: Sequence[tuple[ViewSource, int]], backbone: Backbone) -> Generator[Prepared, None, None]:
    """Yields the prepared views and their size (width, height) for each place, read in advance by threads.

    Close the generator when you stop early.
    """
    pool = ThreadPoolExecutor(min(_AHEAD, os.cpu_count() or 1))
    waiting: deque[Future[Prepared]] = deque()
    try:
        for source, index in places:
            waiting.append(pool.submit(source.each_view, index, backbone.prepared))
            if len(waiting) > _AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
