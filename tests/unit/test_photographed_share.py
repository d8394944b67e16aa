"""The photographed share of a viewpoint, on shells of Gaussians whose visible part is known in closed form, and its way
through the graph, the database, the findings, the exports and the evaluation."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from nvsim.capture.images import decode
from nvsim.evaluation.graph import evaluate_graph
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.directions import Sphere, cube
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.graph import edits
from nvsim.graph.exports.formats import write_geojson
from nvsim.graph.findings import Context, check_graph
from nvsim.graph.quantities import quantity
from nvsim.graph.store import decode_graph, encode_graph, viewpoint_of, viewpoint_row
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.views.photographed import SIDE, along_rays, photographed_directions, share_of_sphere, training_images
from nvsim.occupancy.types import OccupancyMap
from nvsim.project.photographed import with_shares
from nvsim.project.project import Project
from nvsim.r2r.observations.drawing import ScanModels, unseen_strip, write_unseen
from nvsim.r2r.observations.layout import ScanPlaces
from nvsim.r2r.observations.skybox import face_cameras
from nvsim.splats.types import Gaussians, SubmapModel

HERE = np.zeros(3)
RADIUS = 3.0
DEEP = FloorSurface.flat(-100.0)  # no ray of a shell reaches it


def model_of(points: NDArray[np.float64], size: NDArray[np.float64] | float, floor: FloorSurface = DEEP) -> SubmapModel:
    """Round, opaque, gray Gaussians at `points` (N, 3), of a standard deviation in meters."""
    n = len(points)
    scales = np.broadcast_to(np.log(size), n)[:, None].repeat(3, axis=1)
    quats = np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1))
    arrays = points.astype(np.float32), scales.astype(np.float32), quats, np.full(n, 6, np.float32)
    return SubmapModel(Gaussians(*arrays, np.zeros((n, 1, 3), np.float32)), None, None, floor)


def shell(count: int = 6000) -> NDArray[np.float64]:
    """(N, 3) points spread evenly on a sphere of 3 m around the origin."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, math.pi * (1 + math.sqrt(5)) * k
    flat = np.sqrt(1 - z**2)
    return RADIUS * np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


SHELL = model_of(shell(), 0.09)


def camera(at: NDArray[np.float64], degrees: float, heading: float = 0.0, elevation: float = 0.0) -> Camera:
    """A square camera of so many degrees; the heading and the elevation are in degrees too."""
    intrinsics = Intrinsics.from_fov(240, 240, math.radians(degrees))
    return Camera(intrinsics, camera_pose(at, math.radians(heading), math.radians(elevation)))


def share(model: SubmapModel, cameras: list[Camera], at: NDArray[np.float64] = HERE) -> float:
    return share_of_sphere(photographed_directions(model, at, training_images(model, cameras)))


@pytest.mark.parametrize("degrees", [40.0, 60.0, 90.0])
def test_one_camera_shows_the_solid_angle_of_its_image(degrees: float) -> None:
    exact = 4 * math.asin(math.sin(math.radians(degrees) / 2) ** 2) / (4 * math.pi)
    assert share(SHELL, [camera(HERE, degrees, 33.0, 10.0)]) == pytest.approx(exact, abs=0.01)


def test_the_shares_of_cameras_in_different_directions_add_up() -> None:
    turns = [camera(HERE, 90.0, heading) for heading in (0, 90, 180, 270)]
    assert share(SHELL, turns[:2]) == pytest.approx(2 / 6, abs=0.01)
    assert share(SHELL, turns) == pytest.approx(4 / 6, abs=0.01)
    whole = [*turns, camera(HERE, 90.0, 0, 90), camera(HERE, 90.0, 0, -90)]
    assert share(SHELL, whole) == pytest.approx(1.0, abs=0.005)
    assert share(SHELL, []) == 0.0


def test_a_viewpoint_away_from_the_camera_sees_the_same_surfaces() -> None:
    """The surfaces are points of the exact sphere inside an image of a camera in its middle."""
    half = [camera(HERE, 90.0, h, e) for h, e in ((-45, 0), (45, 0), (0, 45), (0, -45), (0, 0), (0, 90), (0, -90))]
    images = training_images(SHELL, half)
    at = np.array([0.0, -1.0, 0.0])
    rays = np.stack([c.rays() for c in cube(at, SIDE)]).astype(np.float64)
    along = rays @ at
    distance = -along + np.sqrt(along**2 - at @ at + RADIUS**2)  # to the shell
    points = at + distance[..., None] * rays
    expected = np.zeros(points.shape[:-1], bool)
    for one in half:
        pixels, depth = one.project(points)
        expected |= (depth > 0) & ((pixels > 0) & (pixels < 240)).all(axis=-1)
    found = photographed_directions(SHELL, at, images)
    assert abs(share_of_sphere(found) - share_of_sphere(expected)) < 0.01
    assert (found == expected).mean() > 0.97


