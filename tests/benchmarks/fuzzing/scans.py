"""Exported scans, as NVSim checks them, continues them, and reads them for the simulator, agents, and tasks."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from fuzzing.graphs import row
from fuzzing.places import workshop
from fuzzing.reader import Files, Reader, Seed, each, files_in
from nvsim.evaluation.scan_files import ScanFiles, scans_in
from nvsim.graph.connectivity import read_connectivity, write_connectivity
from nvsim.r2r.features.exported_scan import read_exported_scans
from nvsim.r2r.observations.layout import ScanPlaces
from nvsim.r2r.observations.record import FORMAT, ScanRecord, part_on_disk
from nvsim.r2r.observations.skybox import visible_from
from nvsim.r2r.simulator.images import read_colors, read_distances
from nvsim.r2r.simulator.scan import read_scan
from nvsim.r2r.surroundings.visibility import has_depth, views_from_viewpoints

_SCAN, _SIDE = "row", 32


def readers() -> list[Reader]:
    return [
        Reader("exported scan", _whole, _problems, share=2),
        Reader("journal of an export", _unfinished, _finished),
        Reader("list of exported scans", _connectivity, _exported),
        Reader("simulator scan", _one_scan, _simulated, share=2),
        Reader("simulator skybox", _strips, _colors),
        Reader("skybox of a viewpoint", _strips, _seen),
    ]


@cache
def _files() -> Files:
    """An export of six viewpoints with color and depth strips, and a manifest that lists every file."""
    ramp = np.add.outer(np.arange(_SIDE), np.arange(6 * _SIDE)).astype(np.uint8)
    strip = cv2.imencode(".jpg", np.dstack([ramp] * 3))[1].tobytes()
    depth = cv2.imencode(".png", np.full((_SIDE, 6 * _SIDE), 8000, np.uint16))[1].tobytes()
    with workshop() as folder:
        graph, places = row(), ScanPlaces(folder, _SCAN)
        write_connectivity(graph, places.graphs)
        places.images.mkdir(parents=True)
        parts = {}
        for id in graph.viewpoints:
            for path, data in ((places.skyboxes.strip(id), strip), (places.skyboxes.depth(id), depth)):
                path.write_bytes(data)
            parts[id] = part_on_disk(folder, (places.skyboxes.strip(id), places.skyboxes.depth(id)), "key").as_data()
        parts["graph"] = part_on_disk(folder, (places.connectivity,), "key").as_data()
        about = {"format": FORMAT, "settings": {"size": _SIDE, "quality": 95, "views": False, "faces": False}}
        places.manifest.write_text(json.dumps({**about, "parts": parts}))
        return files_in(folder)


def _places(path: Path):
    return ScanPlaces(path, _SCAN)


def _first(end: str) -> str:
    return next(name for name in _files() if name.endswith(end))


def _whole() -> list[Seed]:
    forms = {f"{_SCAN}/manifest.json": "json", f"connectivity/{_SCAN}_connectivity.json": "json"}
    return each(_files(), "", {**forms, _first("_small.jpg"): "picture", _first("_depth_small.png"): "picture"})


def _problems(path: Path) -> object:
    """Checks scans as `nvsim evaluate scan` does."""
    return [ScanFiles(places).problems() for places in scans_in(path)]


def _unfinished() -> list[Seed]:
    """The journal of a killed export."""
    files = dict(_files())
    parts = json.loads(files.pop(f"{_SCAN}/manifest.json"))["parts"]
    lines = "".join(json.dumps({"part": name, **part}) + "\n" for name, part in parts.items())
    journal = f"{_SCAN}/.unfinished.jsonl"
    return each({**files, journal: lines.encode()}, "", {journal: "lines of json"})


def _finished(path: Path) -> object:
    record = ScanRecord(_places(path), only_look=True)
    return [record.finished(name, "key") for name in record.parts]


def _connectivity() -> list[Seed]:
    forms = {f"connectivity/{_SCAN}_connectivity.json": "json", "connectivity/scans.txt": "text"}
    return each(_files(), "", forms)


def _exported(path: Path) -> object:
    return [(scan.edges, scan.has_images) for scan in read_exported_scans(path)]


def _one_scan() -> list[Seed]:
    name = f"connectivity/{_SCAN}_connectivity.json"
    return each({name: _files()[name]}, name, {name: "json"})


def _simulated(path: Path) -> object:
    scan = read_scan(path, _SCAN)
    return scan.index_of, scan.starts


def _strips() -> list[Seed]:
    return each(
        _files(), "", {_first("v1_skybox_small.jpg"): "picture", _first("v1_skybox_depth_small.png"): "picture"}
    )


def _colors(path: Path) -> object:
    images = _places(path).images
    return read_colors(images, "v1").shape, read_distances(images, "v1").shape


def _seen(path: Path) -> object:
    """Reads the surroundings of viewpoints as the generation of tasks does."""
    places = _places(path)
    graph = read_connectivity(places.connectivity)
    near = list(graph.viewpoints.values())
    found = visible_from(places, near[1], near)
    return found, has_depth(places, graph), [seen.points.shape for seen in views_from_viewpoints(path, graph)]
