"""Models of several graphs: a scheduler's loop (GeoWizard) and a text as token ids (EVF-SAM)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from described_models import described
from diffusion_networks import alphas, geowizard
from test_perception_normals import FLOOR, WALL, inner, picture
from text_prompted_networks import IDS, evf_sam

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.networks.chain import Ddim
from nvsim.networks.description import Scheduler
from nvsim.networks.installed import signature_of
from nvsim.networks.known_forms import matching_forms
from nvsim.perception.normals_network import NormalsNetwork
from nvsim.perception.semantic_network import SemanticNetwork

CAMERA = Camera(Intrinsics.from_fov(150, 90, 1.2), camera_pose(np.zeros(3), 0.0))


@pytest.mark.parametrize(
    ("more", "times"),
    [
        ({"steps": 10}, list(range(901, 0, -100))),
        ({"steps": 10, "spacing": "trailing"}, list(range(999, 0, -100))),
        ({"steps": 4, "offset": 0}, [750, 500, 250, 0]),
        ({"steps": 1, "spacing": "trailing"}, [999]),
    ],
)
def test_the_timesteps_are_those_of_diffusers(more: dict, times: list[int]) -> None:
    assert Ddim(Scheduler("x", "v", "epsilon", **more)).timesteps.tolist() == times


@pytest.mark.parametrize("predicts", ["epsilon", "v_prediction", "sample"])
@pytest.mark.parametrize("at_one", [True, False])
def test_a_perfect_prediction_leads_to_what_the_noise_hides(predicts: str, at_one: bool) -> None:
    rng = np.random.default_rng(1)
    clean, noise = rng.normal(size=(2, 4, 3, 5))
    ddim, a = Ddim(Scheduler("x", "v", predicts, steps=7, ends_at_one=at_one)), alphas()  # type: ignore[arg-type]
    first = a[ddim.timesteps[0]]
    state = first**0.5 * clean + (1 - first) ** 0.5 * noise
    for t in ddim.timesteps:
        said = {"epsilon": noise, "sample": clean, "v_prediction": a[t] ** 0.5 * noise - (1 - a[t]) ** 0.5 * clean}
        state = ddim.step(state, said[predicts], int(t))
    end = 1.0 if at_one else a[0]
    assert np.allclose(state, end**0.5 * clean + (1 - end) ** 0.5 * noise, atol=1e-5)


def test_a_diffusion_model_gives_the_normals_of_the_photo_and_the_same_ones_again(tmp_path: Path) -> None:
    files = geowizard(tmp_path / "m")
    said = """
[schedulers.ddim]
state = "latents"
prediction = "predicted"
predicts = "v_prediction"
steps = 5
ends_at_one = true
"""
    image, floor = picture()
    network = NormalsNetwork(described("geowizard", *files, more=said))
    found = network.camera_normals(image)
    # The latents are an eighth as fine: 768 pixels across are 96.
    for mask, normal in ((floor, FLOOR), (~floor, WALL)):
        assert np.abs(found[inner(mask, 4)] - normal).max() < 0.03
    assert np.array_equal(found, network.camera_normals(image))
    # As published it ends a step before: the first beta's share of noise stays.
    rough = NormalsNetwork(described("geowizard", *files)).camera_normals(image)
    assert 0.01 < np.abs(rough[inner(floor, 4)] - FLOOR).max() < 0.8


def test_the_form_of_several_graphs_is_known_by_their_signatures(tmp_path: Path) -> None:
    for form, paths in (("geowizard", geowizard(tmp_path / "a")), ("evf-sam2", evf_sam(tmp_path / "b", "evf-sam2")),
                        ("evf-sam", evf_sam(tmp_path / "c", "evf-sam"))):  # fmt: skip
        (found, files), *_ = matching_forms({path: signature_of(path) for path in reversed(paths)})
        assert found == form and tuple(files.values()) == paths


@pytest.mark.parametrize("form", ["evf-sam", "evf-sam2"])
def test_what_a_text_asks_for_is_found_where_it_is(tmp_path: Path, form: str) -> None:
    paths = evf_sam(tmp_path / "m", form)
    with pytest.raises(InputError, match=r"must set the constant prompt: the token ids of '\[semantic\] floor'"):
        described(form, *paths)
    image = np.zeros((90, 150, 3), np.uint8)
    image[60:, 50:] = (160, 30, 30)
    image[:, :20] = (12, 200, 200)  # less than half of the mean, which is about 0.14
    said = f"[constants]\nprompt = {{ value = {list(IDS)}, shape = [1, {len(IDS)}] }}\n"
    found = SemanticNetwork(described(form, *paths, more=said)).floor_probability(image, CAMERA) > 0.5
    floor = np.zeros((90, 150), bool)
    floor[60:, 50:] = True
    # SAM 1 has one feature of 64 x 64: a cell is 2.3 pixels of the image.
    assert (found ^ floor)[inner(floor, 4)].sum() == 0 and (found ^ floor)[inner(~floor, 4)].sum() == 0
    other = said.replace("77", "78")
    assert not (SemanticNetwork(described(form, *paths, more=other)).floor_probability(image, CAMERA) > 0.5).any()
