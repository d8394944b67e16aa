"""Semi-global smoothing of a cost volume: a change of depth has a cost along eight directions (Hirschmueller, 2008)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit

_FAR = 16000  # larger than the cost of any path


@njit(nogil=True, error_model="numpy")
def _step(
    cost: NDArray[np.uint8],
    place: np.uintp,
    before: NDArray[np.int16],
    old: np.uintp,
    after: NDArray[np.int16],
    new: np.uintp,
    total: NDArray[np.int16],
    planes: np.uintp,
    small: np.int16,
    large: np.int16,
) -> None:
    """Advance one pixel along a direction.

    Its costs start at `place` in `cost` and `total`. The costs of the previous pixel start at `old` in `before`; their
    minimum is 0, and a value larger than any path cost is on either side. The result is written at `new` in `after`.
    Three simple loops over 16-bit numbers with unsigned indices, so that LLVM vectorizes each."""
    one = np.uintp(1)
    for i in range(planes):
        d = np.uintp(i)
        left, right, same = before[old + d - one], before[old + d + one], before[old + d]
        near = np.int16((left if left < right else right) + small)
        value = same if same < near else near
        value = value if value < large else large
        after[new + d] = np.int16(value + np.int16(cost[place + d]))
    lowest = np.int16(_FAR)
    for i in range(planes):
        value = after[new + np.uintp(i)]
        lowest = value if value < lowest else lowest
    for i in range(planes):
        d = np.uintp(i)
        value = after[new + d]
        total[place + d] = np.int16(total[place + d] + value)
        after[new + d] = np.int16(value - lowest)


@njit(cache=True, nogil=True, error_model="numpy")
def smooth_cost(
    cost: NDArray[np.uint8], guide: NDArray[np.float32], small: int, large: float, fall: float
) -> NDArray[np.int16]:
    """(H, W, D) int16: `cost` (H, W, D) uint8 after smoothing. It is fastest if D is a multiple of 16.

    `small` is the cost of a change by one plane. `large` is the cost of any greater change, divided by 1 + (the step of
    `guide` (H, W) float32, gray levels) / `fall`, so that depth changes at image edges.
    """
    height, width, planes = cost.shape
    total = np.zeros((height, width, planes), np.int16)
    flat_cost, flat_total = cost.reshape(-1), total.reshape(-1)
    few = np.int16(small)
    # Paths, with padding on either side: one that starts here, two along the row, and three from each of two rows.
    room = planes + 2
    paths = np.full(room * (3 + 6 * width), _FAR, np.int16)
    paths[1 : planes + 1] = 0
    for turn in range(2):
        sign = 1 - 2 * turn
        for i in range(height):
            y = i if turn == 0 else height - 1 - i
            for j in range(width):
                x = j if turn == 0 else width - 1 - j
                for k in range(4):
                    # k = 0 along the row, 1 to 3 from the previous row: one side, straight, the other side.
                    u = x - sign if k == 0 else x + k - 2
                    v = y if k == 0 else y - sign
                    into = 1 + j % 2 if k == 0 else 3 + (i % 2 * 3 + k - 1) * width + x
                    before = 0
                    price = np.int16(0)
                    if 0 <= u < width and (k == 0 or i > 0):
                        step = abs(guide[y, x] - guide[v, u])
                        price = np.int16(max(small + 2.0, large / (1.0 + step / fall)))
                        before = 1 + (j + 1) % 2 if k == 0 else 3 + ((i + 1) % 2 * 3 + k - 1) * width + u
                    _step(
                        flat_cost,
                        np.uintp((y * width + x) * planes),
                        paths,
                        np.uintp(before * room + 1),
                        paths,
                        np.uintp(into * room + 1),
                        flat_total,
                        np.uintp(planes),
                        few,
                        price,
                    )
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def best_inverse_depth(
    total: NDArray[np.int16], inverse: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Two (H, W) float32 arrays: inverse depth in 1 / meters, and the margin of the best cost.

    The depth is the plane with the lowest cost in `total` (H, W, D), refined by a parabola through its neighbors; 0 at
    the ends of the range. `inverse` (D,) holds the inverse depths of the planes. The margin is the share by which the
    best cost is below the next best."""
    height, width, planes = total.shape
    found = np.zeros((height, width), np.float32)
    margin = np.zeros((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            here = total[y, x]
            best, lowest = 0, here[0]
            for d in range(planes):
                if here[d] < lowest:
                    lowest, best = here[d], d
            second = np.int16(32000)
            for d in range(planes):
                if abs(d - best) > 2 and here[d] < second:
                    second = here[d]
            margin[y, x] = (float(second) - float(lowest)) / max(1.0, float(second))
            if best == 0 or best == planes - 1:
                continue
            left, right = float(here[best - 1]), float(here[best + 1])
            bend = left + right - 2 * float(lowest)
            offset = 0.5 * (left - right) / bend if bend > 0 else 0.0
            found[y, x] = inverse[best] + offset * (inverse[1] - inverse[0])
    return found, margin
