"""Colors of Gaussians that depend on the camera position, evaluated without torch, and their form in a model folder.

There are two kinds. The color network of Splatfacto-W (Xu et al. 2024) computes all SH coefficients of a Gaussian from
its feature vector and the embedding. The linear form is our own and is meant for CPUs. A Gaussian keeps its own
coefficients, and a matrix computed from the embedding maps its features to a color offset. Its only cost is one read of
the features.

Both store one row of features per Gaussian, in the order of the Gaussians. Both also store the camera position to use
when a single set of colors is needed, as in an exported file.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from nvsim.splats.types import Appearance, Embedding, Gaussians, layer_count

Float32 = NDArray[np.float32]
CELL = 0.1
"""Meters: size of the grid cells at whose centers the color network is evaluated."""
_ROWS = 1024  # Gaussians per block, so that the layers stay in the CPU cache


@dataclass(eq=False)
class LinearAppearance:
    """SH coefficient 0 of Gaussian g = its own + W(embedding) features[g]. Exact at every position.

    embedding  determines W
    weights    "matrix.weight" (3 F, E) and "matrix.bias" (3 F,), W by rows
    features   (N, F)
    middle     (3,) camera position for a single set of colors, meters, world
    """

    embedding: Embedding
    weights: dict[str, Float32]
    features: Float32
    middle: NDArray[np.float64]
    _kept: threading.local = field(default_factory=threading.local, repr=False)

    def of_rows(self, rows: NDArray[np.generic]) -> LinearAppearance:
        """The appearance of the Gaussians `rows` (M,), as in `nvsim.splats.types.Appearance`."""
        return replace(self, features=self.features[rows], _kept=threading.local())

    def colored(self, gaussians: Gaussians, position: NDArray[np.floating]) -> Gaussians:
        """The Gaussians with their colors from `position` (3,), as in `nvsim.splats.types.Appearance`."""
        sh = getattr(self._kept, "sh", None)
        if sh is None or self._kept.source is not gaussians.sh:
            sh = self._kept.sh = gaussians.sh.copy()
            self._kept.source = gaussians.sh
        with _blas().limit(limits=1, user_api="blas"):
            offsets = self.features @ self.matrix(position).T
        np.add(gaussians.sh[:, 0], offsets, out=sh[:, 0])
        return replace(gaussians, sh=sh)

    def matrix(self, position: NDArray[np.floating]) -> Float32:
        """(3, F) W for a camera at `position` (3,)."""
        flat = self.weights["matrix.weight"] @ self.embedding.at(position) + self.weights["matrix.bias"]
        return flat.reshape(3, -1)


@dataclass(eq=False)
class NetworkAppearance:
    """All SH coefficients of Gaussian g = network(embedding, features[g]). Its own coefficients are not used.

    The network is evaluated at the center of the cell of `cell` meters that contains the camera, and only again when
    the camera leaves the cell. The embedding is a smooth function, so this is accurate enough. The image also does not
    depend on how the camera got there.

    embedding  first input of the network
    weights    layers "colour.i.weight" and "colour.i.bias" with ReLU after each, the first of which takes embedding and
               features; heads "base.*" (3 outputs) and "rest.*" (3 (K - 1) outputs, coefficient-major)
    features   (N, F)
    middle     (3,) camera position for a single set of colors, meters, world
    cell       meters; 0 evaluates at every position
    """

    embedding: Embedding
    weights: dict[str, Float32]
    features: Float32
    middle: NDArray[np.float64]
    cell: float = CELL
    _kept: threading.local = field(default_factory=threading.local, repr=False)

    def of_rows(self, rows: NDArray[np.generic]) -> NetworkAppearance:
        """The appearance of the Gaussians `rows` (M,), as in `nvsim.splats.types.Appearance`."""
        return replace(self, features=self.features[rows], _kept=threading.local())

    def colored(self, gaussians: Gaussians, position: NDArray[np.floating]) -> Gaussians:
        """The Gaussians with their colors from `position` (3,), as in `nvsim.splats.types.Appearance`."""
        place = np.asarray(position, np.float64)
        if self.cell > 0:
            place = (np.floor(place / self.cell) + 0.5) * self.cell
        sh = getattr(self._kept, "sh", None)
        if sh is None or not np.array_equal(self._kept.place, place):
            if sh is None:
                sh = self._kept.sh = np.empty(gaussians.sh.shape, np.float32)
            self._evaluate(self.embedding.at(place), sh)
            self._kept.place = place
        return replace(gaussians, sh=sh)

    def _evaluate(self, embedding: Float32, sh: Float32) -> None:
        w, e = self.weights, len(embedding)
        first = w["colour.0.weight"]
        shared = first[:, :e] @ embedding + w["colour.0.bias"]  # the embedding's part is equal for all rows
        names = ("base", "rest") if sh.shape[1] > 1 else ("base",)
        heads = np.concatenate([w[f"{name}.weight"] for name in names]).T.copy()
        biases = np.concatenate([w[f"{name}.bias"] for name in names])
        first, flat = first[:, e:].T.copy(), sh.reshape(len(sh), -1)
        # Use one thread. The blocks are too small to split, and on a busy machine a thread pool that waits for its
        # slowest member takes ten times as long.
        with _blas().limit(limits=1, user_api="blas"):
            for start in range(0, len(sh), _ROWS):
                part = slice(start, start + _ROWS)
                h = _relu(self.features[part] @ first, shared)
                for i in range(1, layer_count(w, "colour")):
                    h = _relu(h @ w[f"colour.{i}.weight"].T, w[f"colour.{i}.bias"])
                np.matmul(h, heads, out=flat[part])
                flat[part] += biases


def _relu(product: Float32, bias: Float32) -> Float32:
    product += bias
    return np.maximum(product, 0, out=product)


@functools.cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()


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

    def arrays_with_prefix(prefix: str) -> dict[str, np.ndarray]:
        found = {n.removeprefix(prefix): a for n, a in tensors.items() if n.startswith(prefix)}
        return {name: np.array(array, np.float32, order="C") for name, array in found.items()}

    embedding = Embedding(
        arrays_with_prefix(_EMBEDDING), int(data["octaves"]), float(data["period"]), bool(data["nearest"])
    )
    features = np.array(tensors[_FEATURES], np.float32, order="C")
    middle = np.array(data["middle"], np.float64)
    if len(features) != count or middle.shape != (3,):
        raise ValueError(f"features of {len(features)} Gaussians for {count}")
    if data["kind"] == "linear":
        return LinearAppearance(embedding, arrays_with_prefix(_WEIGHTS), features, middle)
    if data["kind"] == "network":
        return NetworkAppearance(embedding, arrays_with_prefix(_WEIGHTS), features, middle, float(data["cell"]))
    raise ValueError(f"appearance of kind {data['kind']!r}")
