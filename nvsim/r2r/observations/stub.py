"""The stub scan that VLN-DUET and Recurrent-VLN-BERT open by name to compute angles. They fail without it.

The stub is an empty room made by NVSim. It contains no Matterport data.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.files import atomic
from nvsim.geometry.directions import sweep
from nvsim.graph.connectivity import STUB, SUFFIX, list_scan, write_connectivity
from nvsim.graph.skybox_files import SkyboxFiles
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.r2r.observations.layout import ScanPlaces, jpeg, png
from nvsim.r2r.observations.skybox import as_bytes, as_units, face_cameras

SCAN = STUB
VIEWPOINT = "2f4d90acd4024c269fb0efe49a8ac540"
WHY = (
    f"The folder also has a stub scan, {SCAN}, an empty room: VLN-DUET and Recurrent-VLN-BERT open a scan of this name "
    "to compute angles; --no-stub skips it."
)
_ROOM = np.array([[-3.0, -2.5, 0.0], [3.0, 2.5, 2.7]])  # corners, meters
_EYE = (0.0, 0.0, 1.5)
_SHADES = np.array([0.72, 0.62, 0.52, 0.80])  # walls across x, walls across y, floor, ceiling
_SIZE = 512


def needs_stub(places: ScanPlaces) -> bool:
    """Whether the folder of `places` has no other scan with the name of the stub."""
    stub = ScanPlaces(places.root, SCAN)
    if stub.connectivity.exists():
        return False
    return not (stub.folder.exists() and any(p.name not in _NAMES for p in stub.folder.rglob("*") if p.is_file()))


def write_stub(places: ScanPlaces, views: bool) -> bool:
    """Writes the stub into the folder of `places`, with the 36 views if `views` is true.

    Returns False, and writes no images, if another scan with this name exists. Raises InputError if writing fails.
    """
    stub = ScanPlaces(places.root, SCAN)
    if not needs_stub(places):
        if stub.connectivity.exists():
            write_stub_graph(stub.graphs)
        return False
    cameras = face_cameras(np.array(_EYE), _SIZE)
    rooms = [_colors_along_rays(camera.rays().astype(np.float64)) for camera in cameras]
    strip, meters = (np.concatenate([room[i] for room in rooms], axis=1) for i in (0, 1))
    atomic.write_bytes(stub.skyboxes.strip(VIEWPOINT), jpeg(as_bytes(strip), 95, whole_chroma=True))
    atomic.write_bytes(stub.skyboxes.depth(VIEWPOINT), png(as_units(meters)))
    if views:
        for path, camera in zip(stub.view_paths(VIEWPOINT), sweep(np.array(_EYE)), strict=True):
            atomic.write_bytes(
                path, jpeg(as_bytes(_colors_along_rays(camera.rays().astype(np.float64))[0]), 95, whole_chroma=False)
            )
    write_stub_graph(stub.graphs)
    return True


def write_stub_graph(folder: Path) -> None:
    """Adds the connectivity of the stub to a folder of connectivity files. A file of that name is kept. Raises
    InputError if writing fails."""
    if (folder / f"{SCAN}{SUFFIX}").exists():
        list_scan(folder / "scans.txt", SCAN)
    else:
        write_connectivity(NavGraph(SCAN, {VIEWPOINT: Viewpoint(VIEWPOINT, _EYE)}, {}), folder)


def is_stub(graph: NavGraph) -> bool:
    """Whether a graph is the stub and not the scan of this name."""
    return graph.scan == SCAN and set(graph.viewpoints) == {VIEWPOINT}


_FILES = SkyboxFiles(Path())
_NAMES = {_FILES.strip(VIEWPOINT).name, _FILES.depth(VIEWPOINT).name}


def _colors_along_rays(rays: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns colors (..., 3) and meters (...) along unit rays (..., 3) from the eye to the walls of the room."""
    with np.errstate(divide="ignore"):
        ways = np.where(rays > 0, _ROOM[1] - _EYE, _ROOM[0] - _EYE) / rays
    ways = np.where(rays == 0, np.inf, ways)
    axis, meters = ways.argmin(axis=-1), ways.min(axis=-1)
    shade = _SHADES[np.where(axis == 2, 2 + (rays[..., 2] > 0), axis)]
    return np.repeat(shade[..., None], 3, axis=-1), meters
