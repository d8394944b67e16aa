"""Every described form of SAM, by networks of its signature that draw a disc at each point: a shifted point, a border
that is not cut off, a wrong range of colors or a wrong mask of several is another disc."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from described_models import described
from prompted_networks import FORMS, LEAST, MORE, SIDE, pair

from nvsim.networks.installed import InstalledModel, signature_of
from nvsim.networks.known_forms import known_descriptions, matching_forms
from nvsim.perception.prompted_network import PromptedNetwork

SIZES = ((300, 480), (480, 300), (100, 130))  # wider, higher, and smaller than what the networks look at
STRETCHED = tuple(form for form in FORMS if not form.startswith("mobile-sam"))


def colors(height: int, width: int) -> np.ndarray:
    """The left half strongly red, the right half little, which blue and green would say the other way round."""
    image = np.zeros((height, width, 3), np.uint8)
    image[:, : width // 2] = (204, 30, 60)
    image[:, width // 2 :] = (51, 200, 160)
    return image


def disc(form: str, size: tuple[int, int], point: tuple[float, float], red: float) -> np.ndarray:
    """(H, W) bool by hand: a disc in the network's image, in the pixels of an image."""
    height, width = size
    if form in STRETCHED:
        fx, fy = SIDE / width, SIDE / height
    else:
        fx = fy = SIDE / max(size)
    y, x = np.mgrid[:height, :width] + 0.5
    return ((x - point[0]) * fx) ** 2 + ((y - point[1]) * fy) ** 2 < (LEAST + MORE * red) ** 2


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("form", FORMS)
def test_the_mask_lies_where_the_point_is(tmp_path: Path, form: str, size: tuple[int, int]) -> None:
    network = PromptedNetwork(described(form, *pair(tmp_path / "m", form)))
    height, width = size
    for share, red in (((0.27, 0.72), 0.8), ((0.81, 0.3), 0.2)):
        point = share[0] * width, share[1] * height
        found = network.region(colors(*size), np.array([point]), np.ones(1, bool))
        wanted = disc(form, size, point, red)
        assert found.shape == size and overlap(found, wanted) > 0.94
        # A shift by a pixel of the image moves the disc by one.
        middle = np.argwhere(found).mean(axis=0)[::-1] + 0.5
        assert np.abs(middle - np.argwhere(wanted).mean(axis=0)[::-1] - 0.5).max() < 0.4


@pytest.mark.parametrize("form", FORMS)
def test_three_points_give_three_discs_and_one_that_is_none_cuts_its_own_out(tmp_path: Path, form: str) -> None:
    network = PromptedNetwork(described(form, *pair(tmp_path / "m", form)))
    size = (300, 480)
    points = np.array([[100.0, 80.0], [150.0, 220.0], [400.0, 150.0]])
    discs = [disc(form, size, (x, y), red) for (x, y), red in zip(points, (0.8, 0.8, 0.2), strict=True)]
    found = network.region(colors(*size), points, np.ones(3, bool))
    assert overlap(found, discs[0] | discs[1] | discs[2]) > 0.95
    points[2] = (100.0 + 12, 80.0)
    cut = disc(form, size, (112.0, 80.0), 0.8)
    found = network.region(colors(*size), points, np.array([True, True, False]))
    assert overlap(found, (discs[0] | discs[1]) & ~cut) > 0.9


@pytest.mark.parametrize("form", FORMS)
def test_the_form_of_a_pair_is_known_by_its_signature_whatever_the_files_are_called(tmp_path: Path, form: str) -> None:
    first, second = pair(tmp_path / "m", form)
    a, b = first.rename(first.with_name("z.onnx")), second.rename(second.with_name("y.onnx"))
    (found, files), *_ = matching_forms({b: signature_of(b), a: signature_of(a)})
    assert found == form and files == dict(zip(known_descriptions()[form].files, (a, b), strict=True))
    old = InstalledModel("prompted", "prompted", tmp_path / "m", None, None, (a, b))
    assert PromptedNetwork(old.open("cpu")).region(colors(90, 90), np.array([[20.0, 20.0]]), np.ones(1, bool)).any()


def test_an_image_is_looked_at_once_for_all_its_points(tmp_path: Path) -> None:
    chain = described("sam2-samexporter", *pair(tmp_path / "m", "sam2-samexporter"))
    seen = []
    show = chain.show
    chain.show = lambda image: seen.append(1) or show(image)  # type: ignore[method-assign, func-returns-value]
    network = PromptedNetwork(chain)
    for x in (20.0, 30.0):
        network.region(colors(60, 80), np.array([[x, 20.0]]), np.ones(1, bool))
    network.region(colors(60, 90), np.array([[20.0, 20.0]]), np.ones(1, bool))
    assert len(seen) == 2
