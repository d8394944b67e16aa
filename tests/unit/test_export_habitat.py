"""A scene for Habitat: its surface is the true one, robots reach what they should, and its files name each other."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import boxed_scan
import numpy as np
import pytest
from boxed_scan import Block, export_blocks, flat_house
from numpy.typing import NDArray

from nvsim.cli.main import main
from nvsim.dataset.habitat import surface
from nvsim.dataset.habitat.scene import HEIGHT, _joined_obstacles, rectangles
from nvsim.events import ignore_event
from nvsim.graph.types import NavGraph
from nvsim.r2r.episodes.episode import scene_id

VOXEL = 0.05
Mesh = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]


def opened(path: Path) -> Mesh:
    """Vertices with z up, triangles, and colors of a GLB file, by the layout of the glTF specification."""
    data = path.read_bytes()
    assert data[:4] == b"glTF" and int.from_bytes(data[8:12], "little") == len(data)
    length = int.from_bytes(data[12:16], "little")
    root, body = json.loads(data[20 : 20 + length]), data[28 + length :]
    (one,) = root["meshes"][0]["primitives"]

    def read(i: int, kind: str, width: int) -> NDArray[Any]:
        accessor = root["accessors"][i]
        start = root["bufferViews"][accessor["bufferView"]]["byteOffset"]
        return np.frombuffer(body, kind, accessor["count"] * width, start).reshape(-1, width)

    places = read(one["attributes"]["POSITION"], "<f4", 3).astype(float)
    triangles = read(one["indices"], "<u4", 1).reshape(-1, 3).astype(np.int64)
    colors = read(one["attributes"]["COLOR_0"], "u1", 4)
    return np.stack([places[:, 0], -places[:, 2], places[:, 1]], 1), triangles, colors


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Block], NavGraph]:
    folder = tmp_path_factory.mktemp("habitat")
    blocks, graph = flat_house()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(boxed_scan, "SIDE", 128)
        scans = export_blocks(folder / "scans", blocks, graph)
    assert main(["export", "habitat", str(scans), "--out", str(folder / "scenes"), "--json"]) == 0
    return folder / "scenes", blocks, graph


def off_the_faces(blocks: list[Block], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Metres from places (N, 3) to the nearest side of a box."""
    found = []
    for block in blocks:
        lo, hi = np.array(block.lo), np.array(block.hi)
        outside = np.linalg.norm(np.maximum(np.maximum(lo - places, places - hi), 0), axis=1)
        within = np.minimum(places - lo, hi - places).min(axis=1)
        found.append(np.where(outside > 0, outside, within))
    return np.min(found, axis=0)


def test_the_surface_is_that_of_the_boxes(made: tuple[Path, list[Block], NavGraph]) -> None:
    folder, blocks, _ = made
    vertices, triangles, colors = opened(folder / scene_id("boxes"))
    off = off_the_faces(blocks, vertices)
    assert np.median(off) < 0.2 * VOXEL and np.quantile(off, 0.95) < VOXEL
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1) / 2
    room = (corners[..., 0] > 0.5).all(1) & (corners[..., 0] < 4).all(1) & (corners[..., 1] > 0.5).all(1)
    floor = room & (corners[..., 1] < 3.5).all(1) & (np.abs(corners[..., 2]) < 0.1).all(1)
    assert areas[floor].sum() == pytest.approx(3.5 * 3.0, rel=0.06)
    assert (normals[floor, 2] > 0).mean() > 0.99  # it faces the room, not the ground
    brown = colors[triangles[floor].ravel()][:, :3].mean(axis=0)
    assert brown == pytest.approx((140, 92, 55), abs=12)


