"""Extracts features of the views that show a viewpoint's candidates, as NavGPT-2 reads them: all patches of each view.

Format: an LMDB. The value of a key SCAN_VIEWPOINT is a msgpack of an array: the bytes `data`, the NumPy `type`, and the
`shape` (candidates, tokens, width). The candidates are in the order of their numbers in `scanvp_candidates.json`.
Source: NavGPT-2, map_nav_src/utils/data.py (reader) and map_nav_src/r2r/env.py (order).

The arrays are kept as rows until all are complete, for two reasons. LMDB does not survive a power loss unless it waits
for the disk after every array, and it crashes on a damaged file. While the LMDB is written, the disk holds the arrays
twice.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Progress
from nvsim.files import atomic
from nvsim.files.atomic import as_input_error, make_own_folder, move_into_place, private_folder
from nvsim.r2r.features.backbone import Backbone, Float32, Width
from nvsim.r2r.features.candidates import candidates_of
from nvsim.r2r.features.exported_scan import ExportedScan, ViewSource
from nvsim.r2r.features.extraction import STAGE, compute_in_batches, prefetch_views, provenance
from nvsim.r2r.features.feature_files import description_path
from nvsim.r2r.features.kept_rows import KeptRows, kept_rows
from nvsim.r2r.features.layouts import Layout, missing_package_error

_LONGEST_KEY = 480  # bytes; LMDB allows 511


class GrowingLmdb:
    """Arrays by key, see `growing_lmdb`. Every call raises InputError if reading or writing fails."""

    def __init__(self, rows: KeptRows, target: Path, largest: int) -> None:
        self._rows, self._target, self._largest = rows, target, largest

    def contains(self, key: str, mark: bytes) -> bool:
        """Whether an array with this key and this fingerprint `mark` exists."""
        return self._rows.contains(key, mark)

    def store(self, key: str, mark: bytes, array: NDArray[np.float32]) -> None:
        """Stores an array of any shape, float32. Raises InputError if writing fails or the key is not short ASCII."""
        import msgpack

        _name(key)
        value = {b"data": array.tobytes(), b"type": array.dtype.str, b"shape": array.shape}
        self._rows.append(key, mark, msgpack.packb(value))

    def finish(self, wanted: set[str]) -> None:
        """Writes the LMDB with the arrays of the keys `wanted`. Raises InputError if writing fails."""
        import lmdb

        with private_folder(self._target) as folder:
            data = folder / "data.mdb"
            try:
                # Syncs the whole file once at the end, not after every transaction.
                with lmdb.open(str(folder), map_size=self._largest, max_dbs=0, sync=False) as environment:
                    for key in sorted(wanted, key=_name):
                        with environment.begin(write=True) as transaction:
                            transaction.put(_name(key), self._rows.get(key), append=True)
                move_into_place(data, make_own_folder(self._target) / data.name)
            except lmdb.Error as error:
                raise InputError(f"Cannot write {self._target}: {error}; free some space and start again.") from error
            except OSError as error:
                raise as_input_error(self._target, error) from error


def _name(key: str) -> bytes:
    name = key.encode("utf-8", "surrogateescape")
    if not name.isascii() or len(name) > _LONGEST_KEY:
        raise InputError(f"An LMDB cannot store the key {key[:60]!r}; use short ASCII ids for scans and viewpoints.")
    return name


@contextmanager
def growing_lmdb(target: Path, made_by: str, room: int, count: int) -> Iterator[GrowingLmdb]:
    """Opens an LMDB, which `GrowingLmdb.finish` writes to the folder `target`.

    made_by  identifies backbone and layout; arrays of an earlier run with another value are dropped
    room     bytes of all arrays together
    count    number of arrays

    Raises Held if another process is writing this file, InputError if reading or writing fails.
    """
    # Some pages are free or half empty. The file only grows as large as its content.
    largest = round(1.3 * room) + count * (1 << 15) + (1 << 26)
    with kept_rows(target, made_by) as rows:
        yield GrowingLmdb(rows, target, largest)


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
    about = provenance(layout, backbone, f"{rows}, {layout.width} numbers each: {fit.words}")
    about["order"] = "candidates of a viewpoint by their number in scanvp_candidates.json"
    places = [
        (f"{scan.id}_{scan.viewpoints[i]}", source, i, views)
        for scan, source in ((scan, ViewSource(scan)) for scan in scans)
        for i, views in enumerate(_views_of(scan))
    ]
    if not places:
        raise InputError("The scans have no included viewpoints, so no features can be computed.")
    marks = [source.fingerprint(i) + views.astype(np.uint8).tobytes() for _, source, i, views in places]
    numbers = layout.tokens * layout.width
    maker = hashlib.sha256(repr((backbone.digest, about)).encode()).hexdigest()
    room = 4 * numbers * sum(len(views) for *_, views in places)
    with growing_lmdb(target, maker, room, len(places)) as file:
        todo = [n for n, place in enumerate(places) if not file.contains(place[0], marks[n])]
        done = len(places) - len(todo)
        if done:
            listen(Log(f"{done} of {len(places)} viewpoints are already computed", STAGE))
        with contextlib.closing(prefetch_views([places[n][1:3] for n in todo], backbone)) as read:
            for n, (prepared, _) in zip(todo, read):
                key, _, _, views = places[n]
                array = np.empty((len(views), layout.tokens, layout.width), np.float32)
                array[:] = _tokens(backbone, fit, [prepared[view] for view in views])
                file.store(key, marks[n], array)
                done += 1
                listen(Progress(STAGE, done, len(places), key))
        file.finish({place[0] for place in places})
    atomic.write_text(description_path(target), json.dumps(about, indent=1) + "\n")
    words = f"{len(places)} viewpoints, {layout.tokens} times {layout.width} numbers per candidate"
    listen(Done(STAGE, words, {"written": [str(target)], "viewpoints": len(places), **about}))
    return [target, description_path(target)]


def _views_of(scan: ExportedScan) -> list[NDArray[np.int64]]:
    """Returns for every viewpoint (n,) the viewIndex of each candidate, in the order of the candidates' numbers."""
    found = candidates_of(scan.positions, scan.edges)
    return [found.view[found.source == i] for i in range(len(scan.viewpoints))]


def _tokens(backbone: Backbone, fit: Width, prepared: Sequence[NDArray[np.generic]]) -> Float32:
    """Returns (N, tokens or 1, width of the layout) of N prepared views."""
    if not prepared:
        return np.empty((0, 1, 1), np.float32)
    rows = compute_in_batches(backbone, prepared)[:, : backbone.tokens * backbone.width]
    fitted = fit(rows.reshape(-1, backbone.width))
    return fitted.reshape(len(prepared), backbone.tokens, -1)
