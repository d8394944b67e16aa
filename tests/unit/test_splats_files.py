"""Model folders and PLY files: written models are read back, and damaged files are refused with a sentence."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.errors import InputError
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.files import gaussian_count, load_model, load_removed, removal_digest, save_model, store_removed
from nvsim.splats.formats.choice import read_splats
from nvsim.splats.ply import read_ply, write_ply
from nvsim.splats.types import Background, FloorTexture, Gaussians, SubmapModel

ARRAYS = ("means", "log_scales", "quats", "opacity_logits", "sh")


def gaussians(count=7, degree=3, seed=0):
    r = np.random.default_rng(seed)
    f = np.float32
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, (degree + 1) ** 2, 3))
    return Gaussians(*(r.normal(size=s).astype(f) for s in shapes))


def model(seed=0, **changes):
    r = np.random.default_rng(seed)
    weights = {"base.weight": r.normal(size=(3, 4)).astype(np.float32), "base.bias": np.ones(3, np.float32)}
    levels = (r.normal(size=(2, 3, 3)).astype(np.float32), r.normal(size=(8, 5, 3)).astype(np.float32))
    parts = {
        "gaussians": gaussians(seed=seed),
        "background": Background(weights, 3, 4.5),
        "texture": FloorTexture(levels, (-1.0, 2.0), (3.5, 4.0)),
        "floor": FloorSurface(r.normal(size=(3, 2)).astype(np.float32), (0.5, -0.5), 0.75),
        "antialiased": False,
        "info": {"preset": "nvsim", "steps": 10, "psnr": 27.5},
    }
    return SubmapModel(**{**parts, **changes})


def assert_same_gaussians(a, b):
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
        array = getattr(b, name)
        assert array.dtype == np.float32 and array.flags.c_contiguous and array.flags.writeable, name


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("count", [0, 1, 7])
def test_gaussians_come_back_from_a_ply_file(tmp_path, degree, count):
    g = gaussians(count, degree)
    write_ply(tmp_path / "g.ply", g, antialiased=bool(degree % 2))
    found, antialiased = read_ply(tmp_path / "g.ply")
    assert_same_gaussians(g, found)
    assert antialiased is bool(degree % 2)


def test_a_ply_file_is_laid_out_as_other_programs_expect(tmp_path):
    g = gaussians(3, 1)
    write_ply(tmp_path / "g.ply", g, True)
    head, body = (tmp_path / "g.ply").read_bytes().split(b"end_header\n")
    names = [line.split()[-1] for line in head.decode().splitlines() if line.startswith("property")]
    expected = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{i}" for i in range(9))]
    expected += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    assert names == expected
    row = np.frombuffer(body, "<f4").reshape(3, 26)[1]
    np.testing.assert_array_equal(row[9:12], g.sh[1, 1:, 0])  # all of red before green
    np.testing.assert_array_equal(row[12:15], g.sh[1, 1:, 1])
    assert {"comment antialiased 1", "comment SplatRenderMode: mip"} <= set(head.decode().splitlines())


def test_properties_may_come_in_any_order_with_others_between_and_without_normals(tmp_path):
    g = gaussians(4, 0)
    names = ["opacity", "rot_3", "rot_2", "rot_1", "rot_0", "extra", "z", "y", "x"]
    names += ["scale_2", "scale_1", "scale_0", "f_dc_2", "f_dc_1", "f_dc_0"]
    table = np.concatenate(
        [
            g.opacity_logits[:, None],
            g.quats[:, ::-1],
            np.ones((4, 1)),
            g.means[:, ::-1],
            g.log_scales[:, ::-1],
            g.sh[:, 0, ::-1],
        ],
        axis=1,
    )
    header = "ply\nformat binary_big_endian 1.0\ncomment SplatRenderMode: mip\nelement vertex 4\n"
    header += "".join(f"property double {n}\n" for n in names) + "end_header\n"
    (tmp_path / "g.ply").write_bytes(header.encode() + table.astype(">f8").tobytes())
    found, antialiased = read_ply(tmp_path / "g.ply")
    assert_same_gaussians(g, found)
    assert antialiased is True


@pytest.mark.parametrize("order", ["<", ">"])
def test_files_of_many_blocks_with_other_elements_come_back(tmp_path, order):
    g = gaussians(9001, 1)
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{i}" for i in range(9)), "opacity"]
    names += ["scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    higher = g.sh[:, 1:].transpose(0, 2, 1).reshape(9001, 9)
    table = np.hstack([g.means, g.sh[:, 0], higher, g.opacity_logits[:, None], g.log_scales, g.quats])
    header = f"ply\nformat binary_{'little' if order == '<' else 'big'}_endian 1.0\nelement camera 3\n"
    header += "property short a\nproperty uchar b\nelement vertex 9001\n"
    header += "".join(f"property float {n}\n" for n in names) + "end_header\n"
    (tmp_path / "g.ply").write_bytes(header.encode() + bytes(9) + table.astype(order + "f4").tobytes())
    found, antialiased = read_ply(tmp_path / "g.ply")
    assert_same_gaussians(g, found)
    assert antialiased is None
    write_ply(tmp_path / "again.ply", found, False)
    assert_same_gaussians(g, read_ply(tmp_path / "again.ply")[0])
    assert read_ply(tmp_path / "again.ply")[1] is False


def test_an_ascii_file_is_read_too(tmp_path):
    g = gaussians(3, 0)
    names = [
        "x",
        "y",
        "z",
        "f_dc_0",
        "f_dc_1",
        "f_dc_2",
        "opacity",
        "scale_0",
        "scale_1",
        "scale_2",
        "rot_0",
        "rot_1",
        "rot_2",
        "rot_3",
    ]
    table = np.hstack([g.means, g.sh[:, 0], g.opacity_logits[:, None], g.log_scales, g.quats])
    text = (
        "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {n}\n" for n in names) + "end_header\n"
    )
    text += "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in table)
    (tmp_path / "g.ply").write_text(text)
    assert_same_gaussians(g, read_ply(tmp_path / "g.ply")[0])


def of_another_program(path, g, names, columns, text=False):
    """A PLY file with the usual properties of degree 0, without those that `names` lacks, and with more `columns`."""
    usual = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"]
    usual += ["rot_0", "rot_1", "rot_2", "rot_3"]
    table = np.hstack([g.means, g.sh[:, 0], g.opacity_logits[:, None], g.log_scales, g.quats])
    kept = [i for i, name in enumerate(usual) if name in names]
    table = np.hstack([table[:, kept], *(column[:, None] for column in columns.values())]).astype("<f4")
    form = "ascii" if text else "binary_little_endian"
    header = f"ply\nformat {form} 1.0\nelement vertex {len(g)}\n"
    header += "".join(f"property float {n}\n" for n in [usual[i] for i in kept] + list(columns)) + "end_header\n"
    rows = "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in table).encode() if text else table.tobytes()
    path.write_bytes(header.encode() + rows)
    return path


ALL = ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2")
ALL = (*ALL, "rot_0", "rot_1", "rot_2", "rot_3")


@pytest.mark.parametrize("text", [False, True])
def test_the_filter_of_mip_splatting_is_applied(tmp_path, text):
    """Against the formulas of its `get_scaling_with_3D_filter` and `get_opacity_with_3D_filter`."""
    g = gaussians(9001, 0)
    g.opacity_logits[:3] = 60, -60, 0
    filters = np.random.default_rng(1).uniform(0, 1.5, 9001).astype(np.float32)
    filters[2] = 0
    path = of_another_program(tmp_path / "g.ply", g, ALL, {"filter_3D": filters}, text)
    found, antialiased = read_ply(path)
    squares = np.exp(g.log_scales.astype(float)) ** 2
    grown = squares + filters[:, None].astype(float) ** 2
    shares = np.sqrt(squares.prod(axis=1) / grown.prod(axis=1))
    np.testing.assert_allclose(np.exp(found.log_scales), np.sqrt(grown), rtol=1e-5)
    alphas = shares / (1 + np.exp(-g.opacity_logits.astype(float)))
    np.testing.assert_allclose(1 / (1 + np.exp(-found.opacity_logits.astype(float))), alphas, rtol=2e-5)
    assert np.isfinite(found.opacity_logits).all() and antialiased is True
    np.testing.assert_array_equal(found.means, g.means)
    assert read_ply(of_another_program(tmp_path / "o.ply", g, ALL, {"other": filters}))[1] is None


@pytest.mark.parametrize("text", [False, True])
def test_the_disks_of_2dgs_become_flat_gaussians(tmp_path, text):
    g = gaussians(50, 0)
    names = [name for name in ALL if name != "scale_2"]
    found, _ = read_ply(of_another_program(tmp_path / "g.ply", g, names, {}, text))
    np.testing.assert_array_equal(found.log_scales[:, :2], g.log_scales[:, :2])
    assert (found.log_scales[:, 2] < found.log_scales[:, :2].min(axis=1) - 5).all()
    np.testing.assert_array_equal(found.quats, g.quats)
    with pytest.raises(InputError, match="has no property scale_1, scale_2, so it does not contain Gaussians"):
        read_ply(of_another_program(tmp_path / "g.ply", g, [n for n in names if n != "scale_1"], {}, text))


def test_values_that_are_not_finite_are_found_beyond_the_first_block(tmp_path):
    g = gaussians(20_001, 0)
    g.sh[5000, 0, 1], g.means[19_999, 2] = np.nan, np.inf
    write_ply(tmp_path / "g.ply", g, True)
    splats = read_splats(tmp_path / "g.ply")
    assert "2 of 20001 Gaussians" in splats.notes[0]
    np.testing.assert_array_equal(splats.gaussians.quats, np.delete(g.quats, [5000, 19_999], axis=0))


def damaged(tmp_path, change):
    write_ply(tmp_path / "g.ply", gaussians(5, 1), True)
    data = (tmp_path / "g.ply").read_bytes()
    (tmp_path / "g.ply").write_bytes(change(data))
    with pytest.raises(InputError) as caught:
        read_ply(tmp_path / "g.ply")
    assert "g.ply" in str(caught.value)
    return str(caught.value)


def test_damaged_ply_files_are_refused_by_name_and_reason(tmp_path):
    assert "truncated" in damaged(tmp_path, lambda d: d[:-9])
    assert "truncated" in damaged(tmp_path, lambda d: d[:60])
    assert "truncated" in damaged(tmp_path, lambda d: d.replace(b"vertex 5", b"vertex 900000000000000"))
    assert "does not begin" in damaged(tmp_path, lambda d: b"")
    assert "does not begin" in damaged(tmp_path, lambda d: b"\x89PNG" + d)
    assert "no property opacity" in damaged(tmp_path, lambda d: d.replace(b"float opacity", b"float opacitx"))
    assert "9, 24 or 45" in damaged(tmp_path, lambda d: d.replace(b"float f_rest_8", b"float g_rest_8"))
    with pytest.raises(InputError, match="absent.ply"):
        read_ply(tmp_path / "absent.ply")


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_no_damage_to_a_ply_file_does_anything_but_load_or_say_what_is_wrong(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("ply") / "g.ply"
    write_ply(path, gaussians(3, 0), True)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    try:
        read_ply(path)
    except InputError as error:
        assert "g.ply" in str(error)


@pytest.mark.parametrize("without", [(), ("background",), ("texture",), ("background", "texture")])
def test_a_model_comes_back_from_its_folder(tmp_path, without):
    saved = model(**dict.fromkeys(without))
    save_model(saved, tmp_path / "submap")
    found = load_model(tmp_path / "submap")
    assert_same_gaussians(saved.gaussians, found.gaussians)
    assert found.antialiased is saved.antialiased and found.info == saved.info
    np.testing.assert_array_equal(found.floor.heights, saved.floor.heights)
    assert (found.floor.origin, found.floor.spacing) == (saved.floor.origin, saved.floor.spacing)
    if saved.background is None:
        assert found.background is None
    else:
        assert (found.background.octaves, found.background.period) == (3, 4.5)
        assert found.background.weights.keys() == saved.background.weights.keys()
        for name, weight in saved.background.weights.items():
            np.testing.assert_array_equal(found.background.weights[name], weight)
    if saved.texture is None:
        assert found.texture is None
    else:
        assert (found.texture.low, found.texture.high) == (saved.texture.low, saved.texture.high)
        for a, b in zip(found.texture.levels, saved.texture.levels):
            np.testing.assert_array_equal(a, b)


def test_a_model_replaces_the_one_before_and_leaves_nothing_else(tmp_path):
    save_model(model(seed=1), tmp_path / "submap")
    save_model(model(seed=2), tmp_path / "submap")
    assert_same_gaussians(model(seed=2).gaussians, load_model(tmp_path / "submap").gaussians)
    assert os.listdir(tmp_path) == ["submap"]
    names = sorted(os.listdir(tmp_path / "submap"))
    assert [n.partition("-")[0] for n in names] == ["gaussians", "model.json", "networks"]


def seed_of(folder):
    """Which of the two models stands in the folder, whole."""
    found = load_model(folder)
    for seed in (1, 2):
        if np.array_equal(found.gaussians.means, gaussians(seed=seed).means):
            np.testing.assert_array_equal(found.texture.levels[1], model(seed=seed).texture.levels[1])
            return seed
    raise AssertionError("neither model")


class Killed(BaseException):
    pass


def test_a_save_killed_at_any_call_to_the_file_system_leaves_the_old_model_or_the_new(tmp_path, monkeypatch):
    outcomes = []
    for last in range(200):
        folder = tmp_path / str(last)
        save_model(model(seed=1), folder)
        left = last
        with monkeypatch.context() as patch:

            def dying(call):
                def counted(*args, **kwargs):
                    nonlocal left
                    left -= 1
                    if left < 0:  # nothing that comes after, not even cleaning up, happens
                        raise Killed
                    return call(*args, **kwargs)

                return counted

            for name in ("mkdir", "open", "chmod", "fsync", "replace", "rename", "unlink", "rmdir", "remove"):
                patch.setattr(os, name, dying(getattr(os, name)))
            try:
                save_model(model(seed=2), folder)
                finished = True
            except Killed:
                finished = False
        outcomes.append(seed_of(folder))
        if finished:
            break
        save_model(model(seed=1), folder)  # and the next one tidies up
        assert seed_of(folder) == 1 and len(os.listdir(folder)) == 3
    assert finished and last > 8 and outcomes == sorted(outcomes) and set(outcomes) == {1, 2}


SAVER = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from test_splats_files import model
from nvsim.splats.files import save_model
models = [model(seed=1), model(seed=2)]
print("ready", flush=True)
for i in range(10**6):
    save_model(models[i % 2], Path(sys.argv[2]))
"""