def test_slabs_do_not_change_the_surface(
    made: tuple[Path, list[Block], NavGraph], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, _, graph = made
    whole, (columns,) = surface.fuse_surface(folder.parent / "scans", graph, 0.1, [(0.1, 1.5)], ignore_event)
    monkeypatch.setattr(surface, "_MOST", 100_000)
    parts, (other,) = surface.fuse_surface(folder.parent / "scans", graph, 0.1, [(0.1, 1.5)], ignore_event)
    assert len(parts.vertices) == len(whole.vertices) and len(parts.triangles) == len(whole.triangles)
    assert parts.vertices[np.lexsort(parts.vertices.T)] == pytest.approx(
        whole.vertices[np.lexsort(whole.vertices.T)], abs=1e-5
    )
    assert (columns.solid == other.solid).all()
    ends = np.sort(np.concatenate([parts.triangles[:, [0, 1]], parts.triangles[:, [1, 2]], parts.triangles[:, [2, 0]]]))
    _, uses = np.unique(ends, axis=0, return_counts=True)
    assert (uses == 1).mean() < 0.1  # no seams between slabs: few edges are borders


def standing(blocks: list[Block]) -> list[Block]:
    return [block for block in blocks if block.hi[2] > 0.1 and block.lo[2] < 1.5]


def found_and_true_floor(corners: NDArray[np.float64], blocks: list[Block]) -> tuple[NDArray[np.bool_], ...]:
    """The floor triangles (M, 3, 3), and the true free floor, on cells of 2.5 cm."""
    x, y = np.meshgrid(np.arange(0.0125, 15, 0.025), np.arange(0.0125, 5, 0.025))
    cells = np.stack([x, y], axis=-1)
    got = np.zeros(x.shape, bool)
    for one in corners:
        low, high = one.min(axis=0), one.max(axis=0)
        got |= ((cells >= low[:2]) & (cells < high[:2])).all(axis=-1)
    flat = cells.reshape(-1, 2)
    true = ~np.any([(block.meters_to(flat) == 0).reshape(x.shape) for block in standing(blocks)], axis=0)
    return got, true & ((x < 5.1) | (y < 1.6))


def test_robots_stand_where_the_true_floor_is_free(made: tuple[Path, list[Block], NavGraph]) -> None:
    folder, blocks, graph = made
    vertices, triangles, _ = opened(folder / "nvsim/boxes/boxes_collision.glb")
    corners = vertices[triangles]
    flat = np.ptp(corners[..., 2], axis=1) < 1e-6
    assert (np.cross(*(corners[flat][:, i] - corners[flat][:, 0] for i in (1, 2)))[:, 2] > 0).all()
    got, true = found_and_true_floor(corners[flat], blocks)
    assert (got & true).sum() / (got | true).sum() > 0.95
    for a, b in graph.edges:
        ends = [np.array(graph.viewpoints[id].position[:2]) for id in (a, b)]
        along = ends[0] + np.linspace(0, 1, 40)[:, None] * (ends[1] - ends[0])
        at = np.floor(along / 0.025).astype(int)
        assert got[at[:, 1], at[:, 0]].all(), (a, b)
    walls = corners[~flat]
    assert len(walls) and walls[..., 2].max() == pytest.approx(HEIGHT, abs=0.02)
    assert np.quantile(off_the_faces(standing(blocks), walls.reshape(-1, 3)), 0.9) < 0.12


def test_the_surface_adds_only_obstacles_that_the_cloud_lacks() -> None:
    scanned, fused = np.zeros((2, 20, 40), bool)
    scanned[:, 10] = True
    fused[:, 9:12] = True  # the same wall, too thick
    fused[4:8, 30:34] = True
    assert np.array_equal(
        np.argwhere(_joined_obstacles(scanned, fused, VOXEL).any(axis=0)).ravel(), [10, *range(30, 34)]
    )


def test_stairs_become_ramps() -> None:
    from nvsim.dataset.habitat.scene import collision_mesh
    from nvsim.graph.types import Viewpoint, edge

    viewpoints = {"a": Viewpoint("a", (0, 0, 1.5)), "b": Viewpoint("b", (0, 2, 2.5)), "c": Viewpoint("c", (0, 4, 3.5))}
    edges = {e.key: e for e in (edge("a", "b"), edge("b", "c"))}
    vertices, triangles = collision_mesh(NavGraph("stairs", viewpoints, edges), [], [])
    assert len(triangles) == 4
    for (a, b), quad in zip(pairwise("abc"), vertices.reshape(-1, 4, 3)):
        start, stop = (np.array(viewpoints[id].position) - (0, 0, 1.5) for id in (a, b))
        assert quad.mean(axis=0) == pytest.approx((start + stop) / 2)
        assert np.ptp(quad[:, 0]) == pytest.approx(0.8) and np.ptp(quad[:, 2]) == pytest.approx(1.0)
    normals = np.cross(*(vertices[triangles][:, i] - vertices[triangles][:, 0] for i in (1, 2)))
    assert (normals[:, 2] > 0).all() and math.isclose(np.linalg.norm(normals, axis=1).sum() / 2, 2 * 0.8 * math.sqrt(5))


def test_each_storey_has_its_floor(tmp_path: Path) -> None:
    """Two rooms above each other, joined by an edge through a shaft."""
    from nvsim.graph.types import Viewpoint, edge

    blocks = [Block((-0.2, -0.2, z), (6.2, 5.2, z + 0.2), (140, 92, 55)) for z in (-0.2, 2.6, 5.6)]
    blocks += [Block((-0.2, -0.2, 2.8), (6.2, 5.2, 3.0), (128, 128, 128))]
    for lo, hi in (
        ((-0.2, -0.2), (0, 5.2)),
        ((6, -0.2), (6.2, 5.2)),
        ((-0.2, -0.2), (6.2, 0)),
        ((-0.2, 5), (6.2, 5.2)),
    ):
        blocks.append(Block((*lo, 0), (*hi, 5.8), (225, 222, 215)))
    at = [(1.0, 1.0), (3.0, 1.0), (5.0, 1.0), (5.0, 3.0), (3.0, 3.5)]
    viewpoints = {
        f"{s}{i}": Viewpoint(f"{s}{i}", (x, y, z)) for s, z in (("l", 1.5), ("u", 4.5)) for i, (x, y) in enumerate(at)
    }
    pairs = [(f"{s}{i}", f"{s}{i + 1}") for s in "lu" for i in range(4)] + [("l4", "u4")]
    graph = NavGraph("tower", viewpoints, {e.key: e for e in (edge(*pair) for pair in pairs)})
    scans = export_blocks(tmp_path / "scans", blocks, graph)
    assert main(["export", "habitat", str(scans), "--out", str(tmp_path / "scenes"), "--voxel", "0.1", "--json"]) == 0
    vertices, triangles, _ = opened(tmp_path / "scenes/nvsim/tower/tower_collision.glb")
    corners = vertices[triangles]
    flat = np.ptp(corners[..., 2], axis=1) < 1e-6
    sides = corners[flat][:, 1:] - corners[flat][:, :1]
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
    for floor in (0.0, 3.0):
        here = np.abs(corners[flat][:, 0, 2] - floor) < 0.05
        assert areas[here].sum() == pytest.approx(6 * 5, rel=0.12)


def test_rectangles_cover_a_mask_once() -> None:
    mask = np.random.default_rng(0).random((40, 30)) < 0.7
    count = np.zeros(mask.shape, int)
    for top, bottom, left, right in rectangles(mask):
        count[top:bottom, left:right] += 1
    assert (count == mask).all()
    assert list(rectangles(np.ones((4, 5), bool))) == [(0, 4, 0, 5)]


def test_the_files_name_each_other(made: tuple[Path, list[Block], NavGraph]) -> None:
    folder = made[0]
    about = json.loads((folder / "nvsim/nvsim.scene_dataset_config.json").read_text())
    (pattern,) = about["stages"]["paths"][".json"]
    (stage,) = (folder / "nvsim").glob(pattern)
    content = json.loads(stage.read_text())
    assert stage.name == "boxes.stage_config.json" and content["up"] == [0, 1, 0] and content["front"] == [0, 0, -1]
    assert stage.parent / content["render_asset"] == folder / scene_id("boxes")
    assert (stage.parent / content["collision_asset"]).is_file()


def test_bad_input_is_refused_and_nothing_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from task_samples import exported, house

    scans, out = exported(tmp_path, house("one", 5)), tmp_path / "scenes"
    (tmp_path / "file").touch()
    assert main(["export", "habitat", str(scans), "--out", str(tmp_path / "file")]) == 2
    assert "not a folder" in capsys.readouterr().err
    assert main(["export", "habitat", str(scans), "--out", str(out)]) == 2
    assert "no strips with depth" in capsys.readouterr().err
    assert main(["export", "habitat", str(scans), "--out", str(out), "--voxel", "0"]) == 2
    assert "--voxel" in capsys.readouterr().err and not out.exists()
