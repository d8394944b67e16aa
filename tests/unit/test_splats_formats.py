"""Splat files of other programs: theirs as they wrote them, ours within the steps of each format, and broken ones."""

from __future__ import annotations

import gzip
import io
import json
import struct
import zipfile

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.render.model import render_gaussians
from nvsim.splats.formats.choice import read_splats, write_splats
from nvsim.splats.formats.gsply_formats import flip_y_and_z
from nvsim.splats.types import Gaussians

CAMERA = Camera(Intrinsics(96, 72, 80.0, 80.0, 48.0, 36.0), camera_pose(np.array([0.0, 0.0, 1.5]), 0.3))


def wall(count=3000, degree=3, seed=0):
    """Gaussians of a few centimeters to a few decimeters before CAMERA, most of them overlapping."""
    r = np.random.default_rng(seed)
    local = r.uniform([-1.5, -1.2, 2.0], [1.5, 1.2, 4.0], (count, 3))
    means = local @ CAMERA.rotation.T + CAMERA.position
    sh = r.normal(0, 0.12, (count, (degree + 1) ** 2, 3))
    arrays = means, r.normal(-3, 0.4, (count, 3)), r.normal(size=(count, 4)), r.normal(0, 2, count), sh
    return Gaussians(*(np.ascontiguousarray(a, np.float32) for a in arrays))


def psnr(a, b):
    return -10 * np.log10(((a - b) ** 2).mean())


def picture(gaussians):
    return np.clip(render_gaussians(gaussians, CAMERA).rgb, 0, 1)


@pytest.mark.data
def test_one_object_as_compressed_ply_and_as_spz_is_the_same(shared_data):
    ply = read_splats(shared_data / "splats" / "biker.compressed.ply").gaussians
    splats = read_splats(shared_data / "splats" / "biker.spz")
    spz, antialiased = splats.gaussians, splats.antialiased
    assert len(ply) == len(spz) == 152746 and antialiased is False
    assert np.median(cKDTree(spz.means).query(ply.means[::50])[0]) < 5e-4
    np.testing.assert_allclose(ply.means.min(axis=0), spz.means.min(axis=0), atol=1e-3)
    np.testing.assert_allclose(ply.means.max(axis=0), spz.means.max(axis=0), atol=1e-3)
    np.testing.assert_allclose(np.median(ply.log_scales, axis=0), np.median(spz.log_scales, axis=0), atol=1 / 16)
    np.testing.assert_allclose(ply.sh.mean(axis=0), spz.sh.mean(axis=0), atol=0.01)
    # Sizes and turns together: the mean covariance along the world's axes.
    np.testing.assert_allclose(covariance(ply), covariance(spz), rtol=0.05, atol=1e-6)


def covariance(g):
    from nvsim.geometry.rotation import matrix_from_quaternion

    axes = matrix_from_quaternion(g.quats / np.linalg.norm(g.quats, axis=1, keepdims=True))
    return np.einsum("nij,nj,nkj->ik", axes, np.exp(2 * g.log_scales.astype(float)), axes) / len(g)


@pytest.mark.data
@pytest.mark.parametrize("name", [".splat", ".ksplat", "-raw.spz", "-v2.spz", "-v3.spz", "-v4.spz"])
def test_small_files_of_another_program_open(shared_data, name):
    gaussians = read_splats(shared_data / "splats" / f"minimal{name}").gaussians
    assert len(gaussians) == 4
    np.testing.assert_allclose(np.abs(gaussians.means).max(axis=0), 1, atol=1.01)
    np.testing.assert_allclose(np.exp(gaussians.log_scales), 0.1, rtol=0.05)
    np.testing.assert_allclose(1 / (1 + np.exp(-gaussians.opacity_logits)), 0.9, atol=0.01)


@pytest.mark.data
def test_an_unknown_kind_is_refused_by_name(shared_data, tmp_path):
    (tmp_path / "scene.unknown").write_bytes((shared_data / "splats" / "minimal.ksplat").read_bytes())
    with pytest.raises(InputError, match="scene.unknown is not a splat file"):
        read_splats(tmp_path / "scene.unknown")


