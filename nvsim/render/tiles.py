"""Which splats each tile draws, nearest first: a counting sort by tile, then a radix sort by depth within each tile."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange

from nvsim.render.arithmetic import depth_key
from nvsim.render.ellipse_extent import tile_box, tile_columns
from nvsim.render.layout import DEPTH

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
    entries: Any,
) -> None:
    blocks = visible.shape[0]
    first = n * block // blocks
    cursor = cursors[block]
    for i in range(first, first + visible[block]):
        splat = splats[i]
        entry = (np.uint64(depth_key(splat[DEPTH])) << np.uint64(32)) | np.uint64(i)
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
                entries[at] = entry
                cursor[tile] = at + 1


@njit(parallel=True, cache=True, nogil=True)
def scatter(
    splats: Any, n: Any, visible: Any, wanted: Any, cursors: Any, columns: Any, lines: Any, entries: Any
) -> None:
    """Writes an entry, depth key above and row below, for every wanted tile and splat that meet; block b uses its own
    cursors, so that the order is that of the rows whatever the number of threads."""
    blocks = visible.shape[0]
    for block in prange(blocks):
        _scatter_part(block, splats, n, visible, wanted, cursors, columns, lines, entries)


@njit(forceinline=True)
def _insertion_sort(entries: Any, start: Any, end: Any) -> None:
    for i in range(start + 1, end):
        entry = entries[i]
        j = i - 1
        while j >= start and entries[j] > entry:
            entries[j + 1] = entries[j]
            j -= 1
        entries[j + 1] = entry


@njit(forceinline=True)
def _pass(source: Any, s: Any, target: Any, t: Any, n: Any, low: Any, shift: Any, count: Any) -> None:
    for d in range(257):
        count[d] = 0
    for i in range(n):
        count[(((source[s + i] - low) >> shift) & np.uint64(255)) + np.uint64(1)] += 1
    for d in range(256):
        count[d + 1] += count[d]
    for i in range(n):
        d = ((source[s + i] - low) >> shift) & np.uint64(255)
        target[t + count[d]] = source[s + i]
        count[d] += 1


@njit(error_model="numpy")
def _sort_part(thread: Any, entries: Any, offsets: Any, threads: Any, spare: Any, rows: Any) -> None:
    tiles = offsets.shape[0] - 1
    count = np.empty(257, np.int64)
    other = spare[thread]
    below = np.uint64(0xFFFFFFFF)
    for tile in range(thread, tiles, threads):
        start, end = offsets[tile], offsets[tile + 1]
        n = end - start
        if n < _SHORT:
            _insertion_sort(entries, start, end)
            for i in range(start, end):
                rows[i] = np.int32(entries[i] & below)
            continue
        low = high = entries[start]
        for i in range(start + 1, end):
            low, high = min(low, entries[i]), max(high, entries[i])
        low = low & ~below
        shift = np.uint64(32)
        while (high - low) >> shift >= np.uint64(1 << 24):
            shift += np.uint64(1)
        _pass(entries, start, other, 0, n, low, shift, count)
        _pass(other, 0, entries, start, n, low, shift + np.uint64(8), count)
        _pass(entries, start, other, 0, n, low, shift + np.uint64(16), count)
        for i in range(n):
            rows[start + i] = np.int32(other[i] & below)


@njit(parallel=True, cache=True, nogil=True)
def sort(entries: Any, offsets: Any, threads: Any, spare: Any, rows: Any) -> None:
    """Sorts every tile's entries by their key, in place and with `spare` (threads, longest tile), and writes their rows
    in that order to `rows`, int32. Keys are compared by the upper 24 bits of their range within the tile: a relative
    depth of one millionth; equal ones keep the order of the rows."""
    for thread in prange(threads):
        _sort_part(thread, entries, offsets, threads, spare, rows)
