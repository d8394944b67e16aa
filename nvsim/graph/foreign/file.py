"""An open connectivity file: its graph, its text, and the files near it."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError, value_text
from nvsim.files import atomic
from nvsim.files.opening import is_regular, parse_integer, read_bytes
from nvsim.files.placeholders import is_metadata_name
from nvsim.files.reading import reading
from nvsim.graph.connectivity import SUFFIX, list_scan, read_scans, scan_of
from nvsim.graph.edits import Visible
from nvsim.graph.findings import Context, Limits
from nvsim.graph.foreign.document import Document
from nvsim.graph.foreign.neighboring_files import FilesBeside, find_files_beside
from nvsim.graph.foreign.notes import keep_original, notes_path, read_notes, read_original, write_notes
from nvsim.graph.foreign.parsing import parse
from nvsim.graph.foreign.rewriting import edges_in, rewrite_document
from nvsim.graph.types import EdgeKey, NavGraph, edge
from nvsim.occupancy.types import OccupancyMap

_Stamp = tuple[int, int]


class ForeignFile:
    """A connectivity file that is edited in place.

    path     path of the file
    graph    as opened or last saved; marks and ignored findings come from the notes file
    one_way  edges that the file lists in one direction only; the graph contains them
    """

    def __init__(self, path: Path, document: Document, stamp: _Stamp | None) -> None:
        self.path = path
        self._document = document
        self._stamp = stamp
        keys, self.one_way = edges_in(document)
        edges = {key: edge(*key, "file") for key in keys}
        viewpoints = {e.viewpoint.id: e.viewpoint for e in document.entries}
        self.graph = read_notes(NavGraph(self.scan, viewpoints, edges), notes_path(path))
        self._kept = self.graph
        self._original = read_original(notes_path(path))
        self._taken = {id: v.position for id, v in viewpoints.items()}

    @staticmethod
    def open(path: Path) -> ForeignFile:
        """Open a file. Raises InputError, with the entry and the reason, if it cannot be read or does not define a
        graph."""
        path = Path(path)
        stamp = _stamp_of(path)
        with reading(path, "a connectivity file", "give an R2R connectivity file"):
            try:
                text = read_bytes(path).decode("utf-8")
            except UnicodeDecodeError as error:
                raise InputError(
                    f"{path} is not UTF-8 text (byte {error.start}); give an R2R connectivity file."
                ) from error
            return ForeignFile(path, parse(text, str(path)), stamp)

    @property
    def original(self) -> Path | None:
        """The copy of the file from the time before it was edited; None if there is none."""
        kept = None if self._original is None else self.path.with_name(self._original.name)
        return kept if kept is not None and kept.is_file() else None

    @property
    def scan(self) -> str:
        """The scan id, from the name of the file."""
        return scan_of(self.path)

    @cached_property
    def nearby_files(self) -> FilesBeside:
        """Images, map and cloud near the file."""
        return find_files_beside(self.path, self.scan)

    def visibility(self, unknown: bool = True) -> Visible | None:
        """Return the line of sight by the file's own lists: from positions (N, 3) to positions (N, 3), meters, world:
        (N,) bool. Two viewpoints see each other if either lists the other as `visible`.

        `unknown` is the result for viewpoints that were added or moved. Returns None if the lists contain only edges,
        as in the files of many exporters.
        """
        document = self._document
        if not document.has_visibility:
            return None

        row, seen = {e.viewpoint.position: i for i, e in enumerate(document.entries)}, document.flags["visible"]

        def visible(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
            i, j = (np.array([row.get((x, y, z), -1) for x, y, z in places.tolist()], np.int64) for places in (a, b))
            return np.where((i >= 0) & (j >= 0), seen[i, j] | seen[j, i], unknown)

        return visible

    def panorama(self, id: str, width: int) -> NDArray[np.uint8] | None:
        """Return the images near the file as a panorama of a viewpoint: (W / 2, W, 3) uint8, blue, green, red, north in
        the middle and east to its right. Returns None if there are no images. Raises InputError if an image cannot be
        read."""
        from nvsim.graph.foreign.neighboring_files import panorama

        entry = next((e for e in self._document.entries if e.viewpoint.id == id), None)
        pose = None if entry is None else entry.text("pose")
        if not isinstance(pose, str):
            return None
        return panorama(
            self.nearby_files,
            id,
            np.array(json.loads(pose, parse_int=parse_integer), float).reshape(4, 4)[:3, :3],
            width,
        )

    def context(
        self,
        limits: Limits | None = None,
        occupancy: OccupancyMap | None = None,
        against: Callable[[NavGraph, EdgeKey], str] | None = None,
    ) -> Context:
        """Return the context of findings about the graph: the images near the file, its one-way edges and faulty
        entries, and the arguments."""
        entries = {e.viewpoint.id: e.faults for e in self._document.entries if e.faults}
        return Context(
            limits or Limits(),
            occupancy,
            against,
            visible=self.visibility(),
            images=self.nearby_files.images,
            taken=self._taken,
            one_way=self.one_way,
            entries=entries,
        )

    def text(self, graph: NavGraph | None = None) -> str:
        """Return the text that `save` would write."""
        document = self._document if graph is None else rewrite_document(self._document, self._kept, graph)
        return "".join(document.pieces())

    def save(self, graph: NavGraph, path: Path | None = None) -> Path:
        """Write `graph` to the file, or to `path`, which then becomes the path of this object. Returns the written
        path.

        The content before the first save is kept in a copy, see `original`. Marks and ignored findings are written to a
        notes file, because the format cannot hold them. Raises InputError if writing fails, or if another program
        changed the file.
        """
        target = self.path if path is None else Path(path)
        own = _same_file(target, self.path)
        if own and self._stamp is not None and _stamp_of(target) not in (None, self._stamp):
            raise InputError(
                f"{target} was changed by another program since it was opened; open it again or save elsewhere."
            )
        document = rewrite_document(self._document, self._kept, graph)
        with atomic.replacement_file(target) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
            digest = hashlib.sha256()
            for piece in document.pieces():
                file.write(piece)
                digest.update(piece.encode())
            file.close()
            original = keep_original(target, self._original, digest.hexdigest()) if own else None
        self._original = original
        write_notes(graph, notes_path(target), original)
        if target.parent != self.path.parent and target.name.endswith(SUFFIX):
            # Programs do not load a scan that scans.txt does not list.
            list_scan(target.parent / "scans.txt", target.name.removesuffix(SUFFIX))
        self.path, self._document, self._stamp = target, document, _stamp_of(target)
        self.one_way = edges_in(document)[1]
        self.graph = self._kept = replace(graph, scan=graph.scan)
        return target


def connectivity_files(path: Path) -> list[Path]:
    """Return the connectivity files of `path`: the file itself, or the files of a folder that its scans.txt lists.
    Without a scans.txt, all files in the folder are returned.

    Raises InputError if a listed scan has no file, which aborts the simulator, or if there is no file at all.
    """
    path = Path(path)
    if not os.path.isdir(path):
        return [path]
    listed = path / "scans.txt"
    if not os.path.lexists(listed):
        with reading(path, "a folder of connectivity files", "check the folder"):
            os.listdir(path)  # raises an error if the folder cannot be listed; glob would find nothing
            found = sorted(p for p in path.glob(f"*{SUFFIX}") if not is_metadata_name(p.name))
        if not found:
            raise InputError(f"{path} holds no *{SUFFIX} and no scans.txt; give a connectivity file or its folder.")
        return found
    scans = read_scans(listed)
    files = [path / f"{scan}{SUFFIX}" for scan in scans]
    for scan, file in zip(scans, files):
        if not is_regular(file) or "/" in scan:
            named = value_text(scan)
            raise InputError(
                f"{listed} lists {named}, but there is no {named}{SUFFIX} beside it; remove the line or add the file."
            )
    if not files:
        raise InputError(f"{listed} lists no scan; give a connectivity file.")
    return files


def _same_file(one: Path, other: Path) -> bool:
    try:
        return one == other or one.samefile(other)
    except OSError:
        return False


def _stamp_of(path: Path) -> _Stamp | None:
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return status.st_mtime_ns, status.st_size
