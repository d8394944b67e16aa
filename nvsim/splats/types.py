"""What a trained submap consists of: Gaussians, a background, a floor texture, an appearance. Arrays only, no torch."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.embedding import Embedding, layer_count

Float32 = NDArray[np.float32]


@dataclass(eq=False)
class Gaussians:
    """N anisotropic Gaussians, world frame, metres; all arrays float32 and C-contiguous.

    means           (N, 3)
    log_scales      (N, 3) natural logarithm of the standard deviations in metres
    quats           (N, 4) w x y z, not necessarily of unit length
    opacity_logits  (N,)
    sh              (N, K, 3) real spherical-harmonics coefficients, K = (degree + 1)^2; colour = sum + 0.5, >= 0
    """

    means: Float32
    log_scales: Float32
    quats: Float32
    opacity_logits: Float32
    sh: Float32

    def __len__(self) -> int:
        return len(self.means)

    @property
    def sh_degree(self) -> int:
        return int(round(self.sh.shape[1] ** 0.5)) - 1

    @staticmethod
    def empty(sh_degree: int = 0) -> Gaussians:
        def zeros(*shape: int) -> Float32:
            return np.zeros(shape, np.float32)

        return Gaussians(zeros(0, 3), zeros(0, 3), zeros(0, 4), zeros(0), zeros(0, (sh_degree + 1) ** 2, 3))


@dataclass(eq=False)
class Background:
    """The background network of the paper (section III-C): appearance embedding -> SH-4 colours.

    weights   named float32 arrays: those of the embedding as `nvsim.splats.embedding.Embedding` names them, layer i of
              the trunk as "trunk.i.weight" (out, in) and "trunk.i.bias" (out,), heads "base.*" (3 outputs) and "rest.*"
              (24*3 outputs, coefficient-major); ReLU after every trunk layer
    octaves, period, nearest   of the embedding
    """

    weights: dict[str, Float32]
    octaves: int = 4
    period: float = 5.0
    nearest: bool = False

    def coefficients(self, position: NDArray[np.floating]) -> Float32:
        """(25, 3) SH coefficients of the background seen from `position` (3,); the colour along a direction is their
        sum with the real SH basis, without shift and clamp."""
        h = Embedding(self.weights, self.octaves, self.period, self.nearest).at(position)
        for i in range(layer_count(self.weights, "trunk")):
            h = np.maximum(self.weights[f"trunk.{i}.weight"] @ h + self.weights[f"trunk.{i}.bias"], 0)
        base = self.weights["base.weight"] @ h + self.weights["base.bias"]
        rest = self.weights["rest.weight"] @ h + self.weights["rest.bias"]
        return np.concatenate([base[None], rest.reshape(24, 3)]).astype(np.float32)


@dataclass(eq=False)
class FloorTexture:
    """Colour on the floor surface, added to the background where a ray meets the floor: a sum of grids over world
    x, y, sampled bilinearly at texel centres, border values outside.

    levels   grids (rows, columns, 3) float32, coarse to fine; row follows y, column x
    low      (x, y) metres of the lower corner of the area (the outer edge of texel [0, 0]), shared by all levels
    high     (x, y) metres of the upper corner
    """

    levels: tuple[Float32, ...]
    low: tuple[float, float]
    high: tuple[float, float]


class Appearance(Protocol):
    """What colours the Gaussians have by the position of the camera (paper, section III-C, camera pose embedding).

    embedding  what the colours depend on
    weights    of the network, named float32 arrays
    features   (N, F) float32, one row per Gaussian, in their order
    middle     (3,) float64, the mean of the training cameras, metres, world
    """

    embedding: Embedding
    weights: dict[str, Float32]
    features: Float32
    middle: NDArray[np.float64]

    def coloured(self, gaussians: Gaussians, position: NDArray[np.floating]) -> Gaussians:
        """`gaussians` with the SH coefficients that they have seen from `position` (3,); the other arrays are shared.
        What is returned may be overwritten by the next call from the same thread. The Gaussians' own coefficients must
        not be changed in place between calls."""
        ...

    def of_rows(self, rows: NDArray[np.generic]) -> Appearance:
        """The appearance of the Gaussians in `rows` alone."""
        ...


@dataclass(eq=False)
class SubmapModel:
    """One trained submap: image = Gaussians + (1 - alpha) * background (paper section III-C).

    antialiased   whether the Gaussians were fitted with opacity compensation and must be drawn so
    floor         the floor surface that the texture lies on
    info          what a user may want to know: preset, steps, seconds, figures. JSON-able
    appearance    how the Gaussians' colours depend on the camera position, None where they do not
    """

    gaussians: Gaussians
    background: Background | None
    texture: FloorTexture | None
    floor: FloorSurface
    antialiased: bool = True
    info: dict[str, object] = field(default_factory=dict)
    appearance: Appearance | None = None

    def gaussians_at(self, position: NDArray[np.floating]) -> Gaussians:
        """The Gaussians with the colours that they have seen from `position` (3,)."""
        return self.gaussians if self.appearance is None else self.appearance.coloured(self.gaussians, position)

    def baked(self) -> Gaussians:
        """The Gaussians with one set of colours, those seen from the middle of the training cameras: what a file holds
        that knows nothing of appearance."""
        if self.appearance is None:
            return self.gaussians
        seen = self.gaussians_at(self.appearance.middle)
        return replace(seen, sh=seen.sh.copy())
