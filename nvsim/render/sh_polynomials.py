"""A background of spherical harmonics up to degree 4 as two polynomials in the pixel, at a third of the cost of the
basis.

A harmonic of degree l is a homogeneous polynomial of degree l. So along the ray D = (u, v, 1), of length |D| = 1/n, it
is n^l Y_l(D). With |D|^2 = u^2 + v^2 + 1 the even degrees share the factor n^4 and the odd ones n^3:

    color(u, v) = n^4 E(u, v) + n^3 O(u, v)

E has degree 4 (15 terms) and O has degree 3 (10 terms). This is a change of basis of the 25 coefficients, one per
camera orientation. Along a row of pixels v is constant, which leaves nine numbers per channel.
"""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit
from nvsim.render.kernel_types import Float32
from nvsim.splats import harmonics

COEFFICIENTS = 25
ROW = 9
"""Number of values per channel of one row: of u^0 to u^4 in E, then of u^0 to u^3 in O."""
EXPONENTS = tuple((i, j) for degree in (4, 3) for i in range(degree + 1) for j in range(degree + 1 - i))
"""(i, j) of the 25 terms u^i v^j, those of E first."""
_F = np.float32


def change_of_basis(rotation: NDArray[np.floating]) -> NDArray[np.float64]:
    """The (25, 25) matrix from the coefficients of the harmonics to those of the terms. `rotation` (3, 3) is camera to
    world, with the camera looking along +z."""
    return _change_of_basis(np.ascontiguousarray(rotation, np.float64).tobytes())


@lru_cache(maxsize=512)  # training uses each view repeatedly, twice per step
def _change_of_basis(rotation: bytes) -> NDArray[np.float64]:
    directions, inverse = _samples()
    x, y, z = np.frombuffer(rotation).reshape(3, 3) @ directions
    changed = inverse @ np.stack(harmonics.terms(x, y, z), axis=1)
    changed.flags.writeable = False
    return np.asarray(changed, np.float64)


@cache
def _samples() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    # Directions in front of the camera, and the matrix from function values there to terms.
    u, v = (a.reshape(-1) for a in np.meshgrid(np.linspace(-1.2, 1.2, 9), np.linspace(-1.2, 1.2, 9)))
    n = 1 / np.sqrt(u * u + v * v + 1)
    terms = [u**i * v**j * (n**4 if k < 15 else n**3) for k, (i, j) in enumerate(EXPONENTS)]
    return np.stack([u * n, v * n, n]), np.linalg.pinv(np.stack(terms, axis=1))


@njit(inline="always")
def row_numbers(
    terms: Float32,  # (25, 3) the coefficients after `change_of_basis`
    v: np.float32,  # y of the row over z, in the camera's frame
    channel: int,  # of red, green and blue
) -> tuple[np.float32, ...]:
    """The nine numbers of a row and channel; `terms` (25, 3) float32 from `change_of_basis`."""
    t, c = terms, channel
    return (
        t[0, c] + v * (t[1, c] + v * (t[2, c] + v * (t[3, c] + v * t[4, c]))),
        t[5, c] + v * (t[6, c] + v * (t[7, c] + v * t[8, c])),
        t[9, c] + v * (t[10, c] + v * t[11, c]),
        t[12, c] + v * t[13, c],
        t[14, c],
        t[15, c] + v * (t[16, c] + v * (t[17, c] + v * t[18, c])),
        t[19, c] + v * (t[20, c] + v * t[21, c]),
        t[22, c] + v * t[23, c],
        t[24, c],
    )
