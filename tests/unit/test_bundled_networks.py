"""The networks that come with NVSim: they are small, open, and know a building that they were not trained on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nvsim_resources
from nvsim.benchmarks.perception import measure
from nvsim.building.config import BuildingConfig
from nvsim.building.rendering import View, render
from nvsim.building.scene import Scene, make_scene, textures_of
from nvsim.building.truth import floor_mask, normals
from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.evaluation.normals import Angles
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.mapping.config import MappingConfig
from nvsim.networks.chain import Chain
from nvsim.networks.installed import bundled_model, bundled_models, find_model
from nvsim.networks.onnx_session import shared_file
from nvsim.perception.normals_network import NormalsNetwork, installed_normals
from nvsim.perception.semantic_network import SemanticNetwork
from nvsim.project.stages.mapped import check_normals

FOLDER = Path(nvsim_resources.__file__).parent / "models" / "bundled"
Seen = list[tuple[Camera, np.ndarray, View]]


@pytest.fixture(scope="module")
def building() -> tuple[Scene, Seen]:
    """The small built-in building, level and as the map builder looks at it."""
    scene = make_scene(BuildingConfig(size="small"))
    textures, seen = textures_of(scene), []
    for frame, elevation in ((2, 0.0), (9, 0.0), (16, -0.78), (25, 0.0), (33, -0.78), (40, 0.0)):
        x, y, heading, floor, _ = scene.walk[frame]
        pose = camera_pose(np.array([x, y, floor + 1.3]), heading, elevation)
        camera = Camera(Intrinsics.from_fov(320, 240, 1.4), pose)
        view = render(camera, scene.solids, textures, np.empty((0, 5)), np.empty((0, 3)))
        seen.append((camera, np.rint(np.clip(view.color, 0, 1) * 255).astype(np.uint8), view))
    return scene, seen


def test_they_are_small_and_hold_what_was_described(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setenv("NVSIM_MODELS", str(tmp_path))
    assert {m.name: m.role for m in bundled_models()} == {"bundled-floor": "semantic", "bundled-normals": "normals"}
    assert max(path.stat().st_size for path in FOLDER.glob("*.onnx")) <= 6e6
    assert (FOLDER / "card.md").is_file()
    assert main(["models", "check"]) == 0 and "bundled-normals: " in capsys.readouterr().out
    for role in ("semantic", "normals"):
        assert find_model(role, "bundled") == bundled_model(role)  # type: ignore[arg-type]
        assert find_model(role) is None, "it must be named where a user's own would be taken"  # type: ignore[arg-type]
    with pytest.raises(InputError, match="comes with NVSim"):
        find_model("prompted", "bundled")
    with pytest.raises(InputError, match="is a model for"):
        find_model("semantic", "bundled-normals")
    assert isinstance(installed_normals("bundled"), NormalsNetwork)


def test_a_users_model_cannot_take_their_name(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setenv("NVSIM_MODELS", str(tmp_path / "models"))
    copied = [str(FOLDER / "semantic.toml"), str(FOLDER / "floor.onnx")]
    assert main(["models", "add", *copied, "--name", "bundled-floor"]) == 2
    assert "choose another --name" in capsys.readouterr().err
    assert main(["models", "add", *copied, "--name", "mine"]) == 0
    assert find_model("semantic").name == "mine"  # type: ignore[union-attr]


def test_they_know_floor_and_normals_of_the_built_in_building(building: tuple[Scene, Seen]) -> None:
    scene, seen = building
    looks, faces = bundled_model("semantic"), bundled_model("normals")
    assert looks is not None and faces is not None
    floor, surface = SemanticNetwork(looks.open("cpu")), NormalsNetwork(faces.open("cpu"))
    both = either = 0
    angles = Angles()
    for camera, image, view in seen:
        found, true = floor.floor_probability(image, camera) > 0.5, floor_mask(scene, view)
        both, either = both + int((found & true).sum()), either + int((found | true).sum())
        angles.add(surface.normals(image, camera), normals(scene, view))
    figures = angles.figures()
    assert both / either > 0.85
    assert figures["normal_deg"] < 15 and figures["median_deg"] < 8, figures


def test_a_network_that_takes_rays_says_that_it_needs_a_camera() -> None:
    with pytest.raises(InputError, match="needs the camera"):
        installed_normals("bundled").camera_normals(np.zeros((48, 64, 3), np.uint8))


def test_a_map_of_panoramas_refuses_it() -> None:
    asked = MappingConfig(criteria=("alpha", "network-normal"), normals_model="bundled")
    check_normals(asked)
    with pytest.raises(InputError, match="cannot process panoramas"):
        check_normals(replace(asked, views="panorama"))


def test_the_measurement_says_what_an_image_costs() -> None:
    figures = measure(96, 64, 2, "bundled", "bundled")
    assert figures["size"] == "96x64" and 0 < figures["semantic_ms_cpu"] < 5000
    assert 0 < figures["ms_per_frame_cpu"] < 5000 and figures["ms_per_frame"] > 0 and figures["normals_ms"] > 0


def test_one_file_for_both_roles_runs_once_for_an_image(building: tuple[Scene, Seen]) -> None:
    looks, faces = (bundled_model(role).description for role in ("semantic", "normals"))  # type: ignore[union-attr,arg-type]
    assert looks is not None and faces is not None
    faces = replace(faces, files=looks.files, images=looks.images)  # the file of floor gives normals as well
    camera, image, _ = building[1][0]
    alone = SemanticNetwork(Chain(looks, FOLDER, "cpu")).floor_probability(image, camera)
    alone_normals = NormalsNetwork(Chain(faces, FOLDER, "cpu")).normals(image, camera)

    class Counted:
        runs = 0

        def __init__(self, session) -> None:
            self._session = session

        def run(self, names, feed):
            self.runs += 1
            return self._session.run(names, feed)

        def __getattr__(self, name):
            return getattr(self._session, name)

    path = FOLDER / "floor.onnx"
    shared = shared_file(path, ["CPUExecutionProvider"])
    shared.session = counted = Counted(shared.session)
    floor, surface = SemanticNetwork(Chain(looks, FOLDER, "cpu")), NormalsNetwork(Chain(faces, FOLDER, "cpu"))
    assert np.array_equal(floor.floor_probability(image, camera), alone)
    assert np.array_equal(surface.normals(image, camera), alone_normals)
    assert counted.runs == 1
    surface.normals(image[:, ::-1].copy(), camera)
    assert np.array_equal(floor.floor_probability(image, camera), alone) and counted.runs == 2
    del surface
    floor.floor_probability(image, camera)
    assert counted.runs == 3, "nobody else asks, so nothing is kept"
