"""Check that all files of an exported scan exist, match the manifest, and have the right sizes."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import decode
from nvsim.errors import InputError, shown
from nvsim.files.opening import is_regular, read_bytes
from nvsim.geometry.directions import HEIGHT, WIDTH
from nvsim.graph.connectivity import SUFFIX, cut_off, read_connectivity, read_scans
from nvsim.graph.types import NavGraph
from nvsim.r2r.observations.export import GRAPH, PLANS, UNSEEN
from nvsim.r2r.observations.layout import ScanPlaces
from nvsim.r2r.observations.record import Part, part_of, read_manifest
from nvsim.r2r.observations.skybox import read_depth


class ScanFiles:
    """An exported scan on disk, and its defects.

    settings   settings of the export
    graph      content of the connectivity file
    """

    def __init__(self, places: ScanPlaces) -> None:
        """Raises InputError if there is no finished export, or its manifest or connectivity file cannot be read."""
        if places.journal.exists():
            raise InputError(f"The export of {places.folder} is not finished; run the same `nvsim export scan` again.")
        manifest = read_manifest(places.manifest)
        if not manifest:
            raise InputError(f"{places.folder} has no manifest.json; name the folder of `nvsim export scan`.")
        self.places = places
        self.settings: dict[str, Any] = manifest.get("settings", {})
        try:
            self.parts: dict[str, Part] = {name: part_of(data) for name, data in manifest["parts"].items()}
            self.size, self.quality = int(self.settings["size"]), int(self.settings["quality"])
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise InputError(f"{places.manifest} is damaged; export the scan again.") from error
        self.graph: NavGraph = read_connectivity(places.connectivity)

    @property
    def viewpoints(self) -> list[str]:
        """Ids of the exported viewpoints."""
        return [name for name in self.parts if name not in (GRAPH, PLANS, UNSEEN)]

    def problems(self) -> list[str]:
        """One sentence per defect."""
        found = []
        listed = self.places.scans
        names = read_scans(listed) if listed.is_file() else []
        cut = cut_off(listed) if names else None
        if cut is not None:
            found.append(f"The last line of {listed}, {shown(cut)}, is incomplete; run `nvsim export scan` again.")
        for name in names:
            if name != cut and not is_regular(self.places.graphs / f"{name}{SUFFIX}"):
                found.append(f"{listed} lists {shown(name)} without its connectivity file, so simulators stop there.")
        if self.places.scan not in names:
            found.append(f"{listed} does not list {self.places.scan}; run `nvsim export scan` again.")
        drawn = set(self.viewpoints)
        for v in self.graph.viewpoints.values():
            if v.included and v.id not in drawn:
                found.append(f"Viewpoint {v.id} is in the graph but has no images.")
        for part in self.parts.values():
            found += filter(None, (self._wrong(name, *known) for name, known in part.files.items()))
        return found + [problem for id in self.viewpoints for problem in self._unreadable(id)]

    def strip(self, viewpoint: str) -> NDArray[np.uint8]:
        """(S, 6 S, 3) uint8, the strip of a viewpoint. Raises InputError if it has another size or cannot be read."""
        return decode(self.places.strip(viewpoint), (6 * self.size, self.size))

    def _wrong(self, name: str, size: int, digest: str) -> str | None:
        path = self.places.root / name
        try:
            data = read_bytes(path)
        except InputError as error:
            return str(error)
        if len(data) != size or hashlib.sha256(data).hexdigest() != digest:
            return f"{path} does not match the manifest."
        return None

    def _unreadable(self, id: str) -> list[str]:
        def strip() -> None:
            self.strip(id)

        def depth() -> None:
            if read_depth(self.places, id).shape[0] != self.size:
                raise InputError(f"{self.places.depth(id)} has faces of another size than {self.size}.")

        def views() -> None:
            for path in self.places.sweep(id) if self.settings.get("views") else ():
                decode(path, (WIDTH, HEIGHT))

        def faces() -> None:
            for path in self.places.faces(id) if self.settings.get("faces") else ():
                decode(path, (self.size, self.size))

        found = []
        for read in (strip, depth, views, faces):
            try:
                read()
            except InputError as error:
                found.append(str(error))
        return found


def scans_in(root: Path) -> list[ScanPlaces]:
    """The scans in an export folder that NVSim wrote. Raises InputError if there are none."""
    manifests = sorted(root.glob("*/manifest.json")) + sorted(root.glob("*/.unfinished.jsonl"))
    names = list(dict.fromkeys(path.parent.name for path in manifests))
    if not names:
        raise InputError(f"{root} contains no scan that NVSim wrote; name the folder of `nvsim export scan`.")
    return [ScanPlaces(root, name) for name in names]
