"""Every described form of a network that finds and matches keypoints, and the choice between it and SIFT."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import textured_room as room
from described_models import described
from feature_networks import DIM, extractor, matcher

from nvsim.networks.installed import signature_of
from nvsim.networks.known_forms import matching_forms
from nvsim.perception.feature_network import FeatureNetwork
from nvsim.poses.feature_comparison import FeatureComparison, compare_features
from nvsim.poses.features import Features, find_features, match_features
from nvsim.poses.image_pairs import image_descriptors
from nvsim.poses.image_set import ImageSet, UnknownCamera

COLMAP, EXPORTED = "aliked-lightglue-colmap", "lightglue-onnx"


def image(width: int = 300, height: int = 210) -> np.ndarray:
    """Noise of blobs that are about 8 pixels large. Both sides are no multiples of 32."""
    noise = np.random.default_rng(0).random((height // 8, width // 8, 3)) * 200 + 30
    return cv2.resize(noise.astype(np.uint8), (width, height), interpolation=cv2.INTER_CUBIC)


def network(folder: Path, of_colmap: bool = True, by_keypoints: bool = False, seed: int = 1) -> FeatureNetwork:
    files = (
        extractor(folder / "extractor.onnx", of_colmap, seed),
        matcher(folder / "matcher.onnx", of_colmap, by_keypoints),
    )
    return FeatureNetwork(described(COLMAP if of_colmap else EXPORTED, *files), "toy")


@pytest.mark.parametrize("of_colmap", [True, False])
def test_the_forms_are_known_by_their_signatures(tmp_path: Path, of_colmap: bool) -> None:
    files = {
        p: signature_of(p) for p in (matcher(tmp_path / "a.onnx", of_colmap), extractor(tmp_path / "b.onnx", of_colmap))
    }
    found = matching_forms(files)
    assert [name for name, _ in found] == [COLMAP if of_colmap else EXPORTED]
    assert found[0][1]["extractor"].name == "b.onnx"
    alone = {p: s for p, s in files.items() if p.name == "b.onnx"}
    assert [name for name, _ in matching_forms(alone)] == ["aliked"]


@pytest.mark.parametrize("of_colmap", [True, False])
def test_keypoints_of_padded_images_are_pixels_of_the_image(tmp_path: Path, of_colmap: bool) -> None:
    """Both conventions of keypoints give the peaks that a slow search finds, with (0.5, 0.5) in the first pixel."""
    own = image()
    found = network(tmp_path, of_colmap).find(own, 500)
    gray = own.astype(np.float64).mean(axis=2) / 255
    blurred = [cv2.GaussianBlur(gray, (17, 17), s, borderType=cv2.BORDER_CONSTANT) for s in (1.5, 2.5)]
    strength = np.abs(blurred[0] - blurred[1])
    assert 100 < len(found) <= 500
    for x, y in np.floor(found.places).astype(int):
        assert strength[y, x] >= strength[y - 2 : y + 3, x - 2 : x + 3].max() - 1e-6
    assert np.allclose(found.places % 1, 0.5, atol=1e-3)
    assert np.all((found.places > 4) & (found.places < np.array([296, 206])))  # not beside the padding
    assert np.allclose(np.linalg.norm(found.descriptors.astype(np.float32), axis=1), 1, atol=2e-3)


def test_features_are_only_on_usable_pixels(tmp_path: Path) -> None:
    usable = np.zeros((210, 300), bool)
    usable[:, 150:] = True
    found = network(tmp_path).find(image(), 500, usable)
    assert len(found) > 50 and found.places[:, 0].min() > 154


@pytest.mark.parametrize("of_colmap", [True, False])
@pytest.mark.parametrize("by_keypoints", [True, False])
def test_a_matcher_gets_keypoints_in_its_convention(tmp_path: Path, of_colmap: bool, by_keypoints: bool) -> None:
    """By keypoints, COLMAP's form matches equal pixels, and the other form equal places over half the longer side."""
    both = network(tmp_path, of_colmap, by_keypoints)
    one = both.find(image(), 200)
    shuffled = one.select(np.random.default_rng(1).permutation(len(one)))
    other = Features(shuffled.places * 2, shuffled.descriptors, shuffled.matcher, (600, 420))
    if by_keypoints and of_colmap:
        other = Features(shuffled.places, shuffled.descriptors, shuffled.matcher, (600, 420))
    pairs = match_features(one, other)
    assert len(pairs) > (0.9 if by_keypoints else 1) * len(one) - 1
    assert np.allclose(one.places[pairs[:, 0]], shuffled.places[pairs[:, 1]])


def test_without_a_matcher_nearest_descriptors_match_and_images_have_descriptors(tmp_path: Path) -> None:
    alone = FeatureNetwork(described("aliked", extractor(tmp_path / "extractor.onnx")), "toy")
    own = image()
    one, other = alone.find(own, 300), alone.find(np.roll(own, 6, axis=1), 300)
    pairs = match_features(one, other)
    moved = other.places[pairs[:, 1]] - one.places[pairs[:, 0]]
    assert len(pairs) > 100 and np.mean(np.abs(moved - (6, 0)).max(axis=1) < 0.1) > 0.95
    assert one.descriptors.shape == (len(one), DIM)
    others = [alone.find(np.roll(own, k, axis=0), 300) for k in (0, 3, 90)]
    words = image_descriptors([*others, Features(np.zeros((0, 2)), np.zeros((0, 128), np.uint8))])
    assert words.shape[0] == 4 and words[0] @ words[1] > words[0] @ words[2]


def test_the_better_features_are_used() -> None:
    assert FeatureComparison("n", 30, (50, 40), (0.9, 0.9)).is_network_used
    assert not FeatureComparison("n", 30, (40, 40), (0.9, 0.9)).is_network_used
    assert not FeatureComparison("n", 30, (90, 40), (0.8, 0.9)).is_network_used


def test_the_comparison_counts_matches_that_agree_with_a_relative_pose(tmp_path: Path) -> None:
    """Descriptors that tell nothing lose against SIFT. SIFT of three features per image loses against the network."""
    images = [room.render(pose) for pose in room.walk(400)[:24]]
    for k, own in enumerate(images):
        cv2.imwrite(str(tmp_path / f"{k}.jpg"), own[..., ::-1])
    names, none = tuple(f"{k}.jpg" for k in range(24)), np.zeros(24, np.int64)
    camera = UnknownCamera(room.WIDTH, room.HEIGHT, room.FOCAL)
    shown = ImageSet(tmp_path, names, (camera,), none, none, np.arange(24.0))
    sift = [find_features(own, 1000, contrast=0.005) for own in images]
    good, bad = network(tmp_path), network(tmp_path, seed=-1)
    lost = compare_features(shown, sift, bad, lambda i: bad.find(images[i], 1000))
    assert lost.verified[0] < 0.5 < lost.verified[1] and not lost.is_network_used
    won = compare_features(shown, [f.most_distinct(3) for f in sift], good, lambda i: good.find(images[i], 1000))
    assert won.verified[1] == 0 < won.verified[0] and won.matches[0] > 20 and won.is_network_used
