"""Split a reconstruction into its unconnected pieces."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence

import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.poses.firmness import firm_pieces
from nvsim.poses.mapping import keep_only


def separated(
    model: pycolmap.Reconstruction,
    pieces: Sequence[Sequence[int]],
    others: Sequence[pycolmap.Reconstruction],
    times: NDArray[np.float64],
) -> list[pycolmap.Reconstruction]:
    """Splits reconstructions into pieces, the largest piece of `model` first, then the others by size.

    The pieces are the `pieces` of `model` (image numbers) and the firm pieces of `others` without images of `model`.
    `times` (N,) are the seconds of image numbers 1 to N. Each piece has its own unit. The first piece is `model`
    itself, without the images of the other pieces."""
    first, *rest = pieces
    found = [_only(copy.deepcopy(model), part) for part in rest]
    placed = set(model.reg_image_ids())
    for other in others:
        if not set(other.reg_image_ids()) - placed:
            continue
        for part in firm_pieces(other, times):
            left = set(part) - placed
            if left:
                found.append(_only(copy.deepcopy(other), left))
                placed |= left
    found.sort(key=lambda piece: -piece.num_reg_images())
    return [_only(model, first), *found]


def _only(model: pycolmap.Reconstruction, numbers: Iterable[int]) -> pycolmap.Reconstruction:
    keep_only(model, numbers)
    return model


def names_in(model: pycolmap.Reconstruction) -> tuple[str, ...]:
    """Names of the images with a pose, by image number."""
    return tuple(model.images[number].name for number in sorted(model.reg_image_ids()))