def test_a_surface_behind_an_obstacle_is_not_photographed() -> None:
    across = np.arange(-0.5, 0.51, 0.06)
    panel = np.array([(x, 1.0, z) for x in across for z in across])
    model = model_of(np.concatenate([shell(), panel]), np.concatenate([np.full(6000, 0.09), np.full(len(panel), 0.04)]))
    images = training_images(model, [camera(HERE, 90.0)])
    behind = np.array([0.0, 1.8, 0.0])
    points = {"in the shadow": (0.0, 3.0, 0.0), "beside it": (1.9, 2.3, 0.0), "outside the image": (0.0, 0.5, 2.95)}
    rays = np.array([np.array(p) - behind for p in points.values()])
    assert along_rays(photographed_directions(model, behind, images), rays).tolist() == [False, True, False]
    without = photographed_directions(SHELL, behind, training_images(SHELL, [camera(HERE, 90.0)]))
    assert along_rays(without, rays).tolist() == [True, True, False]


def test_haze_before_the_surface_of_an_image_is_not_photographed() -> None:
    """The camera shows the shell through the place of the haze, which only the viewpoint's model has there."""
    haze = model_of(np.concatenate([shell(), [[0.0, 1.5, 0.0]]]), np.concatenate([np.full(6000, 0.09), [0.3]]))
    images = training_images(SHELL, [camera(HERE, 90.0)])
    ahead = np.array([[0.0, 1.0, 0.0]])
    assert along_rays(photographed_directions(SHELL, HERE, images), ahead).all()
    assert not along_rays(photographed_directions(haze, HERE, images), ahead).any()


def test_floor_without_gaussians_is_photographed_where_an_image_shows_it() -> None:
    model = model_of(np.empty((0, 3)), 0.1, FloorSurface.flat(-1.5))
    assert share(model, [camera(HERE, 90.0, 0, -90)]) == pytest.approx(1 / 6, abs=0.005)
    assert share(model, [camera(HERE, 90.0, 0, 90)]) == 0.0
    assert share(model, [camera(np.array([20.0, 0, 0]), 60.0, 0, -90)]) == 0.0


def test_without_images_dense_and_thin_gaussians_count() -> None:
    points = shell()
    upper = points[:, 2] > 0
    assert share_of_sphere(photographed_directions(SHELL, HERE, None)) == pytest.approx(1.0, abs=0.01)
    half = model_of(points[upper], 0.09)
    assert share_of_sphere(photographed_directions(half, HERE, None)) == pytest.approx(0.5, abs=0.03)
    hazy = model_of(points, np.where(upper, 0.09, 0.9))
    assert share_of_sphere(photographed_directions(hazy, HERE, None)) < 0.5


def test_faces_are_read_along_any_ray() -> None:
    axis = np.array([0.3, -0.8, 0.52])
    faces = np.stack([c.rays() for c in cube(HERE, SIDE)]) @ axis > 0
    assert share_of_sphere(faces) == pytest.approx(0.5, abs=1e-3)
    rays = Sphere(HERE, 128, 64, 0.7).rays()
    wrong = along_rays(faces, rays) != (rays @ axis > 0)
    assert np.abs(rays[wrong] @ axis).max(initial=0) < 2 / SIDE


@pytest.mark.parametrize("side", [SIDE, 96, 50])
def test_a_mask_has_the_arrangement_of_its_strip(side: int) -> None:
    axis = np.array([0.3, -0.8, 0.52])
    shown = np.stack([c.rays() for c in cube(HERE, SIDE)]) @ axis > 0
    strip = unseen_strip(shown, side)
    rays = np.concatenate([c.rays() for c in face_cameras(HERE, side)], axis=1)
    assert strip.shape == (side, 6 * side) and set(np.unique(strip)) == {0, 255}
    wrong = (strip == 0) != (rays @ axis > 0)
    assert np.abs(rays[wrong] @ axis).max(initial=0) < 4 / SIDE


class OneSided:
    """A model whose viewpoint a is photographed in all directions, and the others to the front only."""

    def nearest(self, position: NDArray[np.floating]) -> int:
        return 0

    def photographed_mask(self, position: NDArray[np.floating]) -> NDArray[np.bool_]:
        faces = np.ones((6, SIDE, SIDE), bool)
        if position[0] > 0:
            faces[[0, 2, 3, 4, 5]] = False  # the front is the second view of the cube
        return faces


