"""A network of normals in the forms that exports have, by one whose answer is known: the normal is written in the
color, n = 2 c - 1."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from normal_networks import metric3d, moge, own
from onnx_samples import F, save, value

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.networks.installed import InstalledModel
from nvsim.perception.normals_network import NormalsNetwork, installed_normals

FLOOR, WALL = np.array([0.0, -1.0, 0.0]), np.array([0.6, 0.0, -0.8])  # x right, y down, z forward


def opened(path: Path) -> NormalsNetwork:
    """The network at `path` as one was installed before there were descriptions: its form is found in it."""
    return NormalsNetwork(InstalledModel("normals", "normals", path.parent, None, None, (path,)).open("cpu"))


def color(normal: np.ndarray) -> np.ndarray:
    """(3,) uint8."""
    return np.round((normal + 1) / 2 * 255).astype(np.uint8)


def picture(height: int = 90, width: int = 150) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) a wall, and where the lower right shows floor."""
    image = np.tile(color(WALL), (height, width, 1))
    floor = np.zeros((height, width), bool)
    floor[height * 2 // 3 :, width * 2 // 5 :] = True
    image[floor] = color(FLOOR)
    return image, floor


def inner(mask: np.ndarray, pixels: int = 4) -> np.ndarray:
    """(H, W) what is farther than so many pixels from where the mask changes."""
    import cv2

    kernel = np.ones((2 * pixels + 1,) * 2, np.uint8)
    return cv2.erode(mask.astype(np.uint8), kernel, borderValue=1).astype(bool)


@pytest.mark.parametrize("form", ["metric3d", "moge", "own", "fixed", "half"])
def test_the_normals_of_every_form_come_out_alike(tmp_path: Path, form: str) -> None:
    path = tmp_path / "normals.onnx"
    if form in ("own", "fixed", "half"):
        # GeoWizard's signs, n + 1 halved, ImageNet's range.
        own(path, size=(64, 64) if form == "fixed" else ("h", "w"), half=form == "half")
    else:
        {"metric3d": metric3d, "moge": moge}[form](path)
    image, floor = picture()
    found = opened(path).camera_normals(image)
    assert found.shape == (90, 150, 3) and found.dtype == np.float32
    for mask, normal in ((floor, FLOOR), (~floor, WALL)):
        assert np.abs(found[inner(mask)] - normal).max() < 0.02
    assert np.allclose(np.linalg.norm(found, axis=-1), 1, atol=1e-3)


@pytest.mark.parametrize("heading", [0.0, 1.0, 4.0])
def test_the_normals_are_turned_into_the_world(tmp_path: Path, heading: float) -> None:
    pitched = Camera(Intrinsics.from_fov(40, 30, 1.2), camera_pose(np.zeros(3), heading, -np.pi / 4))
    image = np.tile(color(np.array([0, -(0.5**0.5), -(0.5**0.5)])), (30, 40, 1))
    found = opened(metric3d(tmp_path / "n.onnx")).normals(image, pitched)
    assert np.allclose(found, [0, 0, 1], atol=0.01), "what faces the camera from below, halfway down, is floor"
    level = Camera(pitched.intrinsics, camera_pose(np.zeros(3), heading))
    wall = np.tile(color(np.array([0.0, 0, -1])), (30, 40, 1))
    found = opened(metric3d(tmp_path / "n.onnx")).normals(wall, level)
    assert np.allclose(found, [-np.sin(heading), -np.cos(heading), 0], atol=0.01)


def test_where_a_network_says_that_there_is_nothing_there_is_no_normal(tmp_path: Path) -> None:
    image, floor = picture()
    image[:20] = 0  # black is sky to it
    found = opened(moge(tmp_path / "n.onnx")).camera_normals(image)
    assert not found[:18].any() and np.abs(found[inner(floor)] - FLOOR).max() < 0.02


def test_what_is_no_network_of_normals_is_refused_with_what_to_do(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("NVSIM_MODELS", str(tmp_path))
    with pytest.raises(InputError, match=r"normals\.onnx.*--normal-source gaussians"):
        installed_normals()
    path = tmp_path / "normals.onnx"
    path.write_bytes(b"no network")
    with pytest.raises(InputError, match="cannot be loaded"):
        installed_normals()
    own(path, toml="")
    (tmp_path / "normals.toml").unlink()
    with pytest.raises(InputError, match=r"normals\.onnx fit none of the known forms \(.*moge-2.*describe it in a"):
        installed_normals()
    path.unlink()
    nodes = [("ReduceMean", ["pixel_values", "channel"], ["depth"], {"keepdims": 1})]
    save(path, nodes, [value("pixel_values", 1, 3, "h", "w")], [value("depth", 1, 1, "h", "w", kind=F)],
         {"channel": np.array([1])})  # fmt: skip
    with pytest.raises(InputError, match="none of the known forms"):
        installed_normals()
    path.with_suffix(".toml").write_text("white = 255\n")
    with pytest.raises(InputError, match="gives no normals"):
        installed_normals()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("colour = 3", "unknown key 'colour'"),
        ("axes = [1, 1]", "axes"),
        ("axes = [1, 0, 1]", "no axis may be 0"),
        ("white = true", "white is True; it must be a number above 0"),
        ("multiple = 0", "multiple"),
        ("axes = [", "TOML"),
    ],
)
def test_a_description_that_makes_no_sense_is_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        opened(own(tmp_path / "n.onnx", toml=text))
