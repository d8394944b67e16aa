"""Floor masks of a project: `auto` and its reasons, named models, and real networks with a known answer. An error names
the frame that caused it."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from described_models import described
from normal_networks import metric3d
from onnx_samples import save, value
from test_perception_prompted import decoder, encoder

from nvsim.capture.store import save_capture
from nvsim.capture.types import Alignment, Capture, Cloud, Frame
from nvsim.errors import InputError
from nvsim.events import Done, Event, Log, Warning
from nvsim.geometry.camera import camera_pose
from nvsim.geometry.lens import Lens
from nvsim.perception.failures import NAME, Failures, read_failures
from nvsim.perception.segment import read_mask
from nvsim.project import ledger, pipeline
from nvsim.project.config import CaptureConfig, FloorsConfig, RunConfig
from nvsim.project.floor_provider import choose
from nvsim.project.frame_candidates import CandidateMaker, read_candidates
from nvsim.project.project import Project
from nvsim.project.stages import floors
from nvsim.project.state.results import CONTENT
from nvsim.submaps.split import Submap

POSE = camera_pose(np.array([0.0, 0.0, 1.5]), 0.0, math.radians(-25))
WIDTH, HEIGHT = 160, 120


def color(world: tuple[float, float, float]) -> np.ndarray:
    """(3,) uint8: a normal of the world in the frame of the camera at POSE, as the color that stands for it."""
    return np.round((POSE[:3, :3].T @ np.array(world) + 1) / 2 * 255).astype(np.uint8)


FLOOR, WALL = color((0, 0, 1)), color((0, -1, 0))


def image(with_floor: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) a wall above floor, and where the floor is."""
    picture = np.tile(WALL, (HEIGHT, WIDTH, 1))
    floor = np.zeros((HEIGHT, WIDTH), bool)
    floor[70:] = with_floor
    picture[floor] = FLOOR
    return picture, floor


def looks(path: Path) -> Path:
    """A network of the semantic role: the logit is above 0 where a color is nearer to floor than to a wall."""
    weights, axis = np.zeros((1, 3, 1, 1), np.float32), (FLOOR.astype(float) - WALL) / 255
    weights[0, :, 0, 0] = 40 * axis
    middle = float(np.mean([FLOOR, WALL], axis=0) / 255 @ axis)
    nodes = [("Conv", ["image", "weights", "bias"], ["floor"])]
    constants = {"weights": weights, "bias": np.float32([-40 * middle])}
    return save(path, nodes, [value("image", 1, 3, "h", "w")], [value("floor", 1, 1, "h", "w")], constants)


LOOKS = """
role = "semantic"
title = "Looks"
[files]
network = { file = "looks.onnx" }
[images.photo]
resize = "stretch"
mean = [0, 0, 0]
std = [1, 1, 1]
[[steps]]
file = "network"
inputs = [{ value = "photo", name = "image" }]
outputs = [{ value = "logit", name = "floor" }]
[result]
value = "logit"
image = "photo"
meaning = "logits"
"""


@pytest.fixture
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "models"
    folder.mkdir()
    monkeypatch.setenv("NVSIM_MODELS", str(folder))
    return folder


def install(models: Path) -> None:
    (models / "looks").mkdir()
    looks(models / "looks" / "looks.onnx")
    (models / "looks" / "model.toml").write_text(LOOKS)
    (models / "facing").mkdir()
    described("metric3d-huggingface", metric3d(models / "facing" / "n.onnx"))
    encoder(models / "prompted.encoder.onnx")
    decoder(models / "prompted.decoder.onnx")


@pytest.fixture
def project(tmp_path: Path):
    """Four frames from one place, the third without floor; nothing but images."""
    lens = Lens("PINHOLE", WIDTH, HEIGHT, (100.0, 100.0, WIDTH / 2, HEIGHT / 2))
    frames = []
    for i in range(4):
        path = tmp_path / f"{i}.png"
        cv2.imwrite(str(path), image(i != 2)[0][..., ::-1])
        pose = POSE.copy()
        pose[:3, 3] += (0.2 * i, 0, 0)
        frames.append(Frame(f"{i}.png", path, lens, pose))
    capture = Capture(tmp_path, "nerfstudio", tuple(frames), None, Alignment.identity())
    with Project.create_or_open(tmp_path / "house.nvsim") as opened:
        save_capture(capture, opened.layout.imported)
        every = tuple(range(4))
        opened.set_submaps((Submap(0, every, every, capture.positions),))
        for stage in ("import", "submaps"):
            ledger.begin_part(opened, stage, stage)
            ledger.finish(opened, stage, 0.0, {}, settings='{"camera_height": 1.5, "hold_out": 0}')
        yield opened


