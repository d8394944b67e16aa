"""Check that the arrays of a loaded submap model fit together, so that rendering it cannot fail."""

from __future__ import annotations

import math

import numpy as np

from nvsim.splats.types import Gaussians, SubmapModel

_MOST_OCTAVES = 64


def check_model(model: SubmapModel) -> None:
    """Raises ValueError, or the error that numpy raises if shapes do not fit together."""
    floor = model.floor
    if floor.heights.ndim != 2 or floor.heights.size == 0 or not floor.spacing > 0:
        raise ValueError(f"a floor of shape {floor.heights.shape}")
    _check_finite("floor", floor.heights, *floor.origin, floor.spacing)
    if model.texture is not None:
        for level in model.texture.levels:
            if level.ndim != 3 or level.shape[2] != 3 or level.size == 0:
                raise ValueError(f"a floor texture of shape {level.shape}")
        _check_finite("floor texture", *model.texture.levels, *model.texture.low, *model.texture.high)
    middle = np.zeros(3)
    if model.background is not None:
        _check_embedding(model.background.octaves, model.background.period)
        _check_finite("background", *model.background.weights.values())
        if _embeds(model.background.weights):
            model.background.coefficients(middle)
    if model.appearance is not None:
        embedding = model.appearance.embedding
        _check_embedding(embedding.octaves, embedding.period)
        _check_finite("appearance", *embedding.weights.values(), *model.appearance.weights.values())
        _check_finite("appearance", model.appearance.features, model.appearance.middle)
        if len(model.gaussians) and _embeds(embedding.weights):
            g, first = model.gaussians, slice(0, 1)
            one = Gaussians(*(a[first] for a in (g.means, g.log_scales, g.quats, g.opacity_logits, g.sh)))
            model.appearance.of_rows(np.array([0])).coloured(one, model.appearance.middle)


def _embeds(weights: dict[str, np.ndarray]) -> bool:
    return "embed.0.weight" in weights or "index.vectors" in weights


def _check_embedding(octaves: int, period: float) -> None:
    if not 0 <= octaves <= _MOST_OCTAVES or not 0 < period < math.inf:
        raise ValueError(f"an embedding of {octaves} octaves and period {period}")


def _check_finite(what: str, *arrays: object) -> None:
    if not all(np.isfinite(array).all() for array in arrays):  # type: ignore[call-overload]
        raise ValueError(f"a {what} with values that are not finite")