def test_a_ksplat_of_16_bit_numbers_is_read_relative_to_its_buckets(tmp_path):
    head, section = bytearray(4096), bytearray(1024)
    struct.pack_into("<BBHIIIIHH", head, 0, 0, 1, 0, 1, 1, 3, 3, 1, 0)
    struct.pack_into("<IIIIfHHIIIIH", section, 0, 3, 3, 2, 2, 8.0, 12, 0, 32767, 0, 1, 1, 0)
    rows = b""
    for x in (0, 65534, 32767):
        rows += struct.pack("<3H", x, 32767, 32767) + np.array([0.1, 0.2, 0.3, 1, 0, 0, 0], "<f2").tobytes()
        rows += bytes([255, 0, 0, 128])
    buckets = np.array([[10, 0, 0], [-20, 5, 0]], "<f4").tobytes()
    (tmp_path / "a.ksplat").write_bytes(bytes(head) + bytes(section) + struct.pack("<I", 1) + buckets + rows)
    found = read_splats(tmp_path / "a.ksplat").gaussians
    np.testing.assert_allclose(found.means, [[6, 0, 0], [14, 0, 0], [-20, 5, 0]], atol=1e-3)
    np.testing.assert_allclose(np.exp(found.log_scales), np.tile([0.1, 0.2, 0.3], (3, 1)), rtol=1e-3)
    np.testing.assert_array_equal(found.quats, np.tile([1, 0, 0, 0], (3, 1)))
    for length in (10, 4096, 5000, 5120):
        (tmp_path / "b.ksplat").write_bytes((tmp_path / "a.ksplat").read_bytes()[:length])
        with pytest.raises(InputError, match="b.ksplat"):
            read_splats(tmp_path / "b.ksplat")


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_half_a_turn_about_x_shows_the_same_to_a_camera_that_turns_with_it(degree):
    gaussians = wall(degree=degree)
    turn = np.diag([1.0, -1.0, -1.0, 1.0])
    turned = render_gaussians(flip_y_and_z(gaussians), Camera(CAMERA.intrinsics, turn @ CAMERA.camera_to_world))
    np.testing.assert_allclose(turned.rgb, render_gaussians(gaussians, CAMERA).rgb, atol=2e-5)


@pytest.mark.parametrize("antialiased", [True, False])
def test_ply_comes_back_to_the_bit_with_its_mode(tmp_path, antialiased):
    gaussians = wall()
    write_splats(tmp_path / "a.ply", gaussians, antialiased, "ply")
    splats = read_splats(tmp_path / "a.ply")
    back, mode = splats.gaussians, splats.antialiased
    assert mode is antialiased
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(back, name), getattr(gaussians, name))


@pytest.mark.parametrize("antialiased", [True, False])
@pytest.mark.parametrize("degree", [0, 3])
def test_spz_comes_back_within_its_steps_with_its_mode(tmp_path, antialiased, degree):
    gaussians = wall(degree=degree)
    write_splats(tmp_path / "a.spz", gaussians, antialiased, "spz")
    splats = read_splats(tmp_path / "a.spz")
    back, mode = splats.gaussians, splats.antialiased
    assert mode is antialiased
    np.testing.assert_allclose(back.means, gaussians.means, atol=0.51 / 4096)
    np.testing.assert_allclose(back.log_scales, gaussians.log_scales, atol=0.51 / 16)
    unit = gaussians.quats / np.linalg.norm(gaussians.quats, axis=1, keepdims=True)
    assert np.abs((back.quats * unit).sum(axis=1)).min() > 1 - 2e-5
    sigmoid = [1 / (1 + np.exp(-g.opacity_logits)) for g in (back, gaussians)]
    np.testing.assert_allclose(*sigmoid, atol=1 / 255)
    np.testing.assert_allclose(back.sh[:, 0], gaussians.sh[:, 0], atol=0.51 / (0.15 * 255))
    np.testing.assert_allclose(back.sh[:, 1:], gaussians.sh[:, 1:], atol=9 / 128)
    assert psnr(picture(back), picture(gaussians)) > 35


def test_spz_of_a_wide_scene_keeps_its_positions(tmp_path):
    gaussians = wall()
    gaussians.means[0] = [9000.0, 0, 0]
    write_splats(tmp_path / "a.spz", gaussians, True, "spz")
    np.testing.assert_allclose(read_splats(tmp_path / "a.spz").gaussians.means, gaussians.means, atol=0.51 / 2**8)


