"""Extracts the features of exported scans to the files of layouts. Resumes an interrupted run.

Most layouts have one row for each of the 36 views of a viewpoint, and layouts with equal backbones share its work.
NavGPT-2 reads all patches of the views that show the candidates of a viewpoint, in the order of the candidates' numbers
in `scanvp_candidates.json`. Source: NavGPT-2, map_nav_src/r2r/env.py.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import struct
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim import __version__
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Progress, Warning
from nvsim.files import atomic
from nvsim.geometry.directions import VFOV, VIEWS
from nvsim.r2r.features.backbone import Backbone, Float32, Width
from nvsim.r2r.features.candidates import candidates_of
from nvsim.r2r.features.exported_scan import ExportedScan, ViewSource
from nvsim.r2r.features.feature_files import (
    About,
    Rows,
    RowSource,
    description_path,
    lmdb_key,
    packed_array,
    write_hdf5,
    write_lmdb,
    write_tsv,
)
from nvsim.r2r.features.kept_rows import KeptRows, kept_rows
from nvsim.r2r.features.layouts import Layout, missing_package_error

STAGE = "features"
_AHEAD = 2
"""Number of viewpoints whose views are read in advance."""
_SIZE = struct.Struct("<II")
"""Width and height of views in pixels, stored before each kept row."""
Prepared = tuple[list[NDArray[Any]], tuple[int, int]]


@dataclass(frozen=True, eq=False)
class ViewpointViews:
    """The views of the viewpoint `index` of a scan."""

    scan: ExportedScan
    index: int
    source: ViewSource

    @property
    def key(self) -> str:
        """The scan id and the viewpoint id, as agents join them."""
        return f"{self.scan.id}_{self.scan.viewpoints[self.index]}"


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


def extract_layouts(
    scans: Sequence[ExportedScan], chosen: Sequence[tuple[Layout, Backbone]], folder: Path, listen: Listener
) -> Iterator[tuple[list[Layout], list[Path]]]:
    """Writes the file of each layout to `folder`. Layouts with equal backbones come together. Yields the layouts that
    were written together, and the written paths. Raises InputError as `extract` and `extract_candidates` do."""
    groups: dict[str, tuple[list[Layout], Backbone]] = {}
    for layout, backbone in chosen:
        if layout.tokens:
            yield [layout], extract_candidates(scans, layout, backbone, folder, listen)
        else:
            groups.setdefault(backbone.digest, ([], backbone))[0].append(layout)
    for layouts, backbone in groups.values():
        yield layouts, extract(scans, layouts, backbone, folder, listen)


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
    places = _places_in(scans)
    marks = [place.source.fingerprint(place.index) for place in places]
    maker = hashlib.sha256(repr((backbone.digest, __version__)).encode()).hexdigest()

    def row(number: int, prepared: list[NDArray[Any]], size: tuple[int, int]) -> bytes:
        return _SIZE.pack(*size) + np.ascontiguousarray(_compute_in_batches(backbone, prepared), np.float32).tobytes()

    written: list[Path] = []
    with _computed_rows(folder / layouts[0].file, maker, places, marks, backbone, row, listen) as kept:
        for layout in layouts:
            rows = _place_rows(kept, places, backbone.width + backbone.classes)
            files, about = _write_layout(layout, backbone, folder / layout.file, rows)
            number = f"{len(places)} viewpoints of {len(scans)} scan{'s' if len(scans) > 1 else ''}"
            words = f"{number}, {layout.width} numbers per view for {layout.name}"
            listen(Done(STAGE, words, {"written": [str(path) for path in files], "viewpoints": len(places), **about}))
            written += files
    return written


def extract_candidates(
    scans: Sequence[ExportedScan], layout: Layout, backbone: Backbone, folder: Path, listen: Listener
) -> list[Path]:
    """Writes the features of the candidates of all viewpoints of `scans` to the file of `layout` in `folder`.

    If the backbone gives one row for each view, the row is repeated for each token. Returns the written paths.

    Raises InputError if views are missing (before any computation) or damaged, if the number of tokens does not match,
    if the package lmdb is missing, or if writing fails.
    """
    if sentence := missing_package_error(layout):
        raise InputError(sentence)
    if backbone.tokens not in (1, layout.tokens):
        raise InputError(
            f"{backbone.name} gives {backbone.tokens} rows of numbers for each view, but the layout {layout.name} "
            f"needs {layout.tokens} rows, or one row to repeat; name another output in its description."
        )
    target = folder / layout.file
    fit = Width(backbone.width, layout.width)
    repeated = backbone.tokens < layout.tokens
    rows = f"one row of a view, repeated {layout.tokens} times" if repeated else f"{layout.tokens} rows of a view"
    about = _provenance(layout, backbone, f"{rows}, {layout.width} numbers each: {fit.words}")
    about["order"] = "candidates of a viewpoint by their number in scanvp_candidates.json"
    places = _places_in(scans)
    views = [seen for scan in scans for seen in _candidate_views(scan)]
    marks = [
        place.source.fingerprint(place.index) + seen.astype(np.uint8).tobytes()
        for place, seen in zip(places, views, strict=True)
    ]
    keys = {place.key: lmdb_key(place.key) for place in places}
    maker = hashlib.sha256(repr((backbone.digest, about)).encode()).hexdigest()

    def row(number: int, prepared: list[NDArray[Any]], size: tuple[int, int]) -> bytes:
        seen = views[number]
        array = np.empty((len(seen), layout.tokens, layout.width), np.float32)
        array[:] = _tokens(backbone, fit, [prepared[view] for view in seen])
        return packed_array(array)

    with _computed_rows(target, maker, places, marks, backbone, row, listen) as kept:
        write_lmdb(target, kept, keys, 4 * layout.tokens * layout.width * sum(map(len, views)))
    atomic.write_text(description_path(target), json.dumps(about, indent=1) + "\n")
    words = f"{len(places)} viewpoints, {layout.tokens} times {layout.width} numbers per candidate"
    listen(Done(STAGE, words, {"written": [str(target)], "viewpoints": len(places), **about}))
    return [target, description_path(target)]


def _places_in(scans: Sequence[ExportedScan]) -> list[ViewpointViews]:
    places = [
        ViewpointViews(scan, i, source)
        for scan, source in ((scan, ViewSource(scan)) for scan in scans)
        for i in range(len(scan.viewpoints))
    ]
    if not places:
        raise InputError("The scans have no included viewpoints, so no features can be computed.")
    return places


@contextmanager
def _computed_rows(
    target: Path,
    made_by: str,
    places: Sequence[ViewpointViews],
    marks: Sequence[bytes],
    backbone: Backbone,
    row: Callable[[int, list[NDArray[Any]], tuple[int, int]], bytes],
    listen: Listener,
) -> Iterator[KeptRows]:
    """Yields the kept rows of the file `target` with a row for each place, see `kept_rows`.

    marks   fingerprints of the places; a kept row with an equal fingerprint is not computed again
    row     the data of a place: its number, its prepared views, and their width and height in pixels -> data
    """
    with kept_rows(target, made_by) as kept:
        todo = [n for n, place in enumerate(places) if not kept.contains(place.key, marks[n])]
        done = len(places) - len(todo)
        if done:
            listen(Log(f"{done} of {len(places)} viewpoints are already computed", STAGE))
        with contextlib.closing(_prefetch_views([places[n] for n in todo], backbone)) as read:
            for n, (prepared, size) in zip(todo, read):
                kept.append(places[n].key, marks[n], row(n, prepared, size))
                done += 1
                listen(Progress(STAGE, done, len(places), places[n].scan.id))
        yield kept


def _write_layout(layout: Layout, backbone: Backbone, target: Path, places: Rows) -> tuple[list[Path], About]:
    """Writes the file of a layout from the rows of the backbone. Returns the written paths, and the record of how the
    file was made."""
    fit, classes = Width(backbone.width, layout.width), backbone.classes if layout.classes else 0
    about = _provenance(layout, backbone, f"{layout.width} numbers of each view: {fit.words}")
    about["logits"] = f"{classes} of ImageNet's classes behind them" if classes else "none"

    def fitted() -> Rows:
        for source, rows in places:
            values, logits = rows[:, : backbone.width], rows[:, backbone.width :][:, :classes]
            yield source, np.ascontiguousarray(np.concatenate([fit(values), logits], axis=1), np.float32)

    write = write_tsv if layout.is_tsv else write_hdf5
    write(target, fitted(), about, round(math.degrees(VFOV)))
    return [target, description_path(target)] if layout.is_tsv else [target], about


def _provenance(layout: Layout, backbone: Backbone, features: str) -> About:
    """Returns the record of how a features file was made, which is stored with it."""
    return {
        "backbone": backbone.name,
        "features": features,
        "layout": f"{layout.name}, read by {layout.readers}",
        "made_by": f"NVSim {__version__}",
    }


def _compute_in_batches(backbone: Backbone, prepared: Sequence[NDArray[Any]]) -> Float32:
    """Computes (N, tokens * width + classes) float32 for any number N of prepared images, in batches."""
    batches = range(0, len(prepared), backbone.batch)
    return np.concatenate([backbone.features(prepared[at : at + backbone.batch]) for at in batches])


def _place_rows(kept: KeptRows, places: Sequence[ViewpointViews], width: int) -> Rows:
    for place in places:
        data = kept.get(place.key)
        if len(data) != _SIZE.size + 4 * VIEWS * width:
            raise InputError(
                f"{kept.path} has a row of another width for {place.key}; remove the file and start again."
            )
        size = _SIZE.unpack_from(data)
        row = np.frombuffer(data, np.float32, offset=_SIZE.size).reshape(VIEWS, width)
        yield RowSource(place.scan.id, place.scan.viewpoints[place.index], (size[0], size[1])), row


def _candidate_views(scan: ExportedScan) -> list[NDArray[np.int64]]:
    """Returns for every viewpoint (n,) the viewIndex of each candidate, in the order of the candidates' numbers."""
    found = candidates_of(scan.positions, scan.edges)
    return [found.view[found.source == i] for i in range(len(scan.viewpoints))]


def _tokens(backbone: Backbone, fit: Width, prepared: Sequence[NDArray[Any]]) -> Float32:
    """Returns (N, tokens or 1, width of the layout) of N prepared views."""
    if not prepared:
        return np.empty((0, 1, 1), np.float32)
    rows = _compute_in_batches(backbone, prepared)[:, : backbone.tokens * backbone.width]
    fitted = fit(rows.reshape(-1, backbone.width))
    return fitted.reshape(len(prepared), backbone.tokens, -1)


def _prefetch_views(places: Sequence[ViewpointViews], backbone: Backbone) -> Generator[Prepared, None, None]:
    """Yields the prepared views and their size (width, height) for each place, read in advance by threads.

    Close the generator when you stop early.
    """
    pool = ThreadPoolExecutor(min(_AHEAD, os.cpu_count() or 1))
    waiting: deque[Future[Prepared]] = deque()
    try:
        for place in places:
            waiting.append(pool.submit(place.source.each_view, place.index, backbone.prepared))
            if len(waiting) > _AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
