"""Limits the number of rendered Gaussians on slow machines: keeps those that cover most area. Does not use Qt."""

from __future__ import annotations

import weakref
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nvsim.splats.types import Gaussians, SubmapModel


def covering_most(gaussians: Gaussians, count: int) -> NDArray[np.int64]:
    """(M,) rows of the `count` Gaussians that cover the largest area, in ascending order; all rows if there are fewer.
    The covered area is the product of the two largest extents and the opacity."""
    if len(gaussians) <= count:
        return np.arange(len(gaussians))
    two_largest = np.sort(gaussians.log_scales, axis=1)[:, 1:].sum(axis=1)
    cover = two_largest - np.log1p(np.exp(-gaussians.opacity_logits))
    return np.sort(np.argpartition(-cover, count)[:count])


def chosen(gaussians: Gaussians, rows: NDArray[np.generic]) -> Gaussians:
    """The Gaussians in `rows`: indices (M,) or a mask (N,)."""
    g = gaussians
    return Gaussians(g.means[rows], g.log_scales[rows], g.quats[rows], g.opacity_logits[rows], g.sh[rows])


@dataclass
class _Thinned:
    of: weakref.ref[SubmapModel]
    count: int
    model: SubmapModel


class SplatBudget:
    """Limits the number of Gaussians of a model. Caches the last result, which a moving camera needs repeatedly."""

    def __init__(self) -> None:
        self._last: _Thinned | None = None

    def within(self, model: SubmapModel, count: int) -> SubmapModel:
        """`model` with at most `count` Gaussians; 0 means all."""
        if count <= 0 or len(model.gaussians) <= count:
            return model
        last = self._last
        if last is None or last.of() is not model or last.count != count:
            rows = covering_most(model.gaussians, count)
            appearance = model.appearance
            if appearance is not None:
                appearance = appearance.of_rows(rows)
            thinned = replace(model, gaussians=chosen(model.gaussians, rows), appearance=appearance)
            last = self._last = _Thinned(weakref.ref(model), count, thinned)
        return last.model