@pytest.mark.parametrize("degree", [0, 3])
def test_compressed_ply_shows_the_same(tmp_path, degree):
    gaussians = wall(degree=degree)
    write_splats(tmp_path / "a.ply", gaussians, True, "compressed-ply")
    splats = read_splats(tmp_path / "a.ply")
    back, mode = splats.gaussians, splats.antialiased
    assert mode is None and len(back) == len(gaussians) and back.sh_degree == degree
    assert (tmp_path / "a.ply").stat().st_size < len(gaussians) * (17 + 3 * (degree + 1) ** 2) + 4000
    assert psnr(picture(back), picture(gaussians)) > 35


def test_splat_rows_are_read_as_their_format_says(tmp_path):
    row = struct.pack("<6f4B4B", 1, -2, 3, 0.1, 0.2, 0.4, 255, 0, 128, 204, 128 + 64, 128, 128 - 64, 255)
    (tmp_path / "a.splat").write_bytes(row * 2)
    splats = read_splats(tmp_path / "a.splat")
    gaussians, mode = splats.gaussians, splats.antialiased
    assert len(gaussians) == 2 and mode is None
    np.testing.assert_allclose(gaussians.means[1], [1, -2, 3])
    np.testing.assert_allclose(np.exp(gaussians.log_scales[0]), [0.1, 0.2, 0.4], rtol=1e-6)
    np.testing.assert_allclose(gaussians.quats[0], [0.5, 0, -0.5, 127 / 128])
    np.testing.assert_allclose(1 / (1 + np.exp(-gaussians.opacity_logits)), 0.8, rtol=1e-6)
    np.testing.assert_allclose(0.5 + 0.2820948 * gaussians.sh[0, 0], [1, 0, 128 / 255], atol=1e-6)


def webp(pixels, columns):
    """(n, 4) bytes as a lossless picture `columns` wide."""
    rows = -(-len(pixels) // columns)
    canvas = np.zeros((rows * columns, 4), np.uint8)
    canvas[: len(pixels)] = pixels
    image = canvas.reshape(rows, columns, 4)[..., [2, 1, 0, 3]]
    done, data = cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, 101])
    assert done
    return data.tobytes()


def sog(gaussians, seed=0):
    """The files of a SOG, and the values that a reader must find in them."""
    r, n = np.random.default_rng(seed), len(gaussians)
    logs = np.sign(gaussians.means) * np.log1p(np.abs(gaussians.means))
    low, high = logs.min(axis=0), logs.max(axis=0)
    whole = np.round((logs - low) / (high - low) * 65535).astype(np.int64)
    opaque = np.full((n, 1), 255)
    books = {k: np.sort(r.normal(0, 1, 256)).astype(np.float32) for k in ("scales", "sh0", "shN")}
    # Where alpha is 0 an encoder may drop the colors.
    scales, colors = r.integers(0, 256, (n, 3)), r.integers(1, 256, (n, 4))
    quats = gaussians.quats / np.linalg.norm(gaussians.quats, axis=1, keepdims=True)
    largest = np.abs(quats).argmax(axis=1)
    quats = quats * np.sign(quats[np.arange(n), largest])[:, None]
    three = np.array([np.delete(q, k) for q, k in zip(quats, largest, strict=True)])
    packed = np.round((three * np.sqrt(2) + 1) / 2 * 255)
    palette, labels = r.integers(0, 256, (100, 8, 3)), r.integers(0, 100, n)
    centroids = np.zeros((2 * 64, 8, 4), np.int64)
    centroids[:100, :, :3], centroids[..., 3] = palette, 255
    files = {
        "means_l.webp": webp(np.hstack([whole & 255, opaque]), 40),
        "means_u.webp": webp(np.hstack([whole >> 8, opaque]), 40),
        "quats.webp": webp(np.hstack([packed, 252 + largest[:, None]]), 40),
        "scales.webp": webp(np.hstack([scales, opaque]), 40),
        "sh0.webp": webp(colors, 40),
        "centroids.webp": webp(centroids.reshape(-1, 4), 64 * 8),
        "labels.webp": webp(np.stack([labels & 255, labels >> 8, 0 * labels, 0 * labels + 255], axis=1), 40),
    }
    meta = {
        "version": 2,
        "count": n,
        "means": {"mins": low.tolist(), "maxs": high.tolist(), "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": books["scales"].tolist(), "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": books["sh0"].tolist(), "files": ["sh0.webp"]},
        "shN": {
            "count": 100,
            "bands": 2,
            "codebook": books["shN"].tolist(),
            "files": ["centroids.webp", "labels.webp"],
        },
    }
    files["meta.json"] = json.dumps(meta).encode()
    sh = np.concatenate([books["sh0"][colors[:, None, :3]], books["shN"][palette[labels]]], axis=1)
    return files, quats, books["scales"][scales], colors[:, 3] / 255, sh


