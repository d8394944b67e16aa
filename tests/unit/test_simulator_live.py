"""Views drawn live from the models of a project, and places beside its graph, in a hall of known walls and desks."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from nvsim.benchmarks.map_builder import HALL, hall
from nvsim.capture.alignment import Alignment
from nvsim.capture.store import save_capture
from nvsim.capture.types import Capture, Frame
from nvsim.evaluation.scan import straight_view
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.lens import Lens
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.perception.support import FloorSupport
from nvsim.project.project import Project
from nvsim.r2r.simulator import Simulator
from nvsim.r2r.simulator.gym import WalkEnv
from nvsim.splats.files import save_model
from nvsim.splats.types import Gaussians, SubmapModel
from nvsim.submaps.split import Submap

PLACES = {"a": (1.5, 1.5, 1.3), "b": (1.5, 4.0, 1.3), "c": (4.5, 1.5, 1.3)}


def furnished() -> SubmapModel:
    """The hall, whose first desk has a top as well."""
    model = hall()
    x, y = np.meshgrid(np.arange(2.425, 3.6, 0.05), np.arange(2.625, 3.4, 0.05))
    flat, old = x.size, model.gaussians
    top = np.stack([x.ravel(), y.ravel(), np.full(flat, 0.75)], axis=1)
    level = np.tile([1.0, 0, 0, 0], (flat, 1))
    parts = (top, np.log(np.tile([0.03, 0.03, 0.004], (flat, 1))), level, np.full(flat, 4.0), np.zeros((flat, 1, 3)))
    names = ("means", "log_scales", "quats", "opacity_logits", "sh")
    joined = [np.concatenate([getattr(old, n), p]).astype(np.float32) for n, p in zip(names, parts, strict=True)]
    return replace(model, gaussians=Gaussians(*joined))


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("live") / "hall.nvsim"
    lens = Lens("PINHOLE", 64, 48, (40.0, 40.0, 32.0, 24.0))
    poses = [camera_pose(np.array([x, 1.5, 1.3]), 0.5) for x in np.linspace(1.5, 14.5, 6)]
    frames = tuple(Frame(f"f{i}.jpg", Path(f"/nowhere/f{i}.jpg"), lens, pose) for i, pose in enumerate(poses))
    capture = Capture(Path("/nowhere"), "nerfstudio", frames, None, Alignment.identity())
    with Project.create_or_open(root) as made:
        save_capture(capture, made.layout.imported)
        every = tuple(range(len(frames)))
        made.set_submaps((Submap(0, every, every, capture.positions),))
        viewpoints = {id: Viewpoint(id, place, 1.3) for id, place in PLACES.items()}
        made.set_graph(NavGraph("hall", viewpoints, {("a", "b"): edge("a", "b"), ("a", "c"): edge("a", "c")}))
        cells = np.ones((round(HALL[1] / 0.1), round(HALL[0] / 0.1)), bool)
        cells[:, 120:] = False  # nobody saw the floor beyond x = 12
        made.layout.support.parent.mkdir(parents=True, exist_ok=True)
        FloorSupport(cells, (0.0, 0.0), 0.1).save(made.layout.support)
        save_model(furnished(), made.layout.model(0))
    return root


def opened(project: Path, depth: bool = False) -> Simulator:
    sim = Simulator()
    sim.setDatasetPath(str(project))
    sim.setCameraResolution(96, 64)
    sim.setCameraVFOV(math.radians(60))
    sim.setRestrictedNavigation(False)
    sim.setDepthEnabled(depth)
    sim.newEpisode("hall", "a", 0.0, 0.0)
    return sim


def test_the_graph_and_the_views_are_the_projects(project: Path) -> None:
    sim = opened(project)
    assert {p.viewpointId for p in sim.getState().navigableLocations} == {"a", "b", "c"}
    sim.makeAction(1, 0.7, 0.2)
    state = sim.getState()
    assert state.location.viewpointId == "b"
    focal = 32 / math.tan(math.radians(30))
    camera = Camera(Intrinsics(96, 64, focal, focal, 48, 32), camera_pose(np.array(PLACES["b"]), 0.7, 0.2))
    rgb = straight_view(furnished(), camera)
    error = state.rgb[..., ::-1] / 255 - np.clip(rgb, 0, 1)
    assert np.abs(error).mean() < 0.02 and np.percentile(np.abs(error), 90) < 0.05


def test_depth_is_that_of_the_walls_and_of_the_floor_that_has_no_gaussians(project: Path) -> None:
    sim = opened(project, depth=True)
    sim.newEpisode("hall", "a", math.radians(-90), 0.0)  # to the wall at x = 0, 1.5 m away
    depth = sim.getState().depth[..., 0] / 4000
    assert depth[32, 48] == pytest.approx(1.5, abs=0.03)
    rays = Camera(Intrinsics(96, 64, 55.43, 55.43, 48, 32), camera_pose(np.zeros(3), math.radians(-90))).rays()
    to_wall, to_floor = 1.5 / -rays[..., 0], np.where(rays[..., 2] < -0.02, 1.3 / np.maximum(-rays[..., 2], 0.02), 99)
    expected = np.minimum(to_wall, to_floor) * -rays[..., 0]
    assert np.median(np.abs(depth - expected)) < 0.02
    sim.newEpisode("hall", "a", math.radians(-90), -0.9)
    assert (sim.getState().depth[40:] > 0).all()


def test_one_may_stand_on_free_floor_and_goes_back_to_the_graph(project: Path) -> None:
    sim = opened(project)
    sim.move_to(1.5, 2.5)
    state = sim.getState()
    assert (state.location.viewpointId, state.location.ix, state.step) == ("", -1, 1)
    assert state.location.point == pytest.approx([1.5, 2.5, 1.3])
    assert [p.viewpointId for p in state.navigableLocations][0] == ""
    assert {p.viewpointId for p in state.navigableLocations[1:]} == {"a", "b"}
    sim.makeAction(0, 0.3, 0.0)
    assert sim.getState().location.point == pytest.approx([1.5, 2.5, 1.3])
    there = [p.viewpointId for p in sim.getState().navigableLocations].index("b")
    sim.makeAction(there, 0.0, 0.0)
    assert sim.getState().location.viewpointId == "b"


@pytest.mark.parametrize(
    ("x", "y", "z", "straight", "words"),
    [
        (3.0, 3.0, None, False, "there is an obstacle"),  # a desk
        (3.0, 1.5, None, False, ""),
        (3.0, 4.5, None, True, "an obstacle is in the corridor"),  # behind the desk
        (3.0, 4.5, None, False, ""),
        (13.0, 1.5, None, False, "no image and no scan shows the floor there"),
        (2.0, 1.5, 5.0, False, "5.00 m above the floor"),
        (float("nan"), 0.0, None, False, "is not a position"),
    ],
)
def test_a_place_is_refused_with_its_reason(
    project: Path, x: float, y: float, z: float | None, straight: bool, words: str
) -> None:
    sim = opened(project)
    if not words:
        sim.move_to(x, y, z, straight=straight)
        assert sim.getState().location.point[:2] == pytest.approx([x, y])
        return
    with pytest.raises(ValueError, match=words):
        sim.move_to(x, y, z, straight=straight)
    assert sim.getState().location.viewpointId == "a"


def test_a_project_without_models_walks_its_graph_and_draws_nothing(tmp_path: Path) -> None:
    with Project.create_or_open(tmp_path / "bare.nvsim") as made:
        viewpoints = {id: Viewpoint(id, place, 1.3) for id, place in PLACES.items()}
        made.set_graph(NavGraph("bare", viewpoints, {("a", "b"): edge("a", "b")}))
    sim = Simulator()
    sim.setDatasetPath(tmp_path / "bare.nvsim")
    with pytest.raises(ValueError, match="nvsim train"):
        sim.initialize()
    sim.setRenderingEnabled(False)
    sim.newEpisode("bare", "a", 0, 0)
    assert [p.viewpointId for p in sim.getState().navigableLocations] == ["a", "b"]
    with pytest.raises(ValueError, match="no trained models"):
        sim.move_to(1.5, 2.5)
    with pytest.raises(IndexError, match="no 'other'"):
        sim.newEpisode("other", "a", 0, 0)


def test_the_walk_environment_keeps_gymnasiums_contract_and_stops_before_what_stands(project: Path) -> None:
    env = gymnasium.make("nvsim/Walk-v0", dataset=project, width=32, height=24, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check_env(env.unwrapped)
    walk = env.unwrapped
    assert isinstance(walk, WalkEnv)
    _, info = walk.reset(seed=0, options={"scan": "hall", "viewpoint": "b", "heading": 0.5 * math.pi, "goal": "c"})
    assert info["position"] == pytest.approx(PLACES["b"])
    for _ in range(4):  # to the left, away from the desk, and back over the same floor
        walk.step(np.int64(2))
    before = walk.state.location.point
    _, _, _, _, info = walk.step(np.int64(1))
    assert info["refused"] == "" and math.dist(walk.state.location.point, before) == pytest.approx(0.25)
    walk.reset(options={"scan": "hall", "viewpoint": "b", "heading": 0.75 * math.pi, "goal": "c"})
    ahead = [walk.step(np.int64(1))[4]["refused"] for _ in range(8)]
    assert ahead[0] == "" and ahead[-1], "the desk from x = 2.4, y = 3.4 on stands in the way"
    assert walk.state.location.x < 2.4
