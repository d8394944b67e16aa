"""Networks that a user brings, as real ONNX files whose answers are known, and their descriptions."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from backbone_samples import SIZE, mean_network, weights
from hypothesis import given
from hypothesis import strategies as st

from nvsim.errors import InputError
from nvsim.networks.image_preparation import Preparation
from nvsim.networks.onnx_server import import_onnxruntime
from nvsim.networks.onnx_session import providers
from nvsim.r2r.features.layouts import LAYOUTS
from nvsim.r2r.features.network import Description, Network, choose_backbone, parse_description

IMAGENET = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])


def sides(height: int = 96, width: int = 128) -> np.ndarray:
    """An image of 4:3, its outer eighths red, the rest of it blue with a green stripe in the middle."""
    image = np.zeros((height, width, 3), np.uint8)
    image[:, :, 2] = 200
    image[:, : width // 8, :] = image[:, -width // 8 :, :] = (250, 10, 20)
    image[:, 3 * width // 8 : 5 * width // 8] = (0, 180, 40)
    return image


def through(network: Network, *images: np.ndarray) -> np.ndarray:
    return network.features([network.prepared(image) for image in images])


def test_the_middle_of_an_image_comes_out_as_computed_by_hand(tmp_path: Path) -> None:
    network = Network(mean_network(tmp_path / "mean.onnx", 20), 4)
    image = sides()
    mean = image[:, 16:112].mean(axis=(0, 1)) / 255
    expected = (mean - IMAGENET[0]) / IMAGENET[1] @ weights(20)
    found = through(network, image, image[:, ::-1])
    np.testing.assert_allclose(found, [expected, expected], atol=0.02)  # at the stripe bicubic overshoots
    assert found.dtype == np.float32 and network.width == 20 and network.classes == 0


def test_a_stretched_image_keeps_its_sides(tmp_path: Path) -> None:
    path = mean_network(tmp_path / "mean.onnx", 20, description='resize = "stretch"\ninterpolation = "area"\n')
    expected = (sides().mean(axis=(0, 1)) / 255 - IMAGENET[0]) / IMAGENET[1] @ weights(20)
    np.testing.assert_allclose(through(Network(path, 4), sides())[0], expected, atol=0.01)


def test_gray_levels_in_blue_green_red_last_axis_as_caffe_takes_them(tmp_path: Path) -> None:
    said = 'colours = "BGR"\nlayout = "NHWC"\nbrightest = 255.0\nmean = [103.1, 115.9, 123.2]\nstd = [1, 1, 1]\n'
    network = Network(mean_network(tmp_path / "caffe.onnx", 7, nhwc=True, description=said), 4)
    image = np.full((30, 40, 3), (10, 120, 240), np.uint8)
    expected = (np.array([240, 120, 10]) - [103.1, 115.9, 123.2]) @ weights(7)
    np.testing.assert_allclose(through(network, image)[0], expected, rtol=1e-4)


@pytest.mark.parametrize("half", [False, True])
def test_a_prescribed_batch_gives_what_an_open_one_gives(tmp_path: Path, half: bool) -> None:
    images = [np.full((48, 64, 3), 20 * i, np.uint8) for i in range(7)]
    free = Network(mean_network(tmp_path / "free.onnx", 9), 7)
    fixed = Network(mean_network(tmp_path / "fixed.onnx", 9, batch=5, half=half), 7)
    assert (free.batch, fixed.batch) == (7, 5)
    expected = through(free, *images)
    found = np.concatenate([through(fixed, *images[:5]), through(fixed, *images[5:])])
    np.testing.assert_allclose(found, expected, rtol=0.01 if half else 1e-5, atol=0.02 if half else 1e-5)


def test_logits_follow_the_features(tmp_path: Path) -> None:
    network = Network(mean_network(tmp_path / "mean.onnx", 6, classes=True), 4)
    image = np.full((48, 64, 3), 100, np.uint8)
    mean = (100 / 255 - IMAGENET[0]) / IMAGENET[1]
    expected = np.concatenate([mean @ weights(6), mean @ weights(1000, 1)])
    assert network.classes == 1000
    np.testing.assert_allclose(through(network, image)[0], expected, rtol=1e-4, atol=1e-4)


def test_fine_stripes_are_averaged_and_not_sampled() -> None:
    stripes = np.zeros((480, 640, 3), np.uint8)
    stripes[:, ::2] = 255
    values = Preparation(SIZE, SIZE, mean=(0, 0, 0), std=(1, 1, 1))(stripes)
    assert np.abs(values - 0.5).max() < 0.02


@pytest.mark.parametrize(
    "said, sentence",
    [
        ("", "its output features has 20 numbers for each image, but its description says width = 512"),
        ('layout = "NHWC"', r"takes image tensor\(float\) .*, but its description says .*\(N, 48, 48, 3\)"),
        ('output = "pooled"', "it has no output pooled; it has features, whole"),
        ("output = ''", "output is ; it must be a text"),
        ("widht = 3", "widht is unknown"),
        ("mean = [0.5, 0.5]", "mean is .*; it must be three numbers, one for each color"),
        ("std = [1, 0, 1]", "std is .*; it must be three numbers above 0"),
        ("colours = 'GBR'", "colours is GBR; it must be one of RGB, BGR"),
        ("size = [0, 48]", "size is .*; it must be .height, width. in pixels"),
        ("size = 'x", "is not a TOML file that can be read"),
    ],
)
def test_what_does_not_fit_is_one_sentence(tmp_path: Path, said: str, sentence: str) -> None:
    path = mean_network(tmp_path / "mean.onnx", 20)
    lines = {"output": 'output = "features"', "width": "width = 512", "size": f"size = {SIZE}"}
    lines[said.split(" ")[0]] = said
    path.with_suffix(".toml").write_text("\n".join(lines.values()))
    with pytest.raises(InputError, match=sentence):
        Network(path, 4)


def test_an_output_that_is_not_pooled_is_refused(tmp_path: Path) -> None:
    path = mean_network(tmp_path / "mean.onnx", 3)
    path.with_suffix(".toml").write_text(f'output = "whole"\nwidth = 3\nsize = {SIZE}')
    with pytest.raises(InputError, match="shape .*48, 48.*, not one row of numbers for each image"):
        Network(path, 4)


def test_without_a_description_the_sentence_says_what_to_write(tmp_path: Path) -> None:
    path = mean_network(tmp_path / "mean.onnx", 3)
    path.with_suffix(".toml").unlink()
    with pytest.raises(InputError, match=r"mean.toml is missing; describe .*width = 512 and size = \[224, 224\]"):
        Network(path, 4)


def test_a_network_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"The network .*none.onnx does not exist; check --model"):
        choose_backbone(LAYOUTS["vit-b16"], tmp_path / "none.onnx", 4, "cpu")


def test_of_several_outputs_one_must_be_named(tmp_path: Path) -> None:
    path = mean_network(tmp_path / "mean.onnx", 3)
    path.with_suffix(".toml").write_text(f"width = 3\nsize = {SIZE}")
    with pytest.raises(InputError, match="its description names no output; it has features, whole"):
        Network(path, 4)


def test_the_example_of_the_page_is_a_description() -> None:
    page = (Path(__file__).parents[2] / "resources" / "docs" / "features.md").read_text()
    (example,) = re.findall(r"^```toml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    found = parse_description(example, Path("clip.toml"))
    assert (found.name, found.width, found.output) == ("CLIP ViT-B/16 of OpenAI", 512, "image_embeds")
    assert found.preparation == Preparation(
        224,
        224,
        mean=(0.48145466, 0.4578275, 0.40821073),
        std=(0.26862954, 0.26130258, 0.27577711),
    )
    commented = example.replace("# classes", "classes")
    assert parse_description(commented, Path("clip.toml")).classes == "logits"


def test_bytes_that_are_no_network_are_refused(tmp_path: Path) -> None:
    path = mean_network(tmp_path / "mean.onnx", 3)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InputError, match="cannot be loaded as an ONNX network"):
        Network(path, 4)


def test_a_provider_that_onnxruntime_has_not_is_named() -> None:
    if "CUDAExecutionProvider" in import_onnxruntime().get_available_providers():
        assert providers("cuda") == ["CUDAExecutionProvider"]
    else:
        with pytest.raises(InputError, match="cannot run on cuda .it has .*CPUExecutionProvider.*onnxruntime-gpu"):
            providers("cuda")
    assert providers("auto")[-1] == "CPUExecutionProvider"


_VALUES = st.recursive(
    st.integers() | st.floats() | st.booleans() | st.text(max_size=6),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=6,
)
_KEYS = st.sampled_from(
    [
        "name",
        "width",
        "size",
        "resize",
        "interpolation",
        "brightest",
        "mean",
        "std",
        "colours",
        "layout",
        "output",
        "classes",
        "x",
    ]
)


def toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else str(value)
    if isinstance(value, str):
        return '"' + "".join(f"\\U{ord(c):08x}" if not 0xD800 <= ord(c) < 0xE000 else "?" for c in value) + '"'
    return str(value)


@given(st.dictionaries(_KEYS, _VALUES) | st.just({"width": 5, "size": 9}))
def test_any_table_is_a_description_or_a_sentence(values: dict[str, object]) -> None:
    _described("\n".join(f"{key} = {toml(value)}" for key, value in values.items()))


@given(st.text() | st.text("[]={}\"'#\n.a1-+_ "))
def test_any_text_is_a_description_or_a_sentence(text: str) -> None:
    _described(text)


def _described(text: str) -> None:
    try:
        found = parse_description(text, Path("clip.toml"))
    except InputError as error:
        assert "clip.toml" in str(error) and "\n" not in str(error)
    else:
        assert isinstance(found, Description) and found.width > 0 and min(found.preparation.std) > 0
        height, width = found.preparation.height, found.preparation.width
        if height * width < 10_000:
            assert np.isfinite(found.preparation(np.zeros((3, 4, 3), np.uint8))).all()
