"""The fields of a model's TOML file, and the descriptions that come with NVSim."""

from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvsim.errors import InputError
from nvsim.networks.description import Description
from nvsim.networks.image_preparation import Preparation
from nvsim.networks.known_forms import FOLDER, known_descriptions, values_of
from nvsim.networks.parsing import description_in
from nvsim.networks.toml_table import parse_toml

PATH = Path("model.toml")
FORMS = sorted(path.stem for path in FOLDER.glob("*.toml"))


@pytest.mark.parametrize("form", FORMS)
def test_every_description_that_comes_with_nvsim_says_who_made_the_model_and_under_which_licence(form: str) -> None:
    description = known_descriptions()[form]
    assert description.names and description.made_by and description.licence and description.source.startswith("http")


def test_a_description_that_follows_a_form_takes_from_it_what_it_leaves_out(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text('form = "moge-2"\ntitle = "Mine"\n[files]\nnetwork = { file = "mine.onnx", sha256 = "ab" }\n')
    found = description_in(values_of(path), path)
    assert (found.title, found.files["network"].name, found.licence) == (
        "Mine",
        "mine.onnx",
        known_descriptions()["moge-2"].licence,
    )
    assert found.steps == known_descriptions()["moge-2"].steps
    path.write_text('form = "moge-3"')
    with pytest.raises(InputError, match="form is moge-3; it must be one of aliked, aliked-lightglue-colmap, "):
        values_of(path)


def changed(form: str, *keys: str | int, to: object) -> dict[str, Any]:
    """The values of a form with another one at `keys`; None takes it away."""
    values = copy.deepcopy(values_of(FOLDER / f"{form}.toml"))
    inner: Any = values
    for key in keys[:-1]:
        inner = inner[key]
    if to is None:
        del inner[keys[-1]]
    else:
        inner[keys[-1]] = to
    return values


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (changed("moge-2", "role", to="depth"), "role is depth; it must be one of semantic, normals, prompted"),
        (changed("moge-2", "colour", to=1), "colour is unknown; the known keys are"),
        (
            changed("moge-2", "files", "network", "file", to="../a.onnx"),
            "files.network.file is .*beside the description",
        ),
        (
            changed("moge-2", "images", "photo", "resize", to="fit"),
            "images.photo.resize is fit; .*crop, stretch, corner",
        ),
        (
            changed("moge-2", "images", "photo", "size", to=[4]),
            r"images.photo.size is \[4\]; it must be .height, width",
        ),
        (
            changed("moge-2", "steps", 0, "file", to="decoder"),
            "the file 'decoder' is unknown; it must be one of network",
        ),
        (
            changed("moge-2", "steps", 0, "inputs", 1, "value", to="seeds"),
            "the value 'seeds' is unknown; .*photo, tokens",
        ),
        (changed("moge-2", "steps", 0, "inputs", 1, "kind", to="text"), r"steps.1.*inputs.2.*kind is text"),
        (changed("moge-2", "steps", to=[]), "steps is missing"),
        (changed("moge-2", "result", "axes", to=["right", "left", "up"]), "result.axes is .*right or left, down or up"),
        (changed("moge-2", "result", "value", to="depth"), "the value 'depth' is unknown"),
        (changed("moge-2", "result", "image", to="other"), "the image 'other' is unknown; it must be one of photo"),
        (changed("moge-2", "points", to={"image": "photo"}), "points is unknown"),
        (changed("segformer-ade20k", "result", "floor", to=[150]), "result.floor is .*from 0 to 149"),
        (changed("segformer-ade20k", "result", "floor", to=None), "result.floor is missing"),
        (changed("segformer-ade20k", "result", "meaning", to="depth"), "one of logits, probabilities, labels"),
        (changed("sam2-osam", "points", "image", to="normals"), "the image 'normals' is unknown"),
        (changed("sam2-osam", "constants", "no_mask", to={"value": [1, 2], "shape": [3]}), "one number, or 3"),
    ],
)
def test_what_makes_no_sense_is_one_sentence_with_its_key(values: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as error:
        description_in(values, PATH)
    assert str(error.value).startswith("model.toml: ") and "\n" not in str(error.value)


_ANYTHING = st.recursive(
    st.integers() | st.floats() | st.booleans() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=5,
)


@given(st.sampled_from(FORMS), st.randoms(use_true_random=False), _ANYTHING)
def test_a_description_with_anything_anywhere_is_one_or_a_sentence(form: str, random: Any, value: Any) -> None:
    values = copy.deepcopy(values_of(FOLDER / f"{form}.toml"))
    inner: Any = values
    while True:  # somewhere in it
        key = random.choice(list(inner) if isinstance(inner, dict) else range(len(inner)))
        if not isinstance(inner[key], (dict, list)) or not inner[key] or random.random() < 0.2:
            inner[key] = value
            break
        inner = inner[key]
    try:
        assert isinstance(description_in(values, PATH), Description)
    except InputError as error:
        assert "model.toml" in str(error) and "\n" not in str(error)


@given(st.integers(1, 700), st.integers(1, 700), st.sampled_from(["stretch", "corner", "centre", "crop"]),
       st.sampled_from([(0, 0, 28), (0, 0, 1), (616, 1064, 1), (48, 48, 1)]))  # fmt: skip
def test_an_image_lies_within_what_the_network_looks_at(
    height: int, width: int, resize: Any, size: tuple[int, int, int]
) -> None:
    made = Preparation(size[0], size[1], resize, multiple=size[2])
    place = made.placement(height, width)
    assert place.rows % size[2] == 0 and place.columns % size[2] == 0
    if resize == "crop":
        assert place.left <= 0 <= place.left + place.wide - place.columns or place.wide == place.columns
    else:
        assert 0 <= place.left <= place.columns - place.wide and 0 <= place.top <= place.rows - place.high
    if resize in ("corner", "centre") and size[0] == 0:
        assert (place.wide, place.high) == (width, height), "an open size need not be resized"


def test_the_page_shows_a_description_and_names_every_form() -> None:
    page = (Path(__file__).parents[2] / "resources" / "docs" / "networks.md").read_text()
    (example,) = re.findall(r"^```toml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    found = description_in(parse_toml(example, PATH), PATH)
    assert found.title == "DSINE" and found.images["photo"].multiple == 32
    assert [form for form in FORMS if f"`{form}`" not in page] == []
