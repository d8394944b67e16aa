"""Splat files that lie or are damaged: one sentence each, without the time and the memory that they ask for."""

from __future__ import annotations

import gzip
import json
import os
import re
import struct
import threading
import time
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from test_splats_formats import sog, wall, webp, zipped

from nvsim.errors import InputError
from nvsim.splats.formats.choice import named_as_splats, read_splats, recognize, write_splats
from nvsim.splats.formats.sog_files import webp_size
from nvsim.splats.ply import write_ply
from nvsim.splats.types import Gaussians

MEGABYTE = 1 << 20


def refused(path: Path, words: str = "a") -> None:
    """Refused in a sentence with the file's name, within 64 MB and ten times the file, and seconds of computing."""
    started = time.process_time()
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=words) as caught:
            read_splats(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    size = sum(p.stat().st_size for p in path.parent.iterdir()) if path.name == "meta.json" else path.stat().st_size
    assert peak < 64 * MEGABYTE + 10 * size
    assert time.process_time() - started < 5
    assert str(path.parent) in str(caught.value) and "\n" not in str(caught.value)


def spz_header(count: int, version: int = 3, degree: int = 0, streams: int = 0, start: int = 0) -> bytes:
    return struct.pack("<IIIBBBBI", 0x5053474E, version, count, degree, 12, 0, streams, start)


@pytest.mark.parametrize("degree", [0, 3])
def test_a_zipped_spz_that_unpacks_to_gigabytes_is_refused_before_it_does(tmp_path: Path, degree: int) -> None:
    count = 40_000_000
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    data = packer.compress(spz_header(count, degree=degree)[:16])
    zeros = bytes(MEGABYTE)
    data += b"".join(packer.compress(zeros) for _ in range(count * 20 // MEGABYTE)) + packer.flush()
    (tmp_path / "a.spz").write_bytes(data)
    assert len(data) < MEGABYTE
    refused(tmp_path / "a.spz", "announces 40000000 Gaussians")


def test_an_spz_that_goes_on_after_its_gaussians_is_not_unpacked_to_the_end(tmp_path: Path) -> None:
    (tmp_path / "a.spz").write_bytes(gzip.compress(spz_header(1)[:16] + bytes(200 * MEGABYTE)))
    refused(tmp_path / "a.spz", "continues after its last Gaussian")


def test_streams_that_unpack_to_gigabytes_are_refused(tmp_path: Path) -> None:
    count = 100_000_000
    widths = (9, 1, 3, 3, 4)
    packed = [zstandard.compress(bytes(MEGABYTE)) * 8 for _ in widths]
    table = b"".join(struct.pack("<QQ", len(p), w * count) for p, w in zip(packed, widths, strict=True))
    head = spz_header(count, 4, streams=5, start=32) + bytes(12)
    (tmp_path / "a.spz").write_bytes(head + table + b"".join(packed))
    refused(tmp_path / "a.spz", "announces 100000000 Gaussians")


@pytest.mark.parametrize("version", [2, 3, 4])
def test_an_spz_of_no_gaussians_is_read_as_it_is(tmp_path: Path, version: int) -> None:
    head = spz_header(0, version, start=32) + bytes(12) if version == 4 else gzip.compress(spz_header(0, version)[:16])
    (tmp_path / "a.spz").write_bytes(head)
    assert len(read_splats(tmp_path / "a.spz").gaussians) == 0


def test_positions_of_the_first_spz_version_are_half_floats(tmp_path: Path) -> None:
    body = np.array([1.5, -2.0, 0.25], "<f2").tobytes() + bytes([204]) + bytes([128] * 3) + bytes([160] * 3)
    (tmp_path / "a.spz").write_bytes(gzip.compress(spz_header(1, 1)[:16] + body + bytes([127] * 3)))
    np.testing.assert_array_equal(read_splats(tmp_path / "a.spz").gaussians.means, [[1.5, 2.0, -0.25]])


def test_an_spz_that_ends_within_its_checksum_is_truncated(tmp_path: Path) -> None:
    write_splats(tmp_path / "a.spz", wall(20, 0), True, "spz")
    (tmp_path / "a.spz").write_bytes((tmp_path / "a.spz").read_bytes()[:-5])
    refused(tmp_path / "a.spz", "truncated")


@pytest.fixture(scope="module")
def unpacked() -> dict[str, bytes]:
    return sog(wall(300))[0]


Change = Callable[[dict[str, object]], object]


def changed(files: dict[str, bytes], change: Change) -> dict[str, bytes]:
    meta = json.loads(files["meta.json"])
    change(meta)
    return {**files, "meta.json": json.dumps(meta).encode()}


def put(*path: str | int, value: object) -> Change:
    def change(meta: dict[str, object]) -> None:
        inner: object = meta
        for key in path[:-1]:
            inner = inner[key]  # type: ignore[index]
        inner[path[-1]] = value  # type: ignore[index]

    return change


@pytest.mark.parametrize("packing", ["archive", "folder"])
@pytest.mark.parametrize(
    "change",
    [
        put("count", value=10**400),
        put("count", value=4_000_000_000),
        put("count", value=100_000_000),
        put("count", value=-1),
        put("count", value=0),
        put("count", value="300"),
        put("count", value=None),
        put("version", value=[2] * 4),
        put("means", value=[]),
        put("means", "files", value=[]),
        put("means", "files", value=[None, 3]),
        put("means", "files", value=["../../etc/passwd", "\0"]),
        put("means", "files", value=["x" * 5000, "y"]),
        put("means", "mins", value=[1e308] * 3),
        put("means", "mins", value=[10**400] * 3),
        put("means", "maxs", value=[float("nan")] * 3),
        put("means", "maxs", value=[[1], 2]),
        put("scales", "codebook", value=[float("inf")] * 256),
        put("scales", "codebook", value=["1"] * 256),
        put("shN", "codebook", value=[0.0]),
        put("shN", "count", value=10**9),
        put("shN", "bands", value=7),
        put("shN", "bands", value=3),
        put("shN", value={"files": {}}),
        put("sh0", value=3),
    ],
)
def test_a_sog_with_a_false_description_is_refused(
    tmp_path: Path, unpacked: dict[str, bytes], packing: str, change: Change
) -> None:
    refused(laid(tmp_path, changed(unpacked, change), packing))


def laid(folder: Path, files: dict[str, bytes], packing: str) -> Path:
    if packing == "archive":
        (folder / "a.sog").write_bytes(zipped(files))
        return folder / "a.sog"
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return folder / "meta.json"


@pytest.mark.parametrize("packing", ["archive", "folder"])
@pytest.mark.parametrize(
    "text",
    [b"", b"[]", b"3", b"[" * 200_000, b'{"count":' + b"9" * 5000 + b"}", b"\xff\xfe{}", b'{"version":2,"version":2}'],
)
def test_a_sog_whose_description_is_no_object_is_refused(
    tmp_path: Path, unpacked: dict[str, bytes], packing: str, text: bytes
) -> None:
    refused(laid(tmp_path, {**unpacked, "meta.json": text}, packing))


@pytest.mark.parametrize("packing", ["archive", "folder"])
@pytest.mark.parametrize(
    "data", [b"", b"RIFF", b"\x89PNG" + bytes(99), webp(np.zeros((40, 4), np.uint8), 40)[:29]], ids=range(4)
)
def test_an_empty_or_foreign_image_in_a_sog_is_named(
    tmp_path: Path, unpacked: dict[str, bytes], packing: str, data: bytes
) -> None:
    refused(laid(tmp_path, {**unpacked, "quats.webp": data}, packing), "quats.webp is not a WebP image")


def test_an_image_of_a_sog_with_more_pixels_than_gaussians_is_not_decoded(
    tmp_path: Path, unpacked: dict[str, bytes]
) -> None:
    huge = webp(np.zeros((4000 * 4000, 4), np.uint8), 4000)
    assert len(huge) < MEGABYTE and webp_size(huge[:32]) == (4000, 4000)
    refused(laid(tmp_path, {**unpacked, "sh0.webp": huge}, "archive"), "sh0.webp has 4000 x 4000 pixels")


def test_an_entry_of_a_sog_that_unpacks_to_gigabytes_is_refused(tmp_path: Path, unpacked: dict[str, bytes]) -> None:
    with zipfile.ZipFile(tmp_path / "a.sog", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in unpacked.items():
            archive.writestr(name, data + bytes(120 * MEGABYTE if name == "scales.webp" else 0))
    refused(tmp_path / "a.sog", "scales.webp has .* bytes unpacked")


def test_an_entry_of_a_sog_with_corrupt_deflate_is_refused(tmp_path: Path, unpacked: dict[str, bytes]) -> None:
    path = tmp_path / "a.sog"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in unpacked.items():
            archive.writestr(name, data)
        at = archive.getinfo("meta.json").header_offset + 30 + len("meta.json")
    data = bytearray(path.read_bytes())
    data[at : at + 40] = b"\xff" * 40
    path.write_bytes(data)
    refused(path, "meta.json is damaged")


def test_a_sog_packed_by_a_method_of_unlimited_memory_is_refused(tmp_path: Path, unpacked: dict[str, bytes]) -> None:
    with zipfile.ZipFile(tmp_path / "a.sog", "w", zipfile.ZIP_LZMA) as archive:
        for name, data in unpacked.items():
            archive.writestr(name, data)
    refused(tmp_path / "a.sog", "has a compression that a SOG does not use")


def test_an_archive_of_very_many_files_is_no_sog(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.sog", "w") as archive:
        for i in range(40_000):
            archive.writestr(f"{i:08}", b"")
    refused(tmp_path / "a.sog", "directory of")


PACKED = ("position", "rotation", "scale", "color")
BOUNDS = [
    f"{m}_{n}"
    for s in (("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), tuple("rgb"))
    for m in ("min", "max")
    for n in s
]


def compressed(count: int, chunks: int, harmonics: int | None, extra: str = "") -> bytes:
    lines = ["ply", "format binary_little_endian 1.0", f"element chunk {chunks}"]
    lines += [f"property float {name}" for name in BOUNDS]
    lines += [f"element vertex {count}", *(f"property uint packed_{name}" for name in PACKED)]
    if harmonics is not None:
        lines += [f"element sh {count}", *(f"property uchar f_rest_{i}" for i in range(harmonics))]
    lines += [extra] if extra else []
    body = np.zeros((chunks, 18), "<f4").tobytes() + bytes(count * (16 + (harmonics or 0)))
    return "\n".join([*lines, "end_header", ""]).encode() + body


@pytest.mark.parametrize("harmonics", [None, 9, 24, 45])
def test_a_compressed_ply_with_whole_harmonics_is_read(tmp_path: Path, harmonics: int | None) -> None:
    (tmp_path / "a.ply").write_bytes(compressed(300, 2, harmonics))
    gaussians = read_splats(tmp_path / "a.ply").gaussians
    assert gaussians.sh.shape == (300, 1 + (harmonics or 0) // 3, 3)


@pytest.mark.parametrize("harmonics", [0, 1, 2, 3, 8, 10, 46, 72])
def test_a_compressed_ply_with_too_few_or_too_many_harmonics_is_refused(tmp_path: Path, harmonics: int) -> None:
    (tmp_path / "a.ply").write_bytes(compressed(300, 2, harmonics))
    refused(tmp_path / "a.ply", f"{harmonics} SH coefficients")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"element vertex 300", b"element vertex 99999999999"),
        (b"element vertex 300", b"element vertex " + b"9" * 5000),
        (b"element chunk 2", b"element chunk 0"),
        (b"property float max_z\n", b""),
        (b"property uint packed_scale\n", b"property uchar packed_scale\n"),
        (b"packed_scale\n", b"packed_scale\nproperty list uchar int more\n"),
        (b"element vertex", b"comment x\x0belement vertex 1\nelement more 5\nproperty uchar x\nelement vertex"),
        (b"end_header\n", b"end_header\r\n"),
        (b"end_header\n", b"comment " + b"x" * 100_000 + b"\nend_header\n"),
    ],
    ids=range(9),
)
def test_a_compressed_ply_with_a_false_header_is_refused(tmp_path: Path, old: bytes, new: bytes) -> None:
    whole = compressed(300, 2, 9)
    assert old in whole
    (tmp_path / "a.ply").write_bytes(whole.replace(old, new))
    refused(tmp_path / "a.ply")


NAMES = [
    *"xyz",
    *(f"f_dc_{i}" for i in range(3)),
    "opacity",
    *(f"scale_{i}" for i in range(3)),
    *(f"rot_{i}" for i in range(4)),
]


def ply_header(count: int, form: str = "binary_little_endian", more: int = 0, kind: str = "float") -> bytes:
    lines = ["ply", f"format {form} 1.0", f"element vertex {count}", *(f"property {kind} {n}" for n in NAMES)]
    return "\n".join([*lines, *(f"property double p{i}" for i in range(more)), "end_header", ""]).encode()


def test_a_ply_with_thousands_of_properties_is_read_in_little_memory(tmp_path: Path) -> None:
    more, count = 2500, 60
    row = np.arange(1, 15, dtype="<f4").tobytes() + bytes(8 * more)
    (tmp_path / "a.ply").write_bytes(ply_header(count, more=more) + row * count)
    tracemalloc.start()
    gaussians = read_splats(tmp_path / "a.ply").gaussians
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_array_equal(gaussians.means, np.tile([1, 2, 3], (count, 1)))
    assert peak < 20 * MEGABYTE


def test_a_text_ply_is_read_in_little_memory(tmp_path: Path) -> None:
    count = 40_000
    (tmp_path / "a.ply").write_bytes(ply_header(count, "ascii") + b"1 2 3 4 5 6 7 8 9 1 2 3 4 5\n\n" * count)
    size = (tmp_path / "a.ply").stat().st_size
    tracemalloc.start()
    gaussians = read_splats(tmp_path / "a.ply").gaussians
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_array_equal(gaussians.quats, np.tile([2, 3, 4, 5], (count, 1)))
    assert peak < 8 * MEGABYTE + 5 * size


@pytest.mark.parametrize(
    ("header", "body", "words"),
    [
        (ply_header(999_999_999_999), b"", "truncated"),
        (ply_header(900_000_000, "ascii"), b"1 " * 14, "truncated"),
        (ply_header(1), np.full(14, np.nan, "<f4").tobytes(), "none of its 1 Gaussians.*NaN or infinite"),
        (ply_header(1, kind="double"), np.full(14, 1e300, "<f8").tobytes(), "none of its 1 Gaussians.*NaN or infinite"),
        (ply_header(1, "ascii"), b"1 2 3 4 5 6 7 8 9 1 2 3 4\n\n", "line 19: expected 14 numbers"),
        (ply_header(1, "ascii"), b"1 " * 3_000_000, "line 19: it has more than"),
        (ply_header(1, "ascii"), b"1 2 nan 4 5 6 7 8 9 1 2 3 4 5", "none of its 1 Gaussians.*NaN or infinite"),
        (ply_header(1, "ascii"), b"1 2 x 4 5 6 7 8 9 1 2 3 4 5", "line 19: expected 14 numbers"),
        (ply_header(1, more=20_000), bytes(200_000), "header is truncated"),
        (ply_header(1)[:-11] + b"property list int int a\nend_header\n", bytes(99), "list property"),
    ],
    ids=range(10),
)
def test_a_ply_with_a_false_header_is_refused(tmp_path: Path, header: bytes, body: bytes, words: str) -> None:
    (tmp_path / "a.ply").write_bytes(header + body)
    refused(tmp_path / "a.ply", words)


@pytest.mark.parametrize("size", [0, 1, 31, 33])
def test_a_splat_file_of_no_whole_gaussians_is_refused(tmp_path: Path, size: int) -> None:
    (tmp_path / "a.splat").write_bytes(bytes(size))
    refused(tmp_path / "a.splat", "not a multiple of")


@pytest.mark.parametrize("value", [np.inf, -np.inf, -1.0, 1e7, -1e7, 1e31])
@pytest.mark.parametrize("column", [0, 3])
def test_a_splat_file_with_an_absurd_number_is_refused(tmp_path: Path, value: float, column: int) -> None:
    rows = np.zeros((5, 8), "<f4")
    rows[2, column] = value
    (tmp_path / "a.splat").write_bytes(rows.tobytes())
    if column == 0 and value == -1:
        assert len(read_splats(tmp_path / "a.splat").gaussians) == 5
    else:
        refused(tmp_path / "a.splat", "the first in Gaussian 2, so it is not a .splat file")


@pytest.mark.parametrize(
    "content",
    [
        b"<html><body>404: this file has been moved to another place</body></html>",
        b"<!DOCTYPE html>\n<html lang='en'>" + b"<p>Not found</p>" * 300,
        b'{"error": "the file was not found", "status": 404}',
        "Größe: not a splat, but a README file that somebody renamed\n".encode(),
        b"x, y, z\n1.0, 2.0, 3.0\n",
    ],
)
def test_text_is_no_splat_file_whatever_its_length(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.splat").write_bytes(content)
    refused(tmp_path / "a.splat", "is (text|a web page), not")
    (tmp_path / "a.splat").write_bytes(content.ljust(-(-len(content) // 32) * 32))  # a whole number of rows
    refused(tmp_path / "a.splat", "is (text|a web page), not")


def test_random_bytes_are_no_splat_file(tmp_path: Path) -> None:
    (tmp_path / "a.splat").write_bytes(np.random.default_rng(0).bytes(3200))
    refused(tmp_path / "a.splat", "so it is not a .splat file")


# Values that cannot be drawn ------------------------------------------------------------------------------------


def spoiled(values: dict[int, tuple[str, float]]) -> Gaussians:
    """Six Gaussians; row -> the array that is spoiled there, and the value."""
    r = np.random.default_rng(4)
    g = Gaussians(*(r.normal(size=s).astype(np.float32) for s in ((6, 3), (6, 3), (6, 4), (6,), (6, 1, 3))))
    for row, (name, value) in values.items():
        getattr(g, name)[row] = value
    return g


@pytest.mark.parametrize("form", ["binary", "ascii"])
@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("means", np.nan, "1 with values that are NaN or infinite"),
        ("means", -np.inf, "NaN or infinite"),
        ("means", 1e12, "1 with values beyond 1e.07"),
        ("log_scales", np.nan, "NaN or infinite"),
        ("log_scales", np.inf, "NaN or infinite"),
        ("log_scales", 80, "beyond"),
        ("opacity_logits", np.nan, "NaN or infinite"),
        ("quats", np.nan, "NaN or infinite"),
        ("quats", 0, "1 with a quaternion of length 0"),
        ("sh", np.inf, "NaN or infinite"),
        ("sh", 1e20, "beyond"),
    ],
)
def test_a_gaussian_that_cannot_be_drawn_is_left_out_and_counted(
    tmp_path: Path, form: str, name: str, value: float, why: str
) -> None:
    g = spoiled({4: (name, value)})
    write_ply(tmp_path / "a.ply", g, True)
    if form == "ascii":
        table = np.column_stack([g.means, g.sh[:, 0], g.opacity_logits, g.log_scales, g.quats])
        rows = "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in table)
        (tmp_path / "a.ply").write_bytes(ply_header(6, "ascii") + rows.encode())
    splats = read_splats(tmp_path / "a.ply")
    np.testing.assert_array_equal(splats.gaussians.means, np.delete(g.means, 4, axis=0))
    np.testing.assert_array_equal(splats.gaussians.sh, np.delete(g.sh, 4, axis=0))
    (note,) = splats.notes
    assert note.startswith(f"{tmp_path / 'a.ply'}: 1 of 6 Gaussians are skipped") and re.search(why, note)


def test_command_line_says_how_many_gaussians_are_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from nvsim.cli.main import main

    write_ply(tmp_path / "a.ply", spoiled({4: ("means", np.nan)}), True)
    assert main(["bench", "render", "--scene", str(tmp_path / "a.ply"), "--size", "8x8", "--rounds", "1"]) == 0
    assert "note: " in (err := capsys.readouterr().err) and "1 of 6 Gaussians are skipped" in err


def test_every_kind_of_gaussian_that_is_left_out_is_counted(tmp_path: Path) -> None:
    spoiling = {0: ("means", np.nan), 1: ("quats", 0.0), 2: ("sh", np.nan), 5: ("log_scales", 50.0)}
    write_ply(tmp_path / "a.ply", spoiled(spoiling), True)
    (note,) = read_splats(tmp_path / "a.ply").notes
    assert "4 of 6" in note and "2 with values that are NaN" in note and "1 with a quaternion" in note


def test_an_infinite_logit_is_opaque_and_its_negative_transparent(tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", spoiled({1: ("opacity_logits", np.inf), 2: ("opacity_logits", -np.inf)}), True)
    splats = read_splats(tmp_path / "a.ply")
    opacity = 1 / (1 + np.exp(-splats.gaussians.opacity_logits))
    assert splats.notes == () and len(opacity) == 6
    assert opacity[1] == 1 and 0 <= opacity[2] < 1e-6 and np.isfinite(splats.gaussians.opacity_logits).all()


def test_a_scale_of_zero_is_flat(tmp_path: Path) -> None:
    g = spoiled({})
    g.log_scales[3, 1] = -np.inf
    write_ply(tmp_path / "a.ply", g, True)
    splats = read_splats(tmp_path / "a.ply")
    assert splats.notes == () and len(splats.gaussians) == 6
    assert np.isfinite(splats.gaussians.log_scales).all() and np.exp(splats.gaussians.log_scales[3, 1]) < 1e-6
    np.testing.assert_array_equal(splats.gaussians.log_scales[:3], g.log_scales[:3])


def test_a_splat_file_of_nothing_but_broken_gaussians_is_refused(tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", spoiled({row: ("means", np.nan) for row in range(6)}), True)
    refused(tmp_path / "a.ply", "none of its 6 Gaussians can be rendered")


def test_nan_and_unset_rotations_in_a_splat_file_are_left_out_and_counted(tmp_path: Path) -> None:
    rows = np.ones((9, 8), "<f4")
    rows[4, 1], rows[5, 4] = np.nan, np.nan
    data = bytearray(rows.tobytes())
    data[7 * 32 + 28 : 8 * 32] = b"\x80" * 4
    (tmp_path / "a.splat").write_bytes(data)
    splats = read_splats(tmp_path / "a.splat")
    assert len(splats.gaussians) == 6 and "3 of 9 Gaussians" in splats.notes[0]
    rows[:6] = np.nan
    (tmp_path / "a.splat").write_bytes(rows.tobytes())
    refused(tmp_path / "a.splat", "so it is not a .splat file")


def test_half_floats_of_nan_in_an_spz_are_left_out_and_counted(tmp_path: Path) -> None:
    means = np.array([[1.5, 2.0, -0.25], [np.nan, 0, 0]], "<f2").tobytes()
    body = means + bytes([200, 200]) + bytes(6) + bytes([128] * 6) + bytes([128] * 6)
    (tmp_path / "a.spz").write_bytes(gzip.compress(spz_header(2, 1)[:16] + body))
    splats = read_splats(tmp_path / "a.spz")
    np.testing.assert_array_equal(splats.gaussians.means, [[1.5, -2.0, 0.25]])
    assert "1 of 2 Gaussians" in splats.notes[0]


def test_a_chunk_of_nan_in_a_compressed_ply_is_left_out_and_counted(tmp_path: Path) -> None:
    write_splats(tmp_path / "a.ply", wall(300, 0), True, "compressed-ply")
    data = bytearray((tmp_path / "a.ply").read_bytes())
    at = data.index(b"end_header\n") + len(b"end_header\n") + 18 * 4  # the bounds of the second chunk
    data[at : at + 4] = np.array([np.nan], "<f4").tobytes()
    (tmp_path / "a.ply").write_bytes(data)
    splats = read_splats(tmp_path / "a.ply")
    assert len(splats.gaussians) == 256 and "44 of 300 Gaussians" in splats.notes[0]


@pytest.mark.parametrize("name", ["a.ply", "a.spz", "a.sog", "a.splat", "meta.json"])
def test_a_pipe_or_a_folder_in_place_of_a_file_is_refused_and_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    found: list[str] = []

    def read() -> None:
        with pytest.raises(InputError) as caught:
            read_splats(tmp_path / name)
        found.append(str(caught.value))

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    thread.join(5)
    assert found and "it is a pipe" in found[0]
    (tmp_path / name).unlink()
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match="it is a folder"):
        read_splats(tmp_path / name)


@pytest.mark.parametrize("name", ["x" * 300, "a/b", "a\0b"])
def test_a_name_that_no_file_has_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="Cannot read"):
        recognize(tmp_path / name)


def test_of_json_files_only_those_of_a_sog_are_taken_for_splats() -> None:
    names = ["meta.json", "lod-meta.json", "house_connectivity.json", "my_meta.json", "a.SPZ", "a.compressed.ply"]
    assert [named_as_splats(Path(n)) for n in names] == [True, True, False, False, True, True]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("whole")
    for form, name in (("ply", "a.ply"), ("compressed-ply", "b.ply"), ("spz", "c.spz")):
        write_splats(folder / name, wall(60, 1), True, form)  # type: ignore[arg-type]
    (folder / "d.sog").write_bytes(zipped(sog(wall(50))[0]))
    (folder / "e.splat").write_bytes(np.ones((9, 8), "<f4").tobytes())
    (folder / "f.ply").write_bytes(ply_header(9, "ascii") + b"1 2 3 4 5 6 7 8 9 1 2 3 4 5\n" * 9)
    return {p.name: p.read_bytes() for p in folder.iterdir()}


@pytest.mark.parametrize("name", ["a.ply", "b.ply", "c.spz", "d.sog", "e.splat", "f.ply", "raw.spz"])
@settings(max_examples=80, deadline=None)
@given(data=st.data())
def test_bytes_changed_added_and_taken_away_are_read_or_refused(
    whole: dict[str, bytes], tmp_path_factory: pytest.TempPathFactory, name: str, data: st.DataObject
) -> None:
    content = bytearray(gzip.decompress(whole["c.spz"]) if name == "raw.spz" else whole[name])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content)))
        size = data.draw(st.integers(0, 8))
        content[at : at + size] = data.draw(st.binary(max_size=8))
    path = tmp_path_factory.mktemp("changed") / name
    path.write_bytes(content)
    try:
        gaussians = read_splats(path).gaussians
        assert np.isfinite(gaussians.means).all()
    except InputError as error:
        assert name in str(error) and "\n" not in str(error)
