"""Draws some Gaussians of a model in flat colors, or hides them. Does not use Qt."""

from __future__ import annotations

import weakref
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.splats.harmonics import DC
from nvsim.splats.types import SubmapModel
from nvsim_app.look import colors

Mark = Literal["hidden", "floater", "outside", "by hand", "selected"]
COLORS: dict[Mark, str] = {
    "floater": colors.BLOCKED,
    "outside": colors.SUBMAPS[0],
    "by hand": colors.AGENT,
    "selected": colors.SELECTED,
}
"""Mark -> #rrggbb of the Gaussians with this mark. The other marks hide Gaussians."""
MARKS: tuple[Mark, ...] = ("hidden", *COLORS)
_INVISIBLE = -30.0  # opacity logit of hidden Gaussians
_LEAST = 0.0  # opacity logit of marked Gaussians, at least, so that the color of fog is visible


@dataclass(frozen=True, eq=False)
class Marks:
    """The marked Gaussians of a model.

    number  differs for different marks
    rows    (M,) int32, rows of Gaussians
    codes   (M,) uint8, the mark of each as an index in MARKS
    """

    number: int
    rows: NDArray[np.int32]
    codes: NDArray[np.uint8]


class MarkedModel:
    """Makes models with marks. Keeps the last one, which a moving camera needs repeatedly."""

    def __init__(self) -> None:
        self._last: tuple[weakref.ref[SubmapModel], int, SubmapModel] | None = None

    def of(self, model: SubmapModel, marks: Marks) -> SubmapModel:
        """The model in which the marked Gaussians have the color of their mark or are hidden."""
        last = self._last
        if last is None or last[0]() is not model or last[1] != marks.number:
            last = self._last = weakref.ref(model), marks.number, _with_marks(model, marks)
        return last[2]


def _with_marks(model: SubmapModel, marks: Marks) -> SubmapModel:
    g, hidden = model.gaussians, marks.codes == MARKS.index("hidden")
    rows, logits, sh = marks.rows, g.opacity_logits.copy(), g.sh.copy()
    logits[rows] = np.where(hidden, _INVISIBLE, np.maximum(logits[rows], _LEAST))
    sh[rows] = 0
    sh[rows, 0] = _COEFFICIENTS[marks.codes]
    return replace(model, gaussians=replace(g, opacity_logits=logits, sh=sh))


def _coefficients(color: str) -> list[float]:
    return [(int(color[i : i + 2], 16) / 255 - 0.5) / DC for i in (1, 3, 5)]


_COEFFICIENTS = np.array([[0.0] * 3, *map(_coefficients, COLORS.values())], np.float32)