def test_a_process_killed_while_it_saves_leaves_one_of_the_models(tmp_path):
    folder = tmp_path / "submap"
    save_model(model(seed=1), folder)
    here = os.path.dirname(__file__)
    for wait in np.random.default_rng(0).uniform(0.02, 0.2, 3):
        words = [sys.executable, "-c", SAVER, here, str(folder)]
        with subprocess.Popen(words, stdout=subprocess.PIPE) as process:
            process.stdout.readline()
            time.sleep(wait)
            for _ in range(5):
                assert seed_of(folder) in (1, 2)  # a reader beside the writer
            process.kill()
        assert seed_of(folder) in (1, 2)


def test_a_model_of_the_first_version_is_read_and_replaced(tmp_path):
    folder = tmp_path / "submap"
    save_model(model(seed=1), folder)
    description = json.loads((folder / "model.json").read_text())
    plain = {n.partition("-")[0] + os.path.splitext(n)[1]: f for n, f in description["files"].items()}
    for old, new in zip(description["files"], plain, strict=True):
        (folder / old).rename(folder / new)
    (folder / "model.json").write_text(json.dumps({**description, "version": 1, "files": plain}))
    assert seed_of(folder) == 1
    save_model(model(seed=2), folder)
    assert seed_of(folder) == 2 and len(os.listdir(folder)) == 3


