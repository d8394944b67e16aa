"""Convert an appearance to the form stored in a model folder: a JSON-able description and named tensors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from nvsim.splats.appearance import LinearAppearance, NetworkAppearance
from nvsim.splats.embedding import Embedding
from nvsim.splats.types import Appearance

_EMBEDDING, _WEIGHTS, _FEATURES = "appearance.embedding.", "appearance.weights.", "appearance.features"


def describe(appearance: Appearance | None) -> dict[str, Any] | None:
    """All fields of an appearance except its arrays."""
    if appearance is None:
        return None
    embedding = appearance.embedding
    data: dict[str, Any] = {
        "octaves": embedding.octaves,
        "period": embedding.period,
        "nearest": embedding.nearest,
        "middle": [float(x) for x in appearance.middle],
    }
    if isinstance(appearance, NetworkAppearance):
        return {"kind": "network", "cell": appearance.cell, **data}
    return {"kind": "linear", **data}


def tensors_of(appearance: Appearance | None) -> dict[str, np.ndarray]:
    """The arrays of an appearance by name, with the shapes of `nvsim.splats.types.Appearance`."""
    if appearance is None:
        return {}
    embedding = {_EMBEDDING + name: w for name, w in appearance.embedding.weights.items()}
    return embedding | {_WEIGHTS + name: w for name, w in appearance.weights.items()} | {_FEATURES: appearance.features}


def read_appearance(data: Mapping[str, Any] | None, tensors: Mapping[str, np.ndarray], count: int) -> Appearance | None:
    """The inverse of `describe` and `tensors_of`, for `count` Gaussians: features have shape (count, F). Raises
    KeyError, TypeError or ValueError if description and tensors do not match."""
    if data is None:
        return None

    def under(prefix: str) -> dict[str, np.ndarray]:
        found = {n.removeprefix(prefix): a for n, a in tensors.items() if n.startswith(prefix)}
        return {name: np.array(array, np.float32, order="C") for name, array in found.items()}

    embedding = Embedding(under(_EMBEDDING), int(data["octaves"]), float(data["period"]), bool(data["nearest"]))
    features = np.array(tensors[_FEATURES], np.float32, order="C")
    middle = np.array(data["middle"], np.float64)
    if len(features) != count or middle.shape != (3,):
        raise ValueError(f"features of {len(features)} Gaussians for {count}")
    if data["kind"] == "linear":
        return LinearAppearance(embedding, under(_WEIGHTS), features, middle)
    if data["kind"] == "network":
        return NetworkAppearance(embedding, under(_WEIGHTS), features, middle, float(data["cell"]))
    raise ValueError(f"appearance of kind {data['kind']!r}")