def test_the_hybrid_finds_the_floor_and_says_which_frame_has_none(models: Path, project: Project) -> None:
    install(models)
    heard: list[Event] = []
    floors.run(project, heard.append, config=FloorsConfig("hybrid"))
    for index in range(4):
        found, floor = read_mask(project.mask_path(index)), image(index != 2)[1]
        assert (found ^ floor).mean() < 0.03
    assert read_failures(project.layout.masks) == {2: "no-looks"}
    said = [event.text for event in heard if isinstance(event, Log)]
    assert any("semantic by looks, normals by facing, prompted by prompted" in text for text in said)
    warned = [event.text for event in heard if isinstance(event, Warning)]
    assert any("In 1 of 4 frames nothing looks like floor" in text for text in warned)
    (done,) = [event for event in heard if isinstance(event, Done)]
    record = ledger.record(project, "floors")
    assert record is not None and record.summary["provider"] == "hybrid" and record.summary["semantic"] == "looks"
    assert record.summary["failures"] == {"no-looks": 1}
    assert record.summary == {**done.results, CONTENT: ledger.content_key(project)}
    steps = read_candidates(CandidateMaker(project).make(2))
    assert steps is not None and steps.failure == "no-looks" and not steps.semantic.any()
    steps = read_candidates(CandidateMaker(project).make(1))
    assert steps is not None and steps.failure == "" and (steps.semantic ^ image()[1]).mean() < 0.02


def test_another_model_makes_the_masks_anew_and_the_same_does_not(models: Path, project: Project) -> None:
    install(models)
    hybrid = FloorsConfig("hybrid")
    floors.run(project, lambda _: None, config=hybrid)
    key = floors.floors_key(project)
    heard: list[Event] = []
    floors.run(project, heard.append, config=hybrid)
    assert floors.floors_key(project) == key and "up to date" in heard[0].text  # type: ignore[attr-defined]
    floors.run(project, lambda _: None, config=FloorsConfig("hybrid", prompted="geometry"))
    assert floors.floors_key(project) != key
    (models / "looks" / "model.toml").write_text(LOOKS.replace('"Looks"', '"Other looks"'))
    floors.run(project, heard.append, config=hybrid)
    assert floors.floors_key(project) != key


def test_geometry_alone_has_the_key_of_before_there_was_a_choice(models: Path, project: Project) -> None:
    floors.run(project, lambda _: None)
    before = floors.floors_key(project)
    install(models)
    floors.run(project, lambda _: None, config=FloorsConfig("geometry"))
    assert floors.floors_key(project) == before and not (project.layout.masks / NAME).exists()


def dense() -> Cloud:
    x, y = np.meshgrid(np.linspace(-3, 3, 120), np.linspace(-3, 3, 120))
    return Cloud(np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]).astype(np.float32))


def of_images() -> Cloud:
    return replace(dense(), kind="images")


def test_auto_takes_the_bundled_network_beside_a_scan_and_the_depth_of_images(models: Path) -> None:
    auto = FloorsConfig()
    found = choose(auto, dense)
    assert found.method == "fused" and found.models["semantic"].name == "bundled-floor"
    assert choose(FloorsConfig(semantic="geometry"), dense).method == "geometry"
    assert choose(FloorsConfig("fused"), dense).summary == {"provider": "fused", "semantic": "bundled-floor"}
    images = choose(auto, of_images)
    assert images.summary == {"provider": "fused", "semantic": "bundled-floor", "normals": "bundled-normals"}
    assert "normals by bundled-normals where the images give no depth" in images.description
    assert images.key() != found.key() and choose(FloorsConfig("fused"), of_images).key() == images.key()
    named = choose(FloorsConfig("hybrid", semantic="bundled", normals="bundled"), dense)
    assert named.summary == {
        "provider": "hybrid", "semantic": "bundled-floor", "normals": "bundled-normals", "prompted": "geometry",
    }  # fmt: skip
    install(models)
    assert choose(auto, dense).models["semantic"].name == "looks", "the user's own comes first"


