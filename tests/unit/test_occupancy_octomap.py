"""OctoMap files of both kinds: whole ones, other kinds of trees, and damaged ones."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from octomap_samples import binary_tree, full_tree

from nvsim.errors import InputError
from nvsim.occupancy.octomap import read_octomap, read_tree
from nvsim.occupancy.read import read_map
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, Heights

Voxel = tuple[int, int, int]


def painted(leaves: np.ndarray) -> dict[Voxel, int]:
    found = {}
    for x, y, z, size, state in leaves.tolist():
        for i, j, k in np.ndindex(size, size, size):
            found[x + i, y + j, z + k] = state
    return found


def written(folder: Path) -> tuple[Path, Path]:
    (folder / "m.ot").write_bytes(full_tree())
    (folder / "m.bt").write_bytes(binary_tree())
    return folder / "m.ot", folder / "m.bt"


def test_the_tree_with_log_odds_is_that_without(tmp_path: Path) -> None:
    full, binary = (read_tree(path) for path in written(tmp_path))
    assert full.resolution == binary.resolution == 0.25
    assert painted(full.leaves) == painted(binary.leaves)
    assert {FREE, OCCUPIED} == set(painted(full.leaves).values())


@pytest.mark.parametrize("heights", [Heights(), Heights(0.25, 0.5), Heights(-9, 9), Heights(0.6, 0.7)])
def test_a_slice_has_what_its_voxels_have(tmp_path: Path, heights: Heights) -> None:
    voxels = painted(read_tree(written(tmp_path)[0]).leaves)
    low = heights.from_height / 0.25 + (1 << 15) - 2  # the floor is named below
    high = low + (heights.to_height - heights.from_height) / 0.25
    expected = {}
    for (x, y, z), state in voxels.items():
        if z + 1 > low and z < high:
            expected[x, y] = max(state, expected.get((x, y), int(FREE)))
    for path in written(tmp_path):
        found = read_octomap(path, heights, floor=-0.5)
        rows, columns = np.nonzero(found.cells != UNKNOWN)
        corner = np.round(np.array(found.origin) / 0.25).astype(int) + (1 << 15)
        assert {
            (int(c + corner[0]), int(r + corner[1])): int(found.cells[r, c]) for r, c in zip(rows, columns, strict=True)
        } == expected


def colored(data: bytes) -> bytes:
    """The same tree as a colored one: three bytes more in each node."""
    head, _, body = data.partition(b"\ndata\n")
    nodes = [body[i : i + 4] + b"\x10\x20\x30" + body[i + 4 : i + 5] for i in range(0, len(body), 5)]
    return head.replace(b"id OcTree", b"id ColorOcTree") + b"\ndata\n" + b"".join(nodes)


def test_a_colored_tree_is_read_and_other_kinds_are_refused(tmp_path: Path) -> None:
    plain = read_map(written(tmp_path)[0])
    path = tmp_path / "coloured.ot"
    path.write_bytes(colored(full_tree()))
    assert np.array_equal(read_map(path).cells, plain.cells)
    path.write_bytes(full_tree().replace(b"id OcTree", b"id CountingOcTree"))
    with pytest.raises(InputError, match="CountingOcTree"):
        read_map(path)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_log_odds_that_are_no_number_are_refused(tmp_path: Path, value: float) -> None:
    head, _, body = full_tree().partition(b"\ndata\n")
    path = tmp_path / "m.ot"
    path.write_bytes(head + b"\ndata\n" + struct.pack("<f", value) + body[4:])
    with pytest.raises(InputError, match="not finite"):
        read_map(path)


@pytest.mark.parametrize("cut", [1, 4, 100, 3000])
def test_a_torn_tree_is_refused(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "m.ot"
    path.write_bytes(full_tree()[:-cut])
    with pytest.raises(InputError, match="middle of the tree"):
        read_map(path)


@settings(max_examples=120)
@given(st.booleans(), st.integers(0, 4000), st.binary(min_size=1, max_size=4), st.integers(0, 4000))
def test_any_damage_is_a_map_or_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, full: bool, at: int, bytes_: bytes, length: int
) -> None:
    data = full_tree() if full else binary_tree()
    at %= len(data)
    path = tmp_path_factory.mktemp("damage") / ("m.ot" if full else "m.bt")
    path.write_bytes((data[:at] + bytes_ + data[at + len(bytes_) :])[: max(length, 1)])
    try:
        found = read_map(path)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert set(np.unique(found.cells)) <= {FREE, OCCUPIED, UNKNOWN}
