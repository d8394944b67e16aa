"""Every described form of a network of normals, and the frames that networks answer in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from described_models import described
from normal_networks import metric3d, metric3d_official, moge
from test_perception_normals import FLOOR, WALL, color, inner, picture

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.networks.chain import Chain
from nvsim.networks.installed import signature_of
from nvsim.networks.known_forms import matching_forms
from nvsim.perception.normals_network import NormalsNetwork

MADE = {"metric3d": metric3d_official, "metric3d-huggingface": metric3d, "moge-2": moge}
FRAMES = {  # what a model answers of a facing wall, a floor and the left wall of a corridor (Metric3D to Marigold)
    ("right", "down", "forward"): ((0, 0, -1), (0, -1, 0), (1, 0, 0)),
    ("left", "up", "backward"): ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    ("right", "up", "backward"): ((0, 0, 1), (0, 1, 0), (1, 0, 0)),
}


def opened(tmp_path: Path, form: str, more: str = "") -> Chain:
    path = tmp_path / "n.onnx"
    MADE[form](path)
    return described(form, path, more=more)


@pytest.mark.parametrize("size", [(90, 150), (150, 90), (616, 1064), (33, 47), (60, 200)])
@pytest.mark.parametrize("form", MADE)
def test_normals_lie_where_they_were_seen_whatever_lies_beside_the_image(
    tmp_path: Path, form: str, size: tuple[int, int]
) -> None:
    image, floor = picture(*size)
    found = NormalsNetwork(opened(tmp_path, form)).camera_normals(image)
    assert found.shape == (*size, 3)
    for mask, normal in ((floor, FLOOR), (~floor, WALL)):
        assert np.abs(found[inner(mask, 2)] - normal).max() < 0.02


@pytest.mark.parametrize("form", MADE)
def test_the_form_of_a_network_is_known_by_its_signature(tmp_path: Path, form: str) -> None:
    path = tmp_path / "any.onnx"
    MADE[form](path)
    assert [name for name, _ in matching_forms({path: signature_of(path)})] == [form]


@pytest.mark.parametrize("axes", FRAMES)
def test_whatever_frame_a_model_answers_in_a_floor_lies_and_walls_stand(tmp_path: Path, axes: tuple[str, ...]) -> None:
    said = f'[result]\nvalue = "normals"\nimage = "photo"\naxes = {list(axes)}\n'.replace("'", '"')
    network = NormalsNetwork(opened(tmp_path, "metric3d-huggingface", said))
    camera = Camera(Intrinsics.from_fov(84, 56, 1.2), camera_pose(np.zeros(3), 0.0))  # looks along +y, x to the right
    facing, floor, left = FRAMES[axes]
    for answer, world in ((facing, (0, -1, 0)), (floor, (0, 0, 1)), (left, (1, 0, 0))):
        image = np.tile(color(np.array(facing, float)), (56, 84, 1))
        image[30:54, 10:74] = color(np.array(answer, float))
        found = network.normals(image, camera)
        assert np.allclose(found[42, 42], world, atol=0.02)


def test_axes_that_point_the_wrong_way_are_refused_at_the_first_image(tmp_path: Path) -> None:
    said = '[result]\nvalue = "normals"\nimage = "photo"\nlayout = "NHWC"\naxes = ["left", "up", "backward"]\n'
    network = NormalsNetwork(opened(tmp_path, "moge-2", said))
    camera = Camera(Intrinsics.from_fov(84, 56, 1.2), camera_pose(np.zeros(3), 0.0))
    wall = np.tile(color(np.array([0.0, 0, -1])), (56, 84, 1))
    with pytest.raises(InputError, match="point away from the camera .normal times ray is 0.[89].*reverse the axes"):
        network.normals(wall, camera)


def test_the_number_of_tokens_is_given_as_the_file_has_it(tmp_path: Path) -> None:
    import onnx

    path = moge(tmp_path / "n.onnx")
    model = onnx.load(path)
    model.graph.input[1].type.tensor_type.shape.dim.add().dim_value = 1  # some exports take (1,), not a number
    onnx.save(model, path)
    image, floor = picture()
    assert np.abs(NormalsNetwork(described("moge-2", path)).camera_normals(image)[inner(floor)] - FLOOR).max() < 0.02


def test_an_output_of_another_layout_is_refused(tmp_path: Path) -> None:
    said = '[result]\nvalue = "normals"\nimage = "photo"\nlayout = "NHWC"\naxes = ["right", "down", "forward"]\n'
    with pytest.raises(InputError, match=r"no normals .three or four values.*correct the layout"):
        NormalsNetwork(opened(tmp_path, "metric3d", said)).camera_normals(picture()[0])
