"""Which splats each tile draws, nearest first: a counting sort by tile, then a radix sort by depth within each tile."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange

from nvsim.render.arithmetic import depth_key
from nvsim.render.layout import DEPTH
from nvsim.render.spans import tile_box, tile_columns

_SHORT = 24
"""Below this length an insertion sort wins."""


@njit(cache=True)
def starts(tile_counts: Any, offsets: Any) -> Any:
    """Turns `tile_counts` (blocks, tiles) into where each block writes its first entry of each tile, and `offsets`
    (tiles + 1,) int64 into where each tile begins. Returns the total and the longest tile."""
    blocks, tiles = tile_counts.shape
    total = np.int64(0)
    longest = np.int64(0)
    for tile in range(tiles):
        offsets[tile] = total
        for block in range(blocks):
            count = tile_counts[block, tile]
            tile_counts[block, tile] = total
            total += count
        longest = max(longest, total - offsets[tile])
    offsets[tiles] = total
    return total, longest


@njit(error_model="numpy")
def _scatter_part(
    block: Any,
    splats: Any,
    n: Any,
    visible: Any,
    wanted: Any,
    cursors: Any,
    columns: Any,
    lines: Any,
    keys: Any,
    rows: Any,
) -> None:
    blocks = visible.shape[0]
    first = n * block // blocks
    cursor = cursors[block]
    for i in range(first, first + visible[block]):
        splat = splats[i]
        key = depth_key(splat[DEPTH])
        low, high, left, right = tile_box(splat, columns, lines)
        exact = high - low > 1 and right - left > 1
        for line in range(low, high):
            begin, stop = left, right
            if exact:
                begin, stop = tile_columns(splat, line, left, right)
            for tile in range(line * columns + begin, line * columns + stop):
                if not wanted[tile]:
                    continue
                at = cursor[tile]
                keys[at] = key
                rows[at] = i
                cursor[tile] = at + 1


@njit(parallel=True, cache=True, nogil=True)
def scatter(
    splats: Any, n: Any, visible: Any, wanted: Any, cursors: Any, columns: Any, lines: Any, keys: Any, rows: Any
) -> None:
    """Writes (depth key, row) of every wanted tile and splat that meet; block b uses its own cursors, so that the
    order is that of the rows whatever the number of threads."""
    blocks = visible.shape[0]
    for block in prange(blocks):
        _scatter_part(block, splats, n, visible, wanted, cursors, columns, lines, keys, rows)


@njit(forceinline=True)
def _insertion_sort(keys: Any, rows: Any, start: Any, end: Any) -> None:
    for i in range(start + 1, end):
        key, row = keys[i], rows[i]
        j = i - 1
        while j >= start and keys[j] > key:
            keys[j + 1], rows[j + 1] = keys[j], rows[j]
            j -= 1
        keys[j + 1], rows[j + 1] = key, row


@njit(forceinline=True)
def _pass(
    source: Any,
    source_rows: Any,
    s: Any,
    target: Any,
    target_rows: Any,
    t: Any,
    n: Any,
    low: Any,
    shift: Any,
    count: Any,
) -> None:
    for d in range(257):
        count[d] = 0
    for i in range(n):
        count[(((source[s + i] - low) >> shift) & np.uint32(255)) + 1] += 1
    for d in range(256):
        count[d + 1] += count[d]
    for i in range(n):
        d = ((source[s + i] - low) >> shift) & np.uint32(255)
        at = t + count[d]
        count[d] += 1
        target[at] = source[s + i]
        target_rows[at] = source_rows[s + i]


@njit(error_model="numpy")
def _sort_part(
    thread: Any, keys: Any, rows: Any, offsets: Any, longest: Any, threads: Any, spare_keys: Any, spare_rows: Any
) -> None:
    tiles = offsets.shape[0] - 1
    count = np.empty(257, np.int64)
    other, other_rows = spare_keys[thread], spare_rows[thread]
    for tile in range(thread, tiles, threads):
        start, end = offsets[tile], offsets[tile + 1]
        n = end - start
        if n < _SHORT:
            _insertion_sort(keys, rows, start, end)
            continue
        low = high = keys[start]
        for i in range(start + 1, end):
            low, high = min(low, keys[i]), max(high, keys[i])
        shift = np.uint32(0)
        while (high - low) >> shift >= np.uint32(1 << 24):
            shift += np.uint32(1)
        _pass(keys, rows, start, other, other_rows, 0, n, low, shift, count)
        _pass(other, other_rows, 0, keys, rows, start, n, low, shift + np.uint32(8), count)
        _pass(keys, rows, start, other, other_rows, 0, n, low, shift + np.uint32(16), count)
        for i in range(n):
            rows[start + i] = other_rows[i]


@njit(parallel=True, cache=True, nogil=True)
def sort(keys: Any, rows: Any, offsets: Any, longest: Any, threads: Any, spare_keys: Any, spare_rows: Any) -> None:
    """Sorts every tile's entries by key, in place. `spare_*` are (threads, longest). Keys are compared by the upper
    24 bits of their range within the tile: a relative depth of one millionth."""
    for thread in prange(threads):
        _sort_part(thread, keys, rows, offsets, longest, threads, spare_keys, spare_rows)
