"""Occupancy maps, and the floor grids that a project stores."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np

from fuzzing.places import workshop
from fuzzing.reader import Files, Reader, Seed, each, files_in
from nvsim.geometry.floor_surface import FloorSurface, StackedFloor
from nvsim.occupancy.read import read_map
from nvsim.occupancy.ros import Provenance, read_provenance, write_ros_map
from nvsim.occupancy.storeys import Stair, StoreyMap, StoreyMaps, read_storeys, write_storeys
from nvsim.occupancy.types import OccupancyMap
from nvsim.perception.stacked_support import StackedSupport, is_stacked
from nvsim.perception.support import FloorSupport
from nvsim.project.layout import Layout


def readers() -> list[Reader]:
    return [
        Reader("ros map", _ros, _read, share=2),
        Reader("octomap", _octomap, _read, share=2),
        Reader("floor surface", _surface, _project_surface),
        Reader("floor support", _support, _load_support),
        Reader("floor support of storeys", _stacked_support, _load_stacked_support),
        Reader("storeys", _storeys, _read_storeys),
    ]


def _read(path: Path) -> object:
    occupancy = read_map(path)
    return occupancy.room, occupancy.centers(), read_provenance(path)


def map_samples() -> Files:
    """A map as map.yaml and map.pgm."""
    with workshop() as folder:
        write_ros_map(OccupancyMap(_cells(), 0.05, (-1.0, 2.0)), folder / "map.yaml")
        return files_in(folder)


def _cells() -> np.ndarray:
    cells = np.ones((20, 30), np.uint8)
    cells[5:15, 5:25] = 0
    return cells


def _ros() -> list[Seed]:
    gray = map_samples()
    png = {
        "map.png": cv2.imencode(".png", _cells() * 100)[1].tobytes(),
        "map.yaml": gray["map.yaml"].replace(b"map.pgm", b"map.png").replace(b"mode: trinary", b"mode: scale"),
    }
    said = Provenance("lidar", "one scan", 0.1, 1.5, ("ab",)).line().encode()
    turned = {**gray, "map.yaml": said + b"\n" + gray["map.yaml"].replace(b"2.0, 0.0]", b"2.0, 0.7]")}
    return [
        *each(gray, "map.yaml", {"map.yaml": "text"}) * 2,
        *each(turned, "map.yaml", {"map.yaml": "text"}),
        *each(gray, "map.yaml", {"map.pgm": "picture"}),
        *each(png, "map.yaml", {"map.png": "picture"}),
    ]


def _octomap() -> list[Seed]:
    files = {"map.bt": _tree(), "map.ot": _full_tree()}
    return [Seed({name: data}, name, name, "headed") for name, data in files.items()]


def _tree() -> bytes:
    """A chain of inner nodes with one child each, and free and occupied leaves at its end."""
    inner, leaves = 3, 0b01_10_01_10_01_10_01_10
    nodes = [inner << (14 if depth == 0 else 0) for depth in range(15)]
    head = b"# Octomap OcTree binary file\nid OcTree\nsize 16\nres 0.05\ndata\n"
    return head + b"".join(node.to_bytes(2, "little") for node in [*nodes, leaves])


def _full_tree() -> bytes:
    """A full tree with log-odds: one child for each inner node, and eight leaves at the end."""
    head = b"# Octomap OcTree file\nid OcTree\nsize 24\nres 0.05\ndata\n"
    inner = [struct.pack("<fB", 0.8, 1 << (7 if depth == 0 else 0)) for depth in range(15)]
    leaves = [struct.pack("<fB", 0.8 if i % 2 else -0.4, 0) for i in range(8)]
    return head + b"".join([*inner, struct.pack("<fB", 0.8, 255), *leaves])


def _surface() -> list[Seed]:
    with workshop() as folder:
        path = Layout(folder).surface(0)
        path.parent.mkdir()
        heights = np.zeros((4, 5), np.float32)
        np.savez_compressed(path, heights=heights, origin=np.array([0.5, -0.5]), spacing=np.array(0.75))
        files = files_in(folder)
    return each(files, "", {next(iter(files)): "zip"})


def _project_surface(path: Path) -> object:
    return FloorSurface.load(Layout(path).surface(0)).height_at(np.zeros((2, 2)))


def _support() -> list[Seed]:
    with workshop() as folder:
        FloorSupport(np.eye(12, dtype=bool), (0.0, 1.0), 0.08).save(folder / "support.npz")
        files = files_in(folder)
    return each(files, "support.npz", {"support.npz": "zip"})


def _load_support(path: Path) -> object:
    return FloorSupport.load(path).is_supported(np.zeros((3, 2)))


def _stacked_floor() -> StackedFloor:
    return StackedFloor((FloorSurface.flat(0.0), FloorSurface.flat(3.0)))


def _stacked_support() -> list[Seed]:
    with workshop() as folder:
        storeys = tuple(FloorSupport(np.eye(n, dtype=bool), (0.0, 1.0), 0.08) for n in (12, 9))
        StackedSupport(_stacked_floor(), storeys).save(folder / "support.npz")
        files = files_in(folder)
    return each(files, "support.npz", {"support.npz": "zip"})


def _load_stacked_support(path: Path) -> object:
    return is_stacked(path), StackedSupport.load(path, _stacked_floor()).is_supported(np.zeros((3, 3)))


def _storeys() -> list[Seed]:
    with workshop() as folder:
        maps = tuple(StoreyMap(3.0 * k, OccupancyMap(_cells(), 0.05, (-1.0, 2.0))) for k in (0, 1))
        write_storeys(StoreyMaps(maps, (Stair(0, 1, ((0.0, 2.2), (0.4, 2.2), (0.4, 2.6))),)), folder)
        files = files_in(folder)
    return each(files, "storeys.json", {"storeys.json": "text"})


def _read_storeys(path: Path) -> object:
    maps = read_storeys(path)
    return maps.nearest(np.zeros(2)), maps.storey_under(np.ones(2)), [s.contains(np.zeros((2, 2))) for s in maps.stairs]
