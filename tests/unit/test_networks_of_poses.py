"""Poses of a video with the user's networks: features that measure better than SIFT are used, and people are masked."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import textured_room as room
from feature_networks import extractor, matcher
from floor_networks import segformer

from nvsim.errors import InputError
from nvsim.footage.sources import need_footage
from nvsim.geometry.rotation import fitted_similarity
from nvsim.networks import installation
from nvsim.networks.folder import VARIABLE
from nvsim.poses import from_images
from nvsim.poses.feature_comparison import FeatureComparison
from nvsim.poses.from_images import features_of_all
from nvsim.poses.image_set import ImageSet, UnknownCamera
from nvsim.reconstruction import computing
from nvsim.reconstruction.computing import is_finished
from nvsim.reconstruction.image_sets import store_images
from nvsim.reconstruction.pose_networks import PoseNetworks
from nvsim.reconstruction.report import read_report, rows

PERSON = 12  # class of ADE20K
FRAMES = 48


def person_in(image: np.ndarray, frame: int) -> np.ndarray:
    """`image` with a person in front: a pattern of red, 60 pixels wide, that walks to the right."""
    found, left = image.copy(), 40 + 4 * frame
    pattern = np.random.default_rng(7).integers(0, 2, (18, 6), np.uint8).repeat(10, axis=0).repeat(10, axis=1)
    found[50:230, left : left + 60] = np.array([140, 0, 0]) + pattern[..., None] * np.array([115, 0, 0])
    return found


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("video") / "walk.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 12.0, (room.WIDTH, room.HEIGHT))
    for k, pose in enumerate(room.walk(400)[:FRAMES]):
        wall = (room.render(pose) * np.array([0.5, 1, 1])).astype(np.uint8)  # less red than the person
        writer.write(person_in(wall, k)[..., ::-1].copy())
    writer.release()
    return path


@pytest.fixture
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "models"))
    made = tmp_path / "made"
    made.mkdir()
    installation.add([extractor(made / "a.onnx"), matcher(made / "b.onnx")], "corners")
    installation.add([extractor(made / "c.onnx", seed=-1), matcher(made / "d.onnx")], "blind")
    installation.add([segformer(made / "e.onnx", red=PERSON)], "people")
    return tmp_path


def poses(video: Path, folder: Path, features: str = "", people: str = "") -> computing.PosesReport:
    networks = PoseNetworks(features, people)
    return computing.compute_poses(video, folder, lambda event: None, chosen=True, networks=networks)


def test_people_have_no_features_and_no_tracked_points(video: Path, models: Path) -> None:
    frames = models / "frames"
    shown = store_images(need_footage(video), frames, lambda *_: None, lambda event: None).images
    images, masked = PoseNetworks(people="people").without_people(shown, models / "masks", lambda *_: None)
    assert 10 < masked < 25

    def on_person(places: np.ndarray, index: int) -> np.ndarray:
        left = 40 + 4 * int(Path(shown.names[index]).stem.split("_")[1])
        return ((places > (left, 50)) & (places < (left + 60, 230))).all(axis=1)

    for index, own in enumerate(features_of_all(images, lambda *_: None)):
        assert len(own) > 15 and not on_person(own.places, index).any()
        tracked = images.tracks.places[images.tracks.frame == index]
        before = shown.tracks.places[shown.tracks.frame == index]
        assert not on_person(tracked, index).any() and on_person(before, index).any()
        assert len(tracked) > 0.4 * len(before)
    plain = features_of_all(shown, lambda *_: None)
    assert all(on_person(own.places, index).any() for index, own in enumerate(plain))
    points = images.tracks.point
    assert images.tracks.points == len(np.unique(points))  # numbers without gaps


def test_the_report_names_the_networks_and_the_figures_that_decided(video: Path, models: Path) -> None:
    folder = models / "out"
    report = poses(video, folder, "blind", "people")
    assert read_report(folder) == report
    assert [use[:2] for use in report.networks] == [("features", "blind"), ("people", "people")]
    assert report.compared is not None and not report.compared.is_network_used
    assert report.compared.matches[0] == 0
    assert rows(report)["Features"].startswith(f"SIFT is used: on {report.compared.pairs} pairs, blind has 0 verified")
    assert rows(report)["People"] == f"{report.masked:.1f} % of the pixels are masked, by people"
    footage = need_footage(video)
    assert is_finished(folder, footage) and is_finished(folder, footage, networks=PoseNetworks("blind", "people"))
    for other in (PoseNetworks("none"), PoseNetworks("corners"), PoseNetworks(people="none")):
        assert not is_finished(folder, footage, networks=other)


@pytest.mark.parametrize("name", ["corners", "nearest"])  # with a matcher, and with the nearest descriptors
def test_poses_from_the_features_of_a_network_are_those_of_the_camera(
    name: str, models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installation.add([extractor(models / "made" / "n.onnx")], "nearest")
    better = FeatureComparison(name, 4, (2.0, 1.0), (1.0, 1.0))
    monkeypatch.setattr(from_images, "compare_features", lambda *_: better)
    true, zeros = room.walk(60)[:24], np.zeros(24, np.int64)
    names = tuple(f"{k:02}.png" for k in range(len(true)))
    for file, pose in zip(names, true, strict=True):
        cv2.imwrite(str(models / file), room.render(pose)[..., ::-1])
    camera = UnknownCamera(room.WIDTH, room.HEIGHT)
    images = ImageSet(models, names, (camera,), zeros, zeros, np.zeros(0))
    (models / "work").mkdir()
    found = from_images.find_poses(images, models / "work", network=PoseNetworks(name).feature_network())
    assert found.compared is better
    placed = {int(Path(i.name).stem): i.projection_center() for i in found.model.images.values() if i.has_pose}
    assert len(placed) > 12  # SIFT places 19
    places, actual = np.array(list(placed.values())), true[list(placed), :3, 3]
    scale, rotation, shift = fitted_similarity(places, actual)
    off = np.linalg.norm(scale * places @ rotation.T + shift - actual, axis=1)
    assert np.median(off) < 0.04 * np.linalg.norm(np.ptp(actual, axis=0))


def test_a_network_that_cannot_be_used_is_one_sentence(video: Path, models: Path) -> None:
    installation.add([segformer(models / "made" / "f.onnx")], "floor-only")
    toml = models / "models" / "floor-only" / "model.toml"
    result = '\n[result]\nvalue = "logits"\nimage = "photo"\nmeaning = "logits"\nclasses = 150\nfloor = [3]\n'
    toml.write_text(toml.read_text() + result)
    with pytest.raises(InputError, match=r"^floor-only has no class of people, so it cannot mask them; use another"):
        poses(video, models / "out", people="floor-only")
    with pytest.raises(InputError, match="There is no model 'gone' for keypoints and their matches"):
        poses(video, models / "out", features="gone")
    with pytest.raises(
        InputError, match=r"no model 'gone' for masks of people in .*models \(installed: people\); add it"
    ):
        poses(video, models / "out", people="gone")
    with pytest.raises(InputError, match="corners is a model for keypoints and their matches, not for masks of people"):
        poses(video, models / "out", people="corners")
    with pytest.raises(InputError, match="people is a model for floor segmentation, not for keypoints"):
        poses(video, models / "out", features="people")
    assert not (models / "out").exists()
