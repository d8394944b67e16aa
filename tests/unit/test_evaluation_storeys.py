"""Graphs of buildings with several storeys: each viewpoint on its own map, and edges that climb."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from columns import fill, room
from octomap_samples import binary_tree

from nvsim.building import BuildingConfig
from nvsim.building.scene import make_scene
from nvsim.building.truth import true_occupancy
from nvsim.capture.types import Alignment
from nvsim.errors import InputError
from nvsim.evaluation.graph import evaluate_graph, judge
from nvsim.evaluation.picture import draw_graph
from nvsim.evaluation.truth import maps_in_aligned_frame, true_maps
from nvsim.evaluation.truth import true_occupancy as aligned_truth
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.occupancy.octomap import read_octomap
from nvsim.occupancy.storeys import Stair, StoreyMap, StoreyMaps, read_storeys, write_storeys
from nvsim.occupancy.types import OCCUPIED, UNKNOWN, Heights, OccupancyMap

EYE = 1.2
WALK = np.array([[1.0, 1.0, EYE], [11.0, 1.0, 3 + EYE]])


def two_storeys() -> StoreyMaps:
    """12 x 4 m, a stair along x from 4 to 8 between y = 0 and 1. Below the room beyond x = 8 is unknown, above that
    before x = 4; a wall stands along the stair on both floors, and a desk on the upper one."""
    below = fill(fill(room(12, 4), 8, 0, 12, 4, UNKNOWN), 4, 1, 8, 1.1, OCCUPIED)
    above = fill(fill(room(12, 4), 0, 0, 4, 4, UNKNOWN), 4, 1, 8, 1.1, OCCUPIED)
    stair = Stair(0, 1, ((4.0, 0.0), (8.0, 0.0), (8.0, 1.0), (4.0, 1.0)))
    return StoreyMaps((StoreyMap(0.0, below), StoreyMap(3.0, fill(above, 9, 2, 10, 3, OCCUPIED))), (stair,))


def graph(places: dict[str, tuple[float, float, float]], joined: str = "") -> NavGraph:
    """Viewpoints over the floor at x, y, z."""
    viewpoints = {id: Viewpoint(id, (x, y, z + EYE), EYE) for id, (x, y, z) in places.items()}
    return NavGraph("test", viewpoints, {e.key: e for e in (edge(*pair) for pair in joined.split())})


def test_a_viewpoint_is_judged_on_the_map_of_its_storey() -> None:
    places = {
        "a": (2, 2, 0.1),  # on the lower floor
        "b": (2, 2, 3.0),  # where there is no upper floor
        "c": (9.5, 2.5, 3.0),  # on the desk
        "d": (9.5, 2.5, 0.0),  # under it, where nobody was
        "e": (11, 2, 2.9),  # on the upper floor
        "f": (6, 0.5, 1.4),  # on the stair
        "g": (6, 2.5, 1.4),  # as high, beside the stair
        "h": (6, 2.5, 0.0),  # there on the lower floor
        "i": (6, 2.5, 3.0),  # and on the upper one
    }
    nodes, _ = judge(graph(places), two_storeys())
    assert {id for id, good in nodes.items() if good} == set("aefhi")


def test_an_edge_between_storeys_must_climb_a_stair() -> None:
    places = {
        "a": (3.5, 0.5, 0.0),
        "b": (5.5, 0.5, 1.1),
        "c": (6.5, 0.5, 1.9),
        "d": (8.5, 0.5, 3.0),
        "e": (6.0, 2.5, 0.0),
        "f": (6.0, 2.6, 3.0),
        "g": (6.5, 2.5, 3.0),
        "h": (3.5, 3.0, 0.0),
        "k": (8.5, 3.0, 3.0),
    }
    _, edges = judge(graph(places, "ab bc cd ad ef eg gc hk be fk"), two_storeys())
    good = {"".join(key) for key, runs in edges.items() if runs}
    # ef, eg go through the slab, hk does so beside the stair, be and cg through the wall along it.
    assert good == {"ab", "bc", "cd", "ad", "fk"}
    stairless = replace(two_storeys(), stairs=())
    _, edges = judge(graph(places, "ab bc ad"), stairless)
    assert {"".join(key) for key, runs in edges.items() if runs} == {"ab"}


def test_a_wide_robot_needs_room_on_both_storeys() -> None:
    places = {"a": (3.5, 0.5, 0.0), "d": (8.5, 0.5, 3.0)}
    assert judge(graph(places, "ad"), two_storeys(), 0.4)[1] == {("a", "d"): True}
    assert judge(graph(places, "ad"), two_storeys(), 0.6)[1] == {("a", "d"): False}


def test_coverage_is_that_of_all_storeys() -> None:
    maps = two_storeys()
    free = [float((s.occupancy.cells == 0).sum()) * s.occupancy.resolution**2 for s in maps.storeys]
    everywhere = {f"{k}{x}{y}": (x + 0.5, y + 0.5, 3.0 * k) for k in (0, 1) for x in range(12) for y in range(4)}
    both = evaluate_graph(graph(everywhere), maps, WALK)
    assert both["reachable_m2"] == pytest.approx(sum(free), abs=0.1) and both["coverage"] == pytest.approx(1, abs=0.01)
    beside = {id: p for id, p in everywhere.items() if not (4 < p[0] < 8 and p[1] < 1)}
    lower = evaluate_graph(graph({id: p for id, p in beside.items() if p[2] == 0}), maps, WALK)
    # From before the stair, at x = 3.5, its last 2 m are farther than the range.
    assert lower["coverage"] == pytest.approx((free[0] - 2.0) / sum(free), abs=0.01)
    on_stair = evaluate_graph(graph({"a": (6, 0.5, 1.0)}), maps, WALK)
    seen = evaluate_graph(graph({"a": (6, 0.5, 0.0)}), maps, WALK)
    assert on_stair["coverage"] == seen["coverage"] > 0, "who stands on a stair looks on both storeys"


def test_figures_name_the_edges_that_climb() -> None:
    places = {"a": (3.5, 0.5, 0.0), "d": (8.5, 0.5, 3.0), "e": (6.0, 2.5, 0.0), "f": (6.0, 2.6, 3.0), "g": (7, 2.6, 3)}
    figures = evaluate_graph(graph(places, "ad ef fg"), two_storeys(), WALK)
    assert (figures["storeys"], figures["stair_edges"], figures["edges"]) == (2, 2, 3)
    assert figures["stair_edge_validity"] == 0.5 and figures["edge_validity"] == pytest.approx(2 / 3, abs=1e-5)
    empty = evaluate_graph(NavGraph("test"), two_storeys(), WALK)
    assert (empty["nodes"], empty["stair_edges"], empty["coverage"]) == (0, 0, 0.0)


def test_the_walk_of_the_building_is_a_valid_graph_on_its_own_truth() -> None:
    scene = make_scene(BuildingConfig(seed=2, size="small", storeys=2))
    rows = scene.path[::60]
    walked = {f"{i:04d}": (x, y, z) for i, (x, y, _, z, _) in enumerate(rows)}
    ids = list(walked)
    along = NavGraph(
        "walk",
        graph(walked).viewpoints,
        {e.key: e for e in (edge(a, b) for a, b in zip(ids[:-1], ids[1:]) if walked[a] != walked[b])},
    )
    cameras = np.column_stack([rows[:, :2], rows[:, 3] + EYE])
    figures = evaluate_graph(along, true_occupancy(scene), cameras)
    assert figures["node_validity"] == figures["node_validity_robot"] == 1.0
    assert figures["edge_validity"] == figures["edge_validity_robot"] == 1.0
    assert figures["stair_edges"] == 2 and figures["coverage"] > 0.8
    flat = NavGraph("walk", {id: replace(v, height=v.position[2]) for id, v in along.viewpoints.items()}, along.edges)
    assert evaluate_graph(flat, true_occupancy(scene), cameras)["node_validity"] < 0.95, "as if all stood below"


def test_the_picture_lays_storeys_side_by_side(tmp_path: Path) -> None:
    places = {"a": (3.5, 0.5, 0.0), "d": (8.5, 0.5, 3.0), "c": (9.5, 2.5, 3.0)}
    path = draw_graph(graph(places, "ad"), two_storeys(), WALK, tmp_path / "g.png", 1600)
    picture = cv2.imread(str(path)).astype(int)[:-60]  # without the legend
    red = (picture[..., 2] > 150) & (picture[..., :2].max(axis=-1) < 80)
    green = (picture[..., 1] > 90) & (picture[..., 1] < 150) & (picture[..., 2] < 70) & (picture[..., 0] < 100)
    half = picture.shape[1] // 2
    assert picture.shape[1] > 1500 and not red[:, :half].any() and red[:, half:].any(), "the desk is above"
    assert green[:, :half].any() and green[:, half:].any(), "the edge is on both"


def test_storeys_are_read_as_they_were_written(tmp_path: Path) -> None:
    maps = two_storeys()
    path = write_storeys(maps, tmp_path)
    for named in (tmp_path, path):
        found = read_storeys(named)
        assert found.stairs == maps.stairs and [s.floor for s in found.storeys] == [0.0, 3.0]
        for a, b in zip(found.storeys, maps.storeys, strict=True):
            assert np.array_equal(a.occupancy.cells, b.occupancy.cells) and a.occupancy.origin == b.occupancy.origin


def test_one_octomap_is_cut_over_the_floor_of_each_storey(tmp_path: Path) -> None:
    (tmp_path / "house.bt").write_bytes(binary_tree())
    rows = [{"floor": floor, "map": "house.bt"} for floor in (-1.0, 0.25)]
    (tmp_path / "storeys.json").write_text(json.dumps({"storeys": rows}))
    heights = Heights(0.1, 0.9)
    for storey, row in zip(read_storeys(tmp_path, heights).storeys, rows, strict=True):
        expected = read_octomap(tmp_path / "house.bt", heights, row["floor"])  # type: ignore[arg-type]
        assert np.array_equal(storey.occupancy.cells, expected.cells)


def test_what_judges_by_one_map_refuses_several(tmp_path: Path) -> None:
    write_storeys(two_storeys(), tmp_path)
    project = SimpleNamespace(
        need_capture=lambda: SimpleNamespace(alignment=Alignment.identity()), layout=SimpleNamespace(root=tmp_path)
    )
    assert isinstance(true_maps(project, tmp_path, "aligned"), StoreyMaps)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="several storeys"):
        aligned_truth(project, tmp_path, "aligned")  # type: ignore[arg-type]


def test_coverage_of_what_was_seen_asks_for_floor_on_each_storey() -> None:
    maps = two_storeys()

    def upstairs(points: np.ndarray) -> np.ndarray:
        return points[..., 2] > 1.5

    everywhere = {f"{k}{x}{y}": (x + 0.5, y + 0.5, 3.0 * k) for k in (0, 1) for x in range(12) for y in range(4)}
    figures = evaluate_graph(graph(everywhere), maps, WALK, seen=upstairs)
    above = float((maps.storeys[1].occupancy.cells == 0).sum()) * 0.05**2
    assert figures["seen_m2"] == pytest.approx(above, abs=0.1) and figures["coverage_seen"] == pytest.approx(
        1, abs=0.01
    )
    lower = evaluate_graph(graph({"a": (2, 3, 0)}), maps, WALK, seen=upstairs)
    assert lower["coverage_seen"] == 0 and lower["coverage"] > 0


def test_a_wrong_list_of_storeys_is_refused_in_a_sentence(tmp_path: Path) -> None:
    good = json.loads(write_storeys(two_storeys(), tmp_path).read_text())
    storeys, (stair,) = good["storeys"], good["stairs"]
    wrong = [
        ([], "no list"),
        ({"storeys": []}, "names no storey"),
        ({"storeys": [{"map": "storey_0/map.yaml"}]}, "height of its 'floor'"),
        ({"storeys": [{"floor": True, "map": "storey_0/map.yaml"}]}, "height of its 'floor'"),
        ({"storeys": [{"floor": 10**400, "map": "storey_0/map.yaml"}]}, "height of its 'floor'"),
        ({"storeys": [{"floor": 0, "map": 3}]}, "name of its 'map'"),
        ({"storeys": [{"floor": 0, "map": "elsewhere.yaml"}]}, "elsewhere"),
        ({"storeys": storeys[::-1]}, "lowest storey first"),
        ({"storeys": storeys, "stairs": [{**stair, "to": 2}]}, "higher one"),
        ({"storeys": storeys, "stairs": [{**stair, "from": 1}]}, "higher one"),
        ({"storeys": storeys, "stairs": [{**stair, "outline": [[0, 0], [1, 1]]}]}, "three corners"),
        ({"storeys": storeys, "stairs": [{**stair, "outline": [[0, 0], [1, 1], [2]]}]}, "write \\[x, y\\]"),
        ({"storeys": storeys, "stairs": {}}, "list of at most"),
    ]
    for data, words in wrong:
        (tmp_path / "storeys.json").write_text(json.dumps(data))
        with pytest.raises(InputError, match=words):
            read_storeys(tmp_path)
    with pytest.raises(InputError, match="storeys.json"):
        read_storeys(tmp_path / "storey_0")


def test_maps_in_the_frame_of_the_capture_are_turned_with_their_stairs(tmp_path: Path) -> None:
    write_storeys(two_storeys(), tmp_path)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    capture = SimpleNamespace(alignment=Alignment(quarter, 2.0))
    found = maps_in_aligned_frame(tmp_path, capture, "capture")  # type: ignore[arg-type]
    assert isinstance(found, StoreyMaps) and [s.floor for s in found.storeys] == [0.0, 6.0]
    places = {"a": (3.5, 0.5, 0.0), "d": (8.5, 0.5, 3.0), "c": (9.5, 2.5, 3.0)}
    turned = {id: (-2 * y, 2 * x, 2 * z) for id, (x, y, z) in places.items()}
    nodes, edges = judge(graph(turned, "ad"), found)
    assert nodes == {"a": True, "d": True, "c": False} and edges == {("a", "d"): True}


def test_maps_in_far_coordinates_lose_the_origin_of_the_capture(tmp_path: Path) -> None:
    origin = np.array([356_000.0, 4_150_000.0, 100.0])
    maps = two_storeys()

    def far(found: OccupancyMap) -> OccupancyMap:
        return replace(found, origin=(found.origin[0] + origin[0], found.origin[1] + origin[1]))

    storeys = tuple(StoreyMap(s.floor + origin[2], far(s.occupancy)) for s in maps.storeys)
    stairs = tuple(replace(s, outline=tuple((x + origin[0], y + origin[1]) for x, y in s.outline)) for s in maps.stairs)
    write_storeys(StoreyMaps(storeys, stairs), tmp_path)
    capture = SimpleNamespace(alignment=Alignment(np.eye(3), origin=tuple(origin.tolist())))
    found = maps_in_aligned_frame(tmp_path, capture, "capture")  # type: ignore[arg-type]
    assert isinstance(found, StoreyMaps)
    for one, other in zip(found.storeys, maps.storeys, strict=True):
        assert one.floor == other.floor and one.occupancy.origin == pytest.approx(other.occupancy.origin, abs=1e-6)
    np.testing.assert_allclose([s.outline for s in found.stairs], [s.outline for s in maps.stairs], atol=1e-6)


@pytest.mark.parametrize("seed", [0, 1])
def test_an_outline_holds_what_opencv_says_it_holds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 9))
    corners = np.column_stack([np.cos(angle), np.sin(angle)]) * rng.uniform(0.5, 2, (9, 1))
    stair = Stair(0, 1, tuple((float(x), float(y)) for x, y in corners.astype(np.float32)))
    places = rng.uniform(-2, 2, (500, 2)).astype(np.float32)
    sides = [cv2.pointPolygonTest(corners.astype(np.float32), tuple(map(float, p)), False) > 0 for p in places]
    assert stair.contains(places).tolist() == sides and 50 < sum(sides) < 450