def test_only_viewpoints_with_unseen_pixels_get_a_mask(tmp_path: Path) -> None:
    scene: Any = OneSided()
    source = ScanModels(scene, (), {}, scene)
    places = ScanPlaces(tmp_path, "house")
    assert write_unseen(source, GRAPH, places, 64) == [places.skyboxes.unseen("b"), places.skyboxes.unseen("c")]
    mask = decode(places.skyboxes.unseen("b"))[..., 0]
    assert mask.shape == (64, 6 * 64)
    assert not mask[:, 3 * 64 : 4 * 64].any() and mask[:, : 3 * 64].all() and mask[:, 4 * 64 :].all()


GRAPH = NavGraph(
    "house",
    {
        "a": Viewpoint("a", (0.0, 0.0, 1.5), photographed=0.9),
        "b": Viewpoint("b", (2.0, 0.0, 1.5), photographed=0.25),
        "c": Viewpoint("c", (4.0, 0.0, 1.5)),
    },
    {("a", "b"): edge("a", "b"), ("b", "c"): edge("b", "c")},
)


def test_shares_survive_files_and_the_database(tmp_path: Path) -> None:
    assert decode_graph(encode_graph(GRAPH)).viewpoints == GRAPH.viewpoints
    with Project.create_or_open(tmp_path / "p.nvsim") as project:
        project.set_graph(GRAPH)
    with Project.open(tmp_path / "p.nvsim") as project:
        assert dict(project.need_graph().viewpoints) == dict(GRAPH.viewpoints)


def test_a_viewpoint_without_a_share_is_stored_as_before() -> None:
    assert len(viewpoint_row(GRAPH.viewpoints["c"])) == 8
    for wrong in (1.5, -0.1, math.nan, "much"):
        with pytest.raises(ValueError, match="photographed share"):
            viewpoint_of([*viewpoint_row(GRAPH.viewpoints["a"])[:-1], wrong])


def test_hazy_viewpoints_are_reported_and_can_be_excluded() -> None:
    def keys(graph: NavGraph, least: float) -> set[str]:
        return {f.key for f in check_graph(graph, Context(photographed=least)) if f.kind == "photographed"}

    assert keys(GRAPH, MappingConfig.photographed) == {"photographed/b"}
    assert keys(GRAPH, 0.0) == set()
    assert keys(edits.set_included(GRAPH, ["b"], False), 0.6) == set()
    assert np.isnan(quantity(GRAPH, "photographed")[1]).tolist() == [False, False, True]


def test_a_moved_viewpoint_has_no_share_until_it_is_measured() -> None:
    moved = edits.move_viewpoints(GRAPH, {"a": (0.5, 0.0, 1.5)})
    assert moved.viewpoints["a"].photographed is None
    assert moved.viewpoints["b"].photographed == 0.25
    assert with_shares(moved, {"a": 0.5}).viewpoints["a"].photographed == 0.5


def test_geojson_names_the_share(tmp_path: Path) -> None:
    text = write_geojson(GRAPH, tmp_path / "g.geojson").read_text()
    assert text.count('"photographed"') == 2 and '"photographed":0.25' in text


def test_coverage_is_reported_with_and_without_hazy_viewpoints() -> None:
    floor = OccupancyMap(np.zeros((10, 60), np.uint8), 0.1, (-0.5, -0.5))
    walk = np.array([[0.0, 0.0], [4.0, 0.0]])
    found = evaluate_graph(GRAPH, floor, walk, coverage_range=1.0)
    assert found["hazy_viewpoints"] == 1
    assert found["coverage_without_hazy"] < found["coverage"]
    without = replace(GRAPH, viewpoints={id: replace(v, included=id != "b") for id, v in GRAPH.viewpoints.items()})
    assert found["coverage_without_hazy"] == evaluate_graph(without, floor, walk, coverage_range=1.0)["coverage"]
    unknown = replace(GRAPH, viewpoints={id: replace(v, photographed=None) for id, v in GRAPH.viewpoints.items()})
    assert "coverage_without_hazy" not in evaluate_graph(unknown, floor, walk)


def test_the_default_threshold_keeps_the_key_of_earlier_maps() -> None:
    assert "photographed" not in MappingConfig().key["MappingConfig"]
    assert MappingConfig(photographed=0.3).key != MappingConfig().key
