"""Convert between our Gaussians and those of the gsply library, which implements compressed PLY and SPZ."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from nvsim.errors import InputError
from nvsim.splats.types import Gaussians

if TYPE_CHECKING:
    from gsply import GSData

T = TypeVar("T")


def guarded(path: Path, call: Callable[[], T]) -> T:
    """Returns the result of `call`. Raises InputError if the library fails because the file is damaged."""
    try:
        return call()
    except (ValueError, KeyError, IndexError, OverflowError, EOFError, OSError, RuntimeError, ArithmeticError) as error:
        raise InputError(f"{path} is damaged ({error}); export it again.") from error
    except Exception as error:
        if type(error).__module__.partition(".")[0] in ("zlib", "struct", "zstandard", "gsply"):
            raise InputError(f"{path} is damaged ({error}); export it again.") from error
        raise


def from_library(data: GSData) -> Gaussians:
    """Our Gaussians. Values that are not finite are kept."""
    n = len(data.means)
    higher = np.zeros((n, 0, 3), np.float32) if data.shN is None else np.asarray(data.shN, np.float32)
    sh = np.concatenate([np.asarray(data.sh0, np.float32).reshape(n, 1, 3), higher.reshape(n, -1, 3)], axis=1)
    return Gaussians(
        np.ascontiguousarray(data.means, np.float32),
        np.ascontiguousarray(data.scales, np.float32),
        np.ascontiguousarray(data.quats, np.float32),
        np.ascontiguousarray(data.opacities, np.float32).reshape(-1),
        np.ascontiguousarray(sh),
    )


def to_library(gaussians: Gaussians) -> GSData:
    """The Gaussians in the library's PLY convention: log scales, logit opacities, unit quaternions w x y z."""
    import gsply

    g = gaussians
    length = np.linalg.norm(g.quats, axis=1, keepdims=True)
    unit = np.where(length > 0, g.quats / np.maximum(length, 1e-20), np.array([1, 0, 0, 0], np.float32))
    # Byte formats store opacities of 1/255 and more. Logits beyond this range would only overflow.
    return gsply.GSData(
        g.means.copy(),
        np.clip(g.log_scales, -20, 20),
        unit.astype(np.float32),
        np.clip(g.opacity_logits, -20, 20),
        np.ascontiguousarray(g.sh[:, 0]),
        np.ascontiguousarray(g.sh[:, 1:]),
    )
