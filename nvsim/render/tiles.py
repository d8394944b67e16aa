"""Lists the splats of each tile, nearest first: a counting sort by tile, then a radix sort by depth within each
tile."""

from __future__ import annotations

import numpy as np

from nvsim.kernels import njit, prange
from nvsim.render.arithmetic import depth_key
from nvsim.render.ellipse_extent import tile_box, tile_columns
from nvsim.render.kernel_types import DEPTH, Float32, Int32, Int64, Mask, UInt64, Whole

_SHORT = 24
"""Length below which an insertion sort is faster."""


@njit(cache=True)
def find_tile_starts(
    tile_counts: Int32,  # (blocks, tiles) in: entries; out: position of the block's first entry of the tile
    offsets: Int64,  # (tiles + 1,) out: start of each tile
) -> tuple[np.int64, np.int64]:
    """Arranges the entries tile by tile, and those of a tile block by block: writes `offsets` (tiles + 1,). Returns the
    total number of entries and the length of the longest tile."""
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
    block: int,
    splats: Float32,  # as in `scatter`, like all following
    n: int,
    visible: Int32,
    wanted: Mask,
    cursors: Int32,
    columns: int,
    lines: int,
    entries: UInt64,
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
    splats: Float32,  # (N, 16) of `projection.project`, columns as in render.layout
    n: int,  # N
    visible: Int32,  # (blocks,) rows of each block of splats
    wanted: Mask,  # (tiles,) requested tiles, row by row
    cursors: Int32,  # (blocks, tiles) of `find_tile_starts`, changed
    columns: int,  # tiles in a row of the image
    lines: int,  # rows of tiles
    entries: UInt64,  # (entries or more,) out
) -> None:
    """Writes an entry to `entries` (entries or more,) for every requested tile and splat that meet: depth key above,
    row below. Each block has its own cursors, so the order is that of the rows with any number of threads."""
    blocks = visible.shape[0]
    for block in prange(blocks):
        _scatter_part(block, splats, n, visible, wanted, cursors, columns, lines, entries)


@njit(forceinline=True)
def _insertion_sort(entries: UInt64, start: Whole, end: Whole) -> None:
    for i in range(start + 1, end):
        entry = entries[i]
        j = i - 1
        while j >= start and entries[j] > entry:
            entries[j + 1] = entries[j]
            j -= 1
        entries[j + 1] = entry


@njit(forceinline=True)
def _pass(
    source: UInt64,
    s: Whole,  # first entry of source
    target: UInt64,
    t: Whole,  # first entry of target
    n: Whole,  # entries
    low: np.uint64,  # subtracted before the shift
    shift: np.uint64,  # number of bits below the eight bits of the sort key
    count: Int64,  # (257,) scratch
) -> None:
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
def _sort_part(
    thread: int,
    entries: UInt64,  # as in `sort`, like all following
    offsets: Int64,
    threads: int,
    spare: UInt64,
    rows: Int32,
) -> None:
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
def sort(
    entries: UInt64,  # (entries or more,) of `scatter`, sorted in place
    offsets: Int64,  # (tiles + 1,) of `find_tile_starts`
    threads: int,  # number of tasks that share the tiles
    spare: UInt64,  # (threads, longest tile or more) scratch
    rows: Int32,  # (entries or more,) out: rows of splats, nearest first in every tile
) -> None:
    """Sorts the entries of every tile by their key and writes their rows in that order to `rows` (entries or more,).
    Keys are compared by the upper 24 bits of their range within the tile: a relative depth of one millionth. Equal keys
    keep the order of the rows."""
    for thread in prange(threads):
        _sort_part(thread, entries, offsets, threads, spare, rows)
