"""Point cloud files: every encoding gives the same points, and errors name the damaged file."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.capture.findings import Findings
from nvsim.capture.pointcloud import lzf_decompress, merge, read_cloud
from nvsim.capture.types import Cloud
from nvsim.errors import InputError

RNG = np.random.default_rng(0)
POINTS = RNG.normal(size=(50, 3)).astype(np.float32)
COLORS = RNG.integers(0, 256, (50, 3)).astype(np.uint8)


def ply_header(order: str, extra: str = "", count: int = 50) -> bytes:
    return (
        f"ply\nformat {order} 1.0\ncomment made by a test\nelement vertex {count}\nproperty double x\n{extra}"
        "property float y\nproperty float32 z\nproperty uchar red\nproperty uchar green\nproperty uint8 blue\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()


def ply_file(order: str) -> bytes:
    """An unrelated property between x and y, and a face after the points."""
    head = ply_header(order, "property short weight\n")
    if order == "ascii":
        rows = [f"{p[0]!r} -7 {p[1]!r} {p[2]!r} {c[0]} {c[1]} {c[2]}" for p, c in zip(POINTS.tolist(), COLORS.tolist())]
        return head + "\n".join([*rows, "3 0 1 2", ""]).encode()
    sign = "<" if "little" in order else ">"
    body = b"".join(struct.pack(f"{sign}dhff3B", p[0], -7, p[1], p[2], *c) for p, c in zip(POINTS, COLORS.tolist()))
    return head + body + struct.pack(f"{sign}Biii", 3, 0, 1, 2)


def lzf_literal(data: bytes) -> bytes:
    """Valid LZF without back references."""
    return b"".join(bytes([len(data[i : i + 32]) - 1]) + data[i : i + 32] for i in range(0, len(data), 32))


def pcd_file(mode: str, count: int = 50) -> bytes:
    packed = (COLORS.astype(np.uint32) << np.array([16, 8, 0], np.uint32)).sum(axis=1).astype(np.uint32)
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z normal rgb\nSIZE 4 4 4 4 4\nTYPE F F F F U\nCOUNT 1 1 1 2 1\n"
        f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA {mode}\n"
    ).encode()
    if mode == "ascii":
        rows = [f"{p[0]!r} {p[1]!r} {p[2]!r} 0 1 {c}" for p, c in zip(POINTS.tolist(), packed)]
        return head + "\n".join(rows).encode()
    if mode == "binary":
        return head + b"".join(struct.pack("<5fI", *p, 0, 1, c) for p, c in zip(POINTS, packed.tolist()))
    columns = b"".join(POINTS[:, i].tobytes() for i in range(3)) + np.zeros(100, "<f4").tobytes() + packed.tobytes()
    compressed = lzf_literal(columns)
    return head + struct.pack("<II", len(compressed), len(columns)) + compressed


FILES = {
    **{f"ply {o}": ply_file(o) for o in ("ascii", "binary_little_endian", "binary_big_endian")},
    **{f"pcd {m}": pcd_file(m) for m in ("ascii", "binary", "binary_compressed")},
}


@pytest.mark.parametrize("kind", FILES)
def test_every_encoding_gives_the_same_points_and_colors(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "cloud.bin"
    path.write_bytes(FILES[kind])
    findings = Findings()
    cloud = read_cloud(path, findings)
    assert not list(findings)
    np.testing.assert_array_equal(cloud.points, POINTS)
    np.testing.assert_array_equal(cloud.colors, COLORS)


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("share", [0.05, 0.5, 0.9])
def test_a_truncated_cloud_is_refused_by_name(tmp_path: Path, kind: str, share: float) -> None:
    path = tmp_path / "cloud.ply"
    path.write_bytes(FILES[kind][: int(len(FILES[kind]) * share)])
    with pytest.raises(InputError, match="cloud.ply"):
        read_cloud(path, Findings())


def test_lists_in_the_points_are_refused_politely(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    path.write_bytes(ply_header("binary_little_endian", "property list uchar float tail\n") + bytes(4000))
    with pytest.raises(InputError, match="list property"):
        read_cloud(path, Findings())


def test_an_absurd_number_of_points_is_refused_without_memory(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    for order in ("ascii", "binary_little_endian"):
        path.write_bytes(ply_header(order, count=10**14))
        with pytest.raises(InputError, match="truncated"):
            read_cloud(path, Findings())


def test_a_bad_number_is_named_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    lines = FILES["ply ascii"].split(b"\n")
    lines[16] = b"1 2 three 4 5 6 7"
    path.write_bytes(b"\n".join(lines))
    with pytest.raises(InputError, match="line 17"):
        read_cloud(path, Findings())


def test_points_that_are_not_finite_are_left_out_with_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "cloud.pcd"
    data = FILES["pcd binary"]
    start = data.index(b"DATA binary\n") + 12
    path.write_bytes(data[:start] + struct.pack("<f", float("nan")) + data[start + 4 :])
    findings = Findings()
    cloud = read_cloud(path, findings)
    np.testing.assert_array_equal(cloud.points, POINTS[1:])
    np.testing.assert_array_equal(cloud.colors, COLORS[1:])
    assert [f.severity for f in findings] == ["warning"]


def test_colors_as_fractions_are_spread_to_255(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    head = "ply\nformat ascii 1.0\nelement vertex 1\n"
    head += "".join(f"property float {n}\n" for n in ("x", "y", "z", "red", "green", "blue")) + "end_header\n"
    path.write_text(head + "1 2 3 0 0.5 1\n")
    np.testing.assert_array_equal(read_cloud(path, Findings()).colors, [[0, 128, 255]])


def reference_lzf(data: bytes) -> bytes:
    """A slow, greedy LZF compressor: literals, and back references of 3 to 264 bytes within 8 KiB."""
    out, literal, at = b"", b"", 0
    while at < len(data):
        best, distance = 0, 0
        for source in range(max(0, at - 8192), at):
            length = 0
            while length < 264 and at + length < len(data) and data[source + length] == data[at + length]:
                length += 1
            if length > best:
                best, distance = length, at - source - 1
        if best < 3:
            literal += data[at : at + 1]
            at += 1
            continue
        out, literal = out + lzf_literal(literal), b""
        short = best - 2
        head = bytes([(short << 5) | (distance >> 8)]) if short < 7 else bytes([(7 << 5) | (distance >> 8), short - 7])
        out += head + bytes([distance & 255])
        at += best
    return out + lzf_literal(literal)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.sampled_from([b"a", b"ab", b"abcabc", b"\0" * 40, b"xyz"]), max_size=40).map(b"".join))
def test_lzf_undoes_a_slow_compressor(data: bytes) -> None:
    assert lzf_decompress(reference_lzf(data), len(data)) == data


def test_merging_many_points_keeps_one_a_cube() -> None:
    points = RNG.uniform(0, 1, (5000, 3)).astype(np.float32)
    whole = merge([Cloud(points[:2000]), Cloud(points[2000:])])
    assert whole is not None and np.array_equal(whole.points, points)
    thin = merge([Cloud(points)], voxel=0.25, most=1000)
    assert thin is not None and len(thin.points) == 64
    assert merge([]) is None
