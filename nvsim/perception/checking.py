"""Check that an installed model matches its description: files, checksums, and its output for a test image."""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass

import numpy as np

from nvsim.errors import InputError
from nvsim.files.opening import is_regular, opened
from nvsim.files.reading import reading
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.networks.chain import Chain
from nvsim.networks.installed import InstalledModel
from nvsim.perception.feature_network import FeatureNetwork
from nvsim.perception.normals_network import NormalsNetwork
from nvsim.perception.prompted_network import PromptedNetwork
from nvsim.perception.semantic_network import SemanticNetwork

_SIZE = 240, 320  # of the test image


@dataclass(frozen=True)
class ModelCheck:
    """problem  a sentence, "" if the model matches its description
    says     the model's output for a test image, in words
    seconds  time for one image, measured on the second call
    """

    problem: str
    says: str = ""
    seconds: float = 0.0


def check(model: InstalledModel) -> ModelCheck:
    """Opens a model and runs it twice on a test image."""
    try:
        _sums(model)
        chain = model.open()
        _answer(chain)
        start = time.perf_counter()
        says = _answer(chain)
        return ModelCheck("", says, time.perf_counter() - start)
    except InputError as error:
        return ModelCheck(str(error))


def _sums(model: InstalledModel) -> None:
    """Raises InputError if a file is missing or differs from the installed one."""
    for file in model.description.files.values() if model.description else ():
        for name in (file.name, *file.beside):
            if not is_regular(model.folder / name):
                raise InputError(f"{model.folder / name} is missing; add the model again.")
        path = model.folder / file.name
        if not file.sha256:
            continue
        with reading(path, "an ONNX network"), opened(path) as opened_file:
            found = hashlib.file_digest(opened_file, "sha256").hexdigest()
        if found != file.sha256.lower():
            raise InputError(f"{path} is not the file that was described (SHA-256 {found[:16]}…); add the model again.")


def _answer(chain: Chain) -> str:
    """The model's output, in words, for a test image that is light above a dark floor, with noise. Raises InputError if
    the output is impossible."""
    height, width = _SIZE
    image = np.full((height, width, 3), 190, np.uint8)
    image[height // 2 :] = (120, 100, 80)
    image = np.clip(image + np.random.default_rng(0).normal(0, 6, image.shape), 0, 255).astype(np.uint8)
    camera = Camera(Intrinsics.from_fov(width, height, 1.2), camera_pose(np.zeros(3), 0.0, -0.3))
    path = next(iter(chain.paths.values()))
    role = chain.description.role
    if role == "semantic":
        found = SemanticNetwork(chain).floor_probability(image, camera)
        if not 0 <= found.min() <= found.max() <= 1 + 1e-4:
            raise InputError(
                f"{path} gives probabilities from {found.min():.3g} to {found.max():.3g}; check `meaning` in its "
                "description."
            )
        return f"floor on {float((found > 0.5).mean()):.0%} of a test image"
    if role == "normals":
        normals = NormalsNetwork(chain).normals(image, camera)
        there = normals.any(axis=-1)
        if not there.any():
            raise InputError(f"{path} finds no surface in a test image; check the range of its images.")
        return f"{float((normals[there][:, 2] > 0.9).mean()):.0%} of a test image is horizontal"
    if role == "features":
        network = FeatureNetwork(chain, "")
        features = network.find(image, 1000)
        return f"{len(features)} keypoints on a test image, {len(network.match(features, features))} of them matched"
    mask = PromptedNetwork(chain).mask(image, np.array([[width / 2, height * 0.8]]), camera)
    return f"a region of {float(mask.mean()):.0%} at a point of a test image"
