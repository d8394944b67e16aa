"""Limit the number of Gaussians that a file may announce, and remove those that cannot be rendered.

The limit is proportional to the file size, so a small file cannot exhaust the memory.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.splats.types import Float32, Gaussians, select_gaussians

FREE, RATIO = 32 << 20, 24
"""Bytes in memory allowed for any file, and additional bytes per byte of the file. Real SOG and SPZ files need 4 to 20
per byte."""
ROWS = 1 << 14
"""Number of Gaussians decoded at a time."""


def room_for(path: Path, count: int, coefficients: int, size: int) -> Gaussians:
    """Uninitialized arrays for the `count` Gaussians that a compressed file of `size` bytes announces, with so many SH
    coefficients per color channel. Raises InputError if a file of this size cannot contain so many Gaussians."""
    needed = 4 * (11 + 3 * coefficients) * count
    if needed > FREE + RATIO * size:
        raise InputError(
            f"{path} announces {count} Gaussians, more than a file of {size} bytes can contain; it is damaged or"
            " malicious: export it again."
        )
    shapes = (count, 3), (count, 3), (count, 4), (count,), (count, coefficients, 3)
    return Gaussians(*(np.empty(shape, np.float32) for shape in shapes))


FLATTEST = 1e-7
"""Meters: the standard deviation of a Gaussian along an axis in which it is flat."""
_OPAQUE = np.float32(20)  # a logit whose opacity is 1 in float32
_FARTHEST = 1e7  # units of the file; beyond it float32 positions are coarser than a room
_SHORTEST, _LONGEST = 1e-12, 1e12  # length of a quaternion; beyond it the squares overflow or underflow in float32


def renderable_gaussians(path: Path, gaussians: Gaussians) -> tuple[Gaussians, tuple[str, ...]]:
    """The Gaussians that can be rendered, and a note for the user with the number of removed ones.

    An opacity logit of plus infinity counts as opaque, and of minus infinity as transparent. A log scale of minus
    infinity (scale 0) counts as flat along its axis. A Gaussian is removed if any other value is NaN or infinite. It is
    also removed if a position, a scale, or a color exceeds 1e7, or if the quaternion has length 0. Raises InputError if
    no Gaussian of the file `path` remains.
    """
    g = replace(
        gaussians,
        opacity_logits=_replace_values(_replace_values(gaussians.opacity_logits, np.inf, _OPAQUE), -np.inf, -_OPAQUE),
        log_scales=_replace_values(gaussians.log_scales, -np.inf, np.float32(math.log(FLATTEST))),
    )
    keep, broken, far, unturned = np.ones(len(g), bool), 0, 0, 0
    for first in range(0, len(g), ROWS):
        part = slice(first, first + ROWS)
        finite = np.isfinite(g.opacity_logits[part])
        for array in (g.means, g.log_scales, g.quats, g.sh):
            finite &= np.isfinite(array[part]).reshape(len(finite), -1).all(axis=1)
        with np.errstate(invalid="ignore"):  # NaN is counted as broken
            near = (np.abs(g.means[part]) <= _FARTHEST).all(axis=1)
            near &= (g.log_scales[part] <= math.log(_FARTHEST)).all(axis=1)
            near &= (np.abs(g.sh[part]) <= _FARTHEST).reshape(len(finite), -1).all(axis=1)
        length = np.linalg.norm(np.where(finite[:, None], g.quats[part], 1).astype(np.float64), axis=1)
        turned = (length > _SHORTEST) & (length < _LONGEST)
        broken += int((~finite).sum())
        far += int((finite & ~near).sum())
        unturned += int((finite & near & ~turned).sum())
        keep[part] = finite & near & turned
    if keep.all():
        return g, ()
    words = (
        (broken, "with values that are NaN or infinite"),
        (far, f"with values beyond {_FARTHEST:.0e}"),
        (unturned, "with a quaternion of length 0"),
    )
    why = ", ".join(f"{count} {what}" for count, what in words if count)
    if not keep.any():
        raise InputError(f"{path}: none of its {len(g)} Gaussians can be rendered ({why}); export it again.")
    left = select_gaussians(g, keep)
    return left, (f"{path}: {len(g) - len(left)} of {len(g)} Gaussians are skipped ({why}).",)


def _replace_values(array: Float32, value: float, by: NDArray[np.floating] | np.floating) -> Float32:
    found = array == value
    return np.where(found, by, array).astype(np.float32) if found.any() else array
