"""The parts of a trained submap: Gaussians, background, floor texture, and appearance. Arrays only, no torch.

The background and the colors of Gaussians depend on the appearance embedding, a short vector that describes lighting
and exposure at a camera position. There are two kinds. The position embedding (paper, section III-C, camera pose
embedding) is a network of the camera position, defined everywhere. The index embedding (Splatfacto-W, Xu et al. 2024)
has one vector per training image. At other positions it is the mean of all vectors, or the vector of the nearest
training camera.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface

Float32 = NDArray[np.float32]


@dataclass(eq=False)
class Embedding:
    """An appearance embedding of one of the two kinds.

    weights   named float32 arrays. Position: layer i as "embed.i.weight" (out, in) and "embed.i.bias" (out,), with ReLU
              between the layers and none after the last. Index: "index.vectors" (V, E) and "index.positions" (V, 3),
              the training cameras in meters, world. Other names are ignored
    octaves   position: number of octaves of sines and cosines of position / `period` in the network's input. The input
              is, per axis, position / `period`, then the sine of each octave, then the cosine of each octave
    period    meters
    nearest   index: whether to use the vector of the nearest training camera instead of the mean
    """

    weights: dict[str, Float32]
    octaves: int = 4
    period: float = 5.0
    nearest: bool = False

    def at(self, position: NDArray[np.floating]) -> Float32:
        """(E,) float32: the embedding of a camera at `position` (3,), meters, world."""
        vectors = self.weights.get("index.vectors")
        if vectors is not None:
            if not self.nearest:
                return np.asarray(vectors.mean(axis=0), np.float32)
            distance = np.linalg.norm(self.weights["index.positions"] - np.asarray(position, np.float32), axis=1)
            return vectors[int(distance.argmin())]
        x = np.asarray(position, np.float32) / np.float32(self.period)
        phases = x[:, None] * (2.0 ** np.arange(self.octaves, dtype=np.float32))
        h = np.concatenate([x[:, None], np.sin(phases), np.cos(phases)], axis=1).reshape(-1)
        last = layer_count(self.weights, "embed") - 1
        for i in range(last + 1):
            h = self.weights[f"embed.{i}.weight"] @ h + self.weights[f"embed.{i}.bias"]
            if i < last:
                h = np.maximum(h, 0)
        return np.asarray(h, np.float32)


def layer_count(weights: dict[str, Float32], part: str) -> int:
    """The number of layers "part.0.weight", "part.1.weight", ... in `weights`, whose arrays can have any shape."""
    count = 0
    while f"{part}.{count}.weight" in weights:
        count += 1
    return count


@dataclass(eq=False)
class Gaussians:
    """N anisotropic Gaussians, world frame, meters; all arrays float32 and C-contiguous.

    means           (N, 3)
    log_scales      (N, 3) natural logarithm of the standard deviations in meters
    quats           (N, 4) w x y z, not necessarily of unit length
    opacity_logits  (N,)
    sh              (N, K, 3) real spherical-harmonics coefficients, K = (degree + 1)^2; color = sum + 0.5, >= 0
    """

    means: Float32
    log_scales: Float32
    quats: Float32
    opacity_logits: Float32
    sh: Float32

    def __len__(self) -> int:
        return len(self.means)

    @property
    def arrays(self) -> tuple[Float32, Float32, Float32, Float32, Float32]:
        """The fields in their order, each (N, ...)."""
        return self.means, self.log_scales, self.quats, self.opacity_logits, self.sh

    @property
    def sh_degree(self) -> int:
        return int(round(self.sh.shape[1] ** 0.5)) - 1

    @staticmethod
    def empty(sh_degree: int = 0) -> Gaussians:
        def zeros(*shape: int) -> Float32:
            return np.zeros(shape, np.float32)

        return Gaussians(zeros(0, 3), zeros(0, 3), zeros(0, 4), zeros(0), zeros(0, (sh_degree + 1) ** 2, 3))


def joined(*parts: Gaussians) -> Gaussians:
    """The Gaussians of all `parts`, one after the other. All parts have equally many coefficients of color."""
    return Gaussians(*map(np.concatenate, zip(*(part.arrays for part in parts), strict=True)))


def select_gaussians(gaussians: Gaussians, rows: NDArray[np.generic]) -> Gaussians:
    """The Gaussians in `rows`: indices (M,) or a mask (N,) bool."""
    return Gaussians(*(array[rows] for array in gaussians.arrays))


@dataclass(eq=False)
class Background:
    """The background network of the paper (section III-C): appearance embedding -> SH-4 colors.

    weights   named float32 arrays: those of the embedding, named as in `nvsim.splats.types.Embedding`; layer i of
              the trunk as "trunk.i.weight" (out, in) and "trunk.i.bias" (out,); heads "base.*" (3 outputs) and "rest.*"
              (24*3 outputs, coefficient-major); ReLU after every trunk layer
    octaves, period, nearest   parameters of the embedding
    """

    weights: dict[str, Float32]
    octaves: int = 4
    period: float = 5.0
    nearest: bool = False

    def coefficients(self, position: NDArray[np.floating]) -> Float32:
        """(25, 3) SH coefficients of the background seen from `position` (3,), meters, world. The color along a
        direction is their sum with the real SH basis, without offset or clamping."""
        h = Embedding(self.weights, self.octaves, self.period, self.nearest).at(position)
        for i in range(layer_count(self.weights, "trunk")):
            h = np.maximum(self.weights[f"trunk.{i}.weight"] @ h + self.weights[f"trunk.{i}.bias"], 0)
        base = self.weights["base.weight"] @ h + self.weights["base.bias"]
        rest = self.weights["rest.weight"] @ h + self.weights["rest.bias"]
        return np.concatenate([base[None], rest.reshape(24, 3)]).astype(np.float32)


@dataclass(eq=False)
class FloorTexture:
    """Color on the floor surface. It is added to the background at the point where a ray meets the floor. The color is
    a sum of grids over world x, y, sampled bilinearly at texel centers, with border values outside.

    levels   grids (rows, columns, 3) float32, coarse to fine; row follows y, column x
    low      (x, y) meters of the lower corner of the area (the outer edge of texel [0, 0]), shared by all levels
    high     (x, y) meters of the upper corner
    """

    levels: tuple[Float32, ...]
    low: tuple[float, float]
    high: tuple[float, float]


class Appearance(Protocol):
    """Colors of the Gaussians as a function of the camera position (paper, section III-C, camera pose embedding).

    embedding  embedding of the camera position
    weights    network weights, named float32 arrays
    features   (N, F) float32, one row per Gaussian, in their order
    middle     (3,) float64, the mean of the training cameras, meters, world
    """

    embedding: Embedding
    weights: dict[str, Float32]
    features: Float32
    middle: NDArray[np.float64]

    def colored(self, gaussians: Gaussians, position: NDArray[np.floating]) -> Gaussians:
        """`gaussians` with their SH coefficients (N, K, 3) for a camera at `position` (3,), meters, world. The other
        arrays are shared. The next call from the same thread may overwrite the result. The Gaussians' own coefficients
        must not be modified in place between calls."""
        ...

    def of_rows(self, rows: NDArray[np.generic]) -> Appearance:
        """The appearance of a subset of Gaussians. rows: (M,) indices or (N,) bool."""
        ...


@dataclass(eq=False)
class SubmapModel:
    """One trained submap: image = Gaussians + (1 - alpha) * background (paper section III-C).

    antialiased   whether the Gaussians were trained with opacity compensation and must be rendered with it
    floor         the floor surface that carries the texture
    info          JSON-able information for the user: preset, steps, seconds, metrics
    appearance    how the Gaussians' colors depend on the camera position, None if they do not
    """

    gaussians: Gaussians
    background: Background | None
    texture: FloorTexture | None
    floor: FloorSurface
    antialiased: bool = True
    info: dict[str, object] = field(default_factory=dict)
    appearance: Appearance | None = None

    def gaussians_at(self, position: NDArray[np.floating]) -> Gaussians:
        """The Gaussians with their colors for a camera at `position` (3,), meters, world."""
        return self.gaussians if self.appearance is None else self.appearance.colored(self.gaussians, position)

    def selected(self, rows: NDArray[np.generic]) -> SubmapModel:
        """The model with the Gaussians in `rows` only: indices (M,) or a mask (N,) bool."""
        appearance = None if self.appearance is None else self.appearance.of_rows(rows)
        return replace(self, gaussians=select_gaussians(self.gaussians, rows), appearance=appearance)

    def baked(self) -> Gaussians:
        """The Gaussians with one fixed set of colors, as seen from the mean of the training cameras. Used for files
        that cannot store an appearance."""
        if self.appearance is None:
            return self.gaussians
        seen = self.gaussians_at(self.appearance.middle)
        return replace(seen, sh=seen.sh.copy())
