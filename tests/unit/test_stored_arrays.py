"""Arrays that a project stores: damaged or foreign files are refused with a sentence, whatever their header says."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_capture_fuzz import mutations, survives
from test_capture_hostile import memory_for, png, refusal

from nvsim.geometry.cells import MOST_CELLS, grid_size
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.mapping.search.trajectory import Walk
from nvsim.occupancy.read import read_map
from nvsim.perception.floor_height import estimate_floor
from nvsim.perception.segment import read_mask
from nvsim.perception.support import FloorSupport, observe
from nvsim.project.frame_candidates import read_candidates

GOOD = {"origin": np.zeros(2), "spacing": np.array(0.5)}
SURFACE = GOOD | {"heights": np.zeros((3, 4), np.float32)}
SUPPORT = GOOD | {"cells": np.ones((3, 4), bool)}


def stored(**arrays: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.savez_compressed(out, **arrays)
    return out.getvalue()


def announcing(name: str, shape: str, descr: str, others: dict[str, np.ndarray]) -> bytes:
    """An .npz with an array that is announced and not there."""
    out = io.BytesIO(stored(**others))
    header = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    with zipfile.ZipFile(out, "a") as archive:
        archive.writestr(f"{name}.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode())
    return out.getvalue()


def broken(name: str, good: dict[str, np.ndarray]) -> dict[str, Callable[[], bytes]]:
    """Functions that make damaged files. Some take a second to pack."""
    rest = {k: v for k, v in good.items() if k != name}

    def packed(**other: np.ndarray) -> Callable[[], bytes]:
        return lambda: stored(**(rest | other))

    return {
        "nothing": lambda: b"",
        "no archive": lambda: b"hello",
        "half": lambda: stored(**good)[:200],
        "an array missing": packed(),
        "objects": packed(**{name: np.array([[{}]], object)}),
        "words": packed(**{name: np.array([["a"]])}),
        "another shape": packed(**{name: np.zeros(5)}),
        "nothing in it": packed(**{name: np.zeros((0, 3), good[name].dtype)}),
        "a bomb": lambda: stored(**(rest | {name: np.zeros((9000, 10_000), good[name].dtype)})),
        "10^18 announced": lambda: announcing(name, "(1000000000, 1000000000)", "<f4", rest),
        "less than nothing announced": lambda: announcing(name, "(-1, 5)", "<f4", rest),
        "a spacing of 0": packed(**(good | {"spacing": np.array(0.0)})),
        "an origin that is no number": packed(**(good | {"origin": np.array([np.nan, 0])})),
    }


SURFACES, SUPPORTS = broken("heights", SURFACE), broken("cells", SUPPORT)


@pytest.mark.parametrize("kind", SURFACES)
def test_a_damaged_floor_surface_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "surface_000.npz"
    path.write_bytes(SURFACES[kind]())
    assert "nvsim floors" in refusal(lambda: FloorSurface.load(path))


@pytest.mark.parametrize("kind", SUPPORTS)
def test_a_damaged_observe_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "support.npz"
    path.write_bytes(SUPPORTS[kind]())
    assert "nvsim floors" in refusal(lambda: FloorSupport.load(path))


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_any_damage_to_a_floor_surface_is_a_surface_or_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.getbasetemp() / "surface.npz"
    path.write_bytes(mutations(data, stored(**SURFACE)))
    survives(lambda: FloorSurface.load(path))
    assert read_candidates(path) is None


@pytest.mark.parametrize("load", [FloorSurface.load, FloorSupport.load, read_mask, read_map])
def test_a_pipe_in_the_place_of_a_stored_file_is_not_waited_for(tmp_path: Path, load: Callable[[Path], object]) -> None:
    path = tmp_path / "map.yaml"
    os.mkfifo(path)
    refusal(lambda: load(path))


def test_a_floor_mask_that_is_a_bomb_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "000000.png"
    path.write_bytes(png(14_000, 14_000, b"\0" * 10_000_000))
    assert "nvsim floors" in refusal(lambda: read_mask(path))


def ros(folder: Path, picture: bytes, **lines: str) -> Path:
    (folder / "map.pgm").write_bytes(picture)
    values = {"image": "map.pgm", "resolution": "0.05", "origin": "[0, 0, 0]"} | lines
    (folder / "map.yaml").write_text("".join(f"{k}: {v}\n" for k, v in values.items()))
    return folder / "map.yaml"


@pytest.mark.parametrize(
    ("picture", "lines"),
    [
        (b"P5 20 1000000000 255\n", {}),
        (b"P5 40000 40000 255\n" + b"\0" * 200, {}),
        (png(30_000, 30_000), {}),
        (b"P5 1 1 255\n\0", {"image": "ma\0p.pgm"}),
        (b"P5 1 1 255\n\0", {"image": "/dev/zero"}),
        (b"P5 1 1 255\n\0", {"image": "."}),
        (b"P5 1 1 255\n\0", {"resolution": "1e-320"}),
        (b"P5 1 1 255\n\0", {"resolution": "-0.05"}),
        (b"P5 1 1 255\n\0", {"resolution": "nan"}),
        (b"P5 1 1 255\n\0", {"origin": "[1e308, 0, 0]"}),
        (b"P5 1 1 255\n\0", {"origin": "[nan, 0, 0]"}),
        (b"P5 1 1 255\n\0", {"origin": "&a [*a, *a]"}),
        (b"Pf 1 1 -1\n\0\0\0\0", {}),
        (b"", {}),
    ],
)
def test_a_ros_map_that_makes_no_sense_is_refused(tmp_path: Path, picture: bytes, lines: dict[str, str]) -> None:
    assert "map." in refusal(lambda: read_map(ros(tmp_path, picture, **lines)))


@pytest.mark.parametrize("resolution", [b"0", b"-1", b"nan", b"inf", b"1e-320", b"1e300", b"x"])
def test_an_octomap_without_a_resolution_that_can_be_is_refused(tmp_path: Path, resolution: bytes) -> None:
    path = tmp_path / "a.bt"
    path.write_bytes(b"# Octomap OcTree binary file\nid OcTree\nsize 9\nres " + resolution + b"\ndata\n\x01\x40")
    assert "res" in refusal(lambda: read_map(path))


def test_every_grid_over_the_ground_has_an_end() -> None:
    far = np.array([[0.0, 0.0, 1.0], [9e6, 3e6, 1.0]])
    surface = FloorSurface.flat(0.0)
    with memory_for(300):
        for make in (
            lambda: grid_size(far[0], far[1], 0.1, "the cameras"),
            lambda: grid_size(far[0], np.array([np.nan, 1.0]), 0.1, "the cameras"),
            lambda: Walk(far, lambda xy: np.ones(xy.shape[:-1], bool)),
            lambda: FloorSupport(np.ones((3, 3), bool), (0.0, 0.0), 0.1).with_trajectory_floor(far),
            lambda: estimate_floor(None, far, 1.2),
            lambda: observe(_Camera.both(far), [], surface, None),
        ):
            assert "--leave-out" in refusal(make)
    assert np.prod(grid_size(np.zeros(2), np.array([400.0, 600.0]), 0.1, "the cameras")) <= MOST_CELLS


class _Camera:
    def __init__(self, position: np.ndarray) -> None:
        self.position = position

    @staticmethod
    def both(positions: np.ndarray) -> list[_Camera]:
        return [_Camera(p) for p in positions]