def test_auto_fuses_where_a_scan_is_and_asks_networks_alone_where_none_is_and_says_why(models: Path) -> None:
    auto = FloorsConfig()
    assert choose(auto, lambda: None).description == "by geometry (no semantic network is installed)"
    install(models)
    found = choose(auto, dense)
    assert found.description == (
        "by geometry, with looks where geometry leaves the floor undecided "
        "(a LiDAR scan or depth shows obstacles on the floor)"
    )
    assert found.summary == {"provider": "fused", "semantic": "looks"}
    found = choose(auto, lambda: None)
    assert found.method == "hybrid" and "(only networks can show" in found.description
    assert choose(FloorsConfig(semantic="geometry"), dense).method == "geometry"
    assert choose(FloorsConfig(prompted="prompted"), dense).method == "hybrid", "only the hybrid asks it"
    played = choose(FloorsConfig("hybrid", normals="geometry"), dense)
    assert "normals by geometry (the cloud)" in played.description and "semantic" in played.models
    keys = [choose(FloorsConfig(how), dense).key() for how in ("geometry", "fused", "hybrid")]
    assert keys[0] == [] and keys[1] != keys[2] != played.key()
    (models / "prompted.decoder.onnx").unlink()
    assert choose(auto, dense).method == "fused", "half a model that is not asked harms nobody"


def test_fused_masks_are_those_of_geometry_where_the_network_sees_floor_too(models: Path, project: Project) -> None:
    install(models)
    capture = project.need_capture()
    save_capture(replace(capture, cloud=dense()), project.layout.imported)
    with Project.open(project.layout.root) as again:
        assert again.scan() is not None
    masks = {}
    for how in ("geometry", "fused"):
        heard: list[Event] = []
        floors.run(project, heard.append, config=FloorsConfig(how))  # type: ignore[arg-type]
        masks[how] = [read_mask(project.mask_path(i)) for i in range(4)]
    record = ledger.record(project, "floors")
    assert record is not None and record.summary["provider"] == "fused"
    for i, (a, b) in enumerate(zip(masks["geometry"], masks["fused"], strict=True)):
        floor = cv2.erode(image(i != 2)[1].astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
        assert not (a & ~b & floor).any(), "nothing is taken away"
        assert not (b & ~floor)[:60].any(), "a wall that the scan lacks is none"


@pytest.mark.parametrize(
    ("config", "sentence"),
    [
        (
            FloorsConfig("geometry", semantic="looks"),
            "geometry does not use --semantic looks; leave it out, or use --provider",
        ),
        (FloorsConfig("fused", normals="facing"), "fused does not use --normals facing; leave it out"),
        (FloorsConfig("fused", semantic="geometry"), "No semantic network is installed to be fused"),
        (FloorsConfig("hybrid", semantic="evf-sam"), "no model 'evf-sam' for floor segmentation .*installed: looks"),
        (
            FloorsConfig("hybrid", semantic="facing"),
            "facing is a model for surface normals, not for floor segmentation",
        ),
    ],
)
def test_names_that_mean_nothing_are_refused(models: Path, config: FloorsConfig, sentence: str) -> None:
    install(models)
    with pytest.raises(InputError, match=sentence):
        choose(config, lambda: None)


def test_the_main_job_refuses_a_name_that_means_nothing_before_it_makes_anything(models: Path, tmp_path: Path) -> None:
    config = RunConfig(floors=FloorsConfig("hybrid", prompted="sam3"))
    with (
        Project.create_or_open(tmp_path / "p.nvsim") as project,
        pytest.raises(InputError, match="no model 'sam3' for segmentation at points .*installed: none"),
    ):
        pipeline.run(project, tmp_path / "nowhere", CaptureConfig(), config, lambda _: None)


def test_a_network_that_is_broken_is_refused_before_the_masks_in_use_are_replaced(
    models: Path, project: Project
) -> None:
    floors.run(project, lambda _: None)
    before = project.mask_path(1).read_bytes()
    install(models)
    (models / "facing" / "n.onnx").write_bytes(b"broken")
    with pytest.raises(InputError, match="cannot be loaded"):
        floors.run(project, lambda _: None, config=FloorsConfig("hybrid"))
    assert project.mask_path(1).read_bytes() == before


def test_failures_are_kept_over_an_interruption_and_what_makes_no_sense_is_left_out(tmp_path: Path) -> None:
    Failures(tmp_path).add(3, "beyond")
    Failures(tmp_path).add(5, "short")
    found = Failures(tmp_path)
    assert found.of_frames == {3: "beyond", 5: "short"}
    found.remove_frames([3, 4])
    assert read_failures(tmp_path) == {5: "short"}
    (tmp_path / NAME).write_text(json.dumps({"1": "short", "2": "late", "x": "short", "-3": "short", "4": 5}))
    assert read_failures(tmp_path) == {1: "short"}
    (tmp_path / NAME).write_text("[")
    assert read_failures(tmp_path) == {}
