"""Every described form of a network that knows floor by its looks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from described_models import described
from floor_networks import FLOOR, RUG, mmseg, segformer

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.networks.installed import signature_of
from nvsim.networks.known_forms import matching_forms
from nvsim.perception.semantic_network import SemanticNetwork

CAMERA = Camera(Intrinsics.from_fov(150, 90, 1.2), camera_pose(np.zeros(3), 0.0))


def image(color: tuple[int, int, int], beside: tuple[int, int, int] = (0, 0, 0)) -> np.ndarray:
    """(90, 150, 3), the lower right of one color, the rest of another."""
    found = np.tile(np.array(beside, np.uint8), (90, 150, 1))
    found[40:, 60:] = color
    return found


def chance(color: tuple[int, int, int]) -> float:
    """By hand: the softmax of 150 logits, of floor and rug together."""
    ours = np.exp(FLOOR * color[0] / 255) + np.exp(RUG * color[1] / 255)
    return float(ours / (ours + 147 + np.exp(color[2] / 255)))


@pytest.mark.parametrize("classes", [150, 151])
@pytest.mark.parametrize("size", [("h", "w"), (640, 640)])
def test_floor_and_rug_are_summed_with_or_without_a_background(tmp_path: Path, classes: int, size: tuple) -> None:
    color = (230, 90, 0)
    found = SemanticNetwork(described("segformer-ade20k", segformer(tmp_path / "n.onnx", classes, size)))
    probability = found.floor_probability(image(color), CAMERA)
    assert probability.shape == (90, 150)
    assert np.allclose(probability[44:, 64:], chance(color), atol=0.004)
    assert np.allclose(probability[:36], 2 / 150, atol=0.004) and np.allclose(probability[:, :56], 2 / 150, atol=0.004)


def test_labels_are_floor_where_they_say_so(tmp_path: Path) -> None:
    found = SemanticNetwork(described("mmseg-ade20k", mmseg(tmp_path / "n.onnx")))
    floor = np.zeros((90, 150), bool)
    floor[40:, 60:] = True
    for color in ((200, 10, 10), (10, 200, 10)):
        probability = found.floor_probability(image(color, (0, 0, 200)), CAMERA)
        assert np.array_equal(probability > 0.5, floor)


@pytest.mark.parametrize(("form", "make"), [("segformer-ade20k", segformer), ("mmseg-ade20k", mmseg)])
def test_the_form_is_known_by_its_signature(tmp_path: Path, form: str, make) -> None:
    path = make(tmp_path / "any.onnx")
    assert [name for name, _ in matching_forms({path: signature_of(path)})] == [form]


def test_another_number_of_classes_is_refused(tmp_path: Path) -> None:
    path = segformer(tmp_path / "n.onnx", 160)
    with pytest.raises(InputError, match=r"logits of the shape \[1, 160, .*says 150 classes; correct classes"):
        SemanticNetwork(described("segformer-ade20k", path)).floor_probability(image((1, 2, 3)), CAMERA)
