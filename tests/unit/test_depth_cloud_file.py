"""The fused cloud as a file that other readers open, and that a damaged project cannot misuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.capture.findings import Findings
from nvsim.capture.pointcloud import read_cloud
from nvsim.depth.cloud_file import as_cloud, read_cloud_file, write_cloud
from nvsim.depth.fusion import FusedCloud
from nvsim.errors import InputError


def fused(count: int = 50, seed: int = 0) -> FusedCloud:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return FusedCloud(
        rng.uniform(-9, 9, (count, 3)).astype(np.float32),
        rng.integers(0, 256, (count, 3), dtype=np.uint8),
        normals.astype(np.float32),
        rng.integers(3, 65536, count).astype(np.uint16),
    )


@pytest.mark.parametrize("count", [0, 1, 50])
def test_what_is_written_is_read_bit_by_bit(count: int, tmp_path: Path) -> None:
    cloud = fused(count)
    write_cloud(tmp_path / "cloud.ply", cloud)
    again = read_cloud_file(tmp_path / "cloud.ply")
    for name in ("points", "colors", "normals", "views"):
        expected, found = getattr(cloud, name), getattr(again, name)
        assert found.dtype == expected.dtype and np.array_equal(found, expected), name


def test_the_reader_of_captures_opens_it_too(tmp_path: Path) -> None:
    cloud = fused()
    write_cloud(tmp_path / "cloud.ply", cloud)
    found = read_cloud(tmp_path / "cloud.ply", Findings(), "images")
    assert np.array_equal(found.points, cloud.points) and np.array_equal(found.colors, cloud.colors)
    assert found.is_dense and as_cloud(cloud).kind == "images"


def test_a_cloud_that_is_cut_off_foreign_or_not_finite_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    write_cloud(path, fused())
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])
    with pytest.raises(InputError, match="truncated"):
        read_cloud_file(path)
    path.write_bytes(whole.replace(b"ushort views", b"short  views"))
    with pytest.raises(InputError, match="not a cloud of depth maps; run `nvsim depth"):
        read_cloud_file(path)
    path.write_bytes(whole.replace(b"element vertex 50", b"element vertex 99999999999"))
    with pytest.raises(InputError):
        read_cloud_file(path)
    broken = fused()
    broken.points[7, 1] = np.nan
    write_cloud(path, broken)
    with pytest.raises(InputError, match="invalid points"):
        read_cloud_file(path)
    with pytest.raises(InputError, match="no.ply"):
        read_cloud_file(tmp_path / "no.ply")


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 1100), st.binary(min_size=1, max_size=9))
def test_any_damage_is_read_or_refused(at: int, bytes_there: bytes) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "cloud.ply"
        write_cloud(path, fused(20))
        data = bytearray(path.read_bytes())
        data[at : at + len(bytes_there)] = bytes_there
        path.write_bytes(bytes(data))
        try:
            assert len(read_cloud_file(path).points) <= 20
        except InputError as error:
            assert "cloud.ply" in str(error)