def test_a_write_that_dies_leaves_the_model_before(tmp_path, monkeypatch):
    save_model(model(seed=1), tmp_path / "submap")

    def die(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("nvsim.splats.files.safetensors.numpy.save", die)
    with pytest.raises(KeyboardInterrupt):
        save_model(model(seed=2), tmp_path / "submap")
    assert_same_gaussians(model(seed=1).gaussians, load_model(tmp_path / "submap").gaussians)
    assert os.listdir(tmp_path) == ["submap"]


def test_removed_gaussians_are_left_out_until_they_are_restored(tmp_path):
    save_model(model(), tmp_path)
    whole, removed = load_model(tmp_path), np.array([False, True, True, False, False, False, True])
    store_removed(tmp_path, removed)
    kept = load_model(tmp_path)
    np.testing.assert_array_equal(kept.gaussians.means, whole.gaussians.means[~removed])
    np.testing.assert_array_equal(load_removed(tmp_path), removed)
    assert gaussian_count(tmp_path) == 4 and removal_digest(tmp_path)
    assert_same_gaussians(load_model(tmp_path, with_removed=True).gaussians, whole.gaussians)
    store_removed(tmp_path, ~removed)
    assert len(load_model(tmp_path).gaussians) == 3 and len(list(tmp_path.glob("removed-*"))) == 1
    store_removed(tmp_path, np.zeros(7, bool))
    assert_same_gaussians(load_model(tmp_path).gaussians, whole.gaussians)
    assert removal_digest(tmp_path) == "" and not list(tmp_path.glob("removed-*"))
    with pytest.raises(ValueError, match="7 Gaussians"):
        store_removed(tmp_path, np.zeros(6, bool))


def test_a_new_model_has_no_removed_gaussians(tmp_path):
    save_model(model(), tmp_path)
    store_removed(tmp_path, np.arange(7) < 2)
    save_model(model(1), tmp_path)
    assert len(load_model(tmp_path).gaussians) == 7 and not list(tmp_path.glob("removed-*"))


@pytest.mark.parametrize("rows", [[-1], [7], [0.5]])
def test_a_list_of_removed_gaussians_that_does_not_fit_is_refused(tmp_path, rows):
    save_model(model(), tmp_path)
    store_removed(tmp_path, np.arange(7) < 2)
    (path,) = tmp_path.glob("removed-*")
    np.savez_compressed(path, rows=np.array(rows, np.float32 if rows == [0.5] else np.int32))
    about = json.loads((tmp_path / "model.json").read_text())
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    about["files"][path.name] = {"bytes": path.stat().st_size, "sha256": digest}
    (tmp_path / "model.json").write_text(json.dumps(about))
    with pytest.raises(InputError, match="damaged|a list of removed Gaussians"):
        load_model(tmp_path)
    path.write_bytes(b"")
    with pytest.raises(InputError, match="damaged"):
        load_model(tmp_path)


@pytest.mark.parametrize("name", ["gaussians", "networks", "model.json"])
def test_a_missing_truncated_or_changed_file_is_refused_by_name(tmp_path, name):
    save_model(model(), tmp_path / "submap")
    path = next((tmp_path / "submap").glob(f"{name}*"))
    data = path.read_bytes()
    for content in (b"", data[: len(data) // 2], data[:-3] + b"abc"):
        path.write_bytes(content)
        with pytest.raises(InputError, match=name):
            load_model(tmp_path / "submap")
    path.unlink()
    with pytest.raises(InputError, match="submap"):
        load_model(tmp_path / "submap")


def test_a_newer_version_and_a_missing_field_are_refused(tmp_path):
    save_model(model(), tmp_path / "submap")
    path = tmp_path / "submap" / "model.json"
    description = json.loads(path.read_text())
    path.write_text(json.dumps({**description, "version": 3}))
    with pytest.raises(InputError, match="version 3"):
        load_model(tmp_path / "submap")
    for key in ("files", "floor", "texture", "background", "antialiased", "info"):
        path.write_text(json.dumps({k: v for k, v in description.items() if k != key}))
        with pytest.raises(InputError, match="damaged"):
            load_model(tmp_path / "submap")