def zipped(files):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return stream.getvalue()


@pytest.mark.parametrize("packing", ["archive", "folder"])
def test_sog_is_read_as_its_format_says(tmp_path, packing):
    gaussians = wall(500)
    files, quats, scales, opacity, sh = sog(gaussians)
    if packing == "archive":
        path = tmp_path / "a.sog"
        path.write_bytes(zipped(files))
    else:
        path = tmp_path / "meta.json"
        for name, data in files.items():
            (tmp_path / name).write_bytes(data)
    splats = read_splats(path)
    back, mode = splats.gaussians, splats.antialiased
    assert mode is None
    np.testing.assert_allclose(back.means, gaussians.means, rtol=2e-4, atol=2e-4)
    assert np.abs((back.quats * quats).sum(axis=1)).min() > 1 - 1e-4
    np.testing.assert_array_equal(back.log_scales, scales)
    np.testing.assert_allclose(1 / (1 + np.exp(-back.opacity_logits)), np.clip(opacity, 0.002, 0.998), atol=1e-3)
    np.testing.assert_array_equal(back.sh, sh)


def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    gaussians = wall(300, 1)
    for form, name in (("ply", "a.ply"), ("compressed-ply", "b.ply"), ("spz", "c.spz")):
        write_splats(folder / name, gaussians, True, form)
    (folder / "d.sog").write_bytes(zipped(sog(wall(50))[0]))
    return {p.name: p.read_bytes() for p in folder.iterdir()}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return written(tmp_path_factory)


@pytest.mark.parametrize("name", ["a.ply", "b.ply", "c.spz", "d.sog"])
@settings(max_examples=40, deadline=None)
@given(share=st.floats(0, 0.999))
def test_a_truncated_file_is_refused_in_a_sentence(whole, tmp_path_factory, name, share):
    path = tmp_path_factory.mktemp("cut") / name
    path.write_bytes(whole[name][: int(share * len(whole[name]))])
    with pytest.raises(InputError, match=name.replace(".", r"\.")):
        read_splats(path)


@pytest.mark.parametrize("name", ["b.ply", "c.spz", "d.sog"])
@settings(max_examples=60, deadline=None)
@given(at=st.floats(0, 0.9999), value=st.integers(0, 255))
def test_a_changed_byte_is_read_or_refused_but_never_crashes(whole, tmp_path_factory, name, at, value):
    data = bytearray(whole[name])
    data[int(at * len(data))] = value
    path = tmp_path_factory.mktemp("changed") / name
    path.write_bytes(data)
    try:
        read_splats(path)
    except InputError as error:
        assert name in str(error)


def test_absurd_counts_are_refused_before_anything_is_allocated(tmp_path, whole):
    raw = bytearray(gzip.decompress(whole["c.spz"]))
    raw[8:12] = struct.pack("<I", 4_000_000_000)
    (tmp_path / "a.spz").write_bytes(gzip.compress(bytes(raw)))
    (tmp_path / "b.ply").write_bytes(whole["b.ply"].replace(b"vertex 300", b"vertex 90000000000"))
    for name in ("a.spz", "b.ply"):
        with pytest.raises(InputError, match=name):
            read_splats(tmp_path / name)


def test_a_codebook_of_the_wrong_size_is_named(tmp_path):
    files, *_ = sog(wall(50))
    meta = json.loads(files["meta.json"])
    meta["scales"]["codebook"] = [0.0]
    (tmp_path / "a.sog").write_bytes(zipped({**files, "meta.json": json.dumps(meta).encode()}))
    with pytest.raises(InputError, match="codebook of scales has 1 entries"):
        read_splats(tmp_path / "a.sog")
