"""For any content of the files, a reader returns a capture or raises InputError. It never raises another exception or
hangs."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import capture_samples as sample
import cv2
import numpy as np
import pytest
import test_capture_clouds as clouds
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nvsim.capture.check import check
from nvsim.capture.findings import Findings
from nvsim.capture.images import decode
from nvsim.capture.multi_capture import listed_captures
from nvsim.capture.pointcloud import read_cloud
from nvsim.capture.read import read
from nvsim.capture.store import load_capture, save_capture
from nvsim.errors import InputError

# Processor time is what counts (see `survives`): a clock would judge the machine's other work.
SETTINGS = settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow])
POSES, POINTS = sample.walk(4), sample.room(60)

numbers = st.one_of(
    st.sampled_from([0, -1, 1, 2**31, 2**64, 10**400, -1e308, 1e308, 1e-320, float("nan"), float("inf")]),
    st.integers(-300, 300),
    st.floats(),
)
texts = st.one_of(
    st.sampled_from(["", "/", "..", "images", "a\0b", "\ud800", "x" * 5000, "OPENCV", "sparse_pc.ply", "cloud.ply"]),
    st.text(max_size=8),
)
leaves = st.one_of(st.none(), st.booleans(), numbers, texts)
trees = st.recursive(leaves, lambda t: st.lists(t, max_size=4) | st.dictionaries(texts, t, max_size=3), max_leaves=8)


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    base = tmp_path_factory.mktemp("fuzz")
    sample.write_nerfstudio(base / "nerfstudio", POSES, POINTS)
    sample.write_colmap(base / "binary", POSES, POINTS, binary=True)
    sample.write_colmap(base / "text", POSES, POINTS, binary=False)
    sample.write_kapture(base / "kapture", POSES, POINTS, rig=POSES[1])
    return {p.name: p for p in base.iterdir()}


def survives(action: Callable[[], Any]) -> None:
    began = time.process_time()
    try:
        action()
    except InputError as error:
        assert str(error) and "\n" not in str(error).replace("\\n", "")
    assert time.process_time() - began < 2


def places(tree: Any, path: tuple = ()) -> list[tuple]:
    found = [path]
    if isinstance(tree, dict):
        found += [p for k, v in tree.items() for p in places(v, (*path, k))]
    elif isinstance(tree, list):
        found += [p for i, v in enumerate(tree[:3]) for p in places(v, (*path, i))]
    return found


def replaced(tree: Any, path: tuple, value: Any) -> Any:
    if not path:
        return value
    copy = dict(tree) if isinstance(tree, dict) else list(tree)
    copy[path[0]] = replaced(tree[path[0]], path[1:], value)
    return copy


@SETTINGS
@given(data=st.data())
def test_any_json_tree(originals: dict[str, Path], data: st.DataObject) -> None:
    folder = originals["nerfstudio"]
    tree = sample.nerfstudio_tree(POSES, [f"{i:03d}.png" for i in range(4)])
    for _ in range(data.draw(st.integers(1, 3))):
        tree = replaced(tree, data.draw(st.sampled_from(places(tree))), data.draw(trees))
    with tempfile.NamedTemporaryFile("w", dir=folder, suffix=".json", encoding="utf-8") as file:
        file.write(json.dumps(tree))
        file.flush()
        survives(lambda: read(Path(file.name)))
        check(Path(file.name))


def mutations(data: st.DataObject, content: bytes) -> bytes:
    """Bytes overwritten, cut out, doubled or cut off, at drawn places."""
    changed = bytearray(content)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, max(0, len(changed) - 1)))
        match data.draw(st.sampled_from(["set", "drop", "double", "cut", "word"])):
            case "set":
                changed[at : at + 1] = data.draw(st.binary(min_size=1, max_size=8))
            case "drop":
                del changed[at : at + data.draw(st.integers(1, 40))]
            case "double":
                changed[at:at] = changed[at : at + data.draw(st.integers(1, 200))]
            case "cut":
                del changed[at:]
            case _:
                changed[at:at] = data.draw(
                    st.sampled_from([b"nan", b"1e999", b"-1", b",", b"\n", b" ", b"9" * 30, b"#"])
                )
    return bytes(changed)


def file_fuzz(originals: dict[str, Path], name: str, files: list[str], data: st.DataObject) -> None:
    folder = originals[name]
    path = folder / data.draw(st.sampled_from(files))
    content = path.read_bytes()
    try:
        path.write_bytes(mutations(data, content))
        survives(lambda: read(folder))
        check(folder)
    finally:
        path.write_bytes(content)


@SETTINGS
@given(data=st.data())
def test_any_json_bytes(originals: dict[str, Path], data: st.DataObject) -> None:
    file_fuzz(originals, "nerfstudio", ["transforms.json", "cloud.ply", "images/001.png"], data)


@SETTINGS
@given(data=st.data())
def test_any_colmap_binary(originals: dict[str, Path], data: st.DataObject) -> None:
    file_fuzz(originals, "binary", [f"sparse/0/{n}.bin" for n in ("cameras", "images", "points3D")], data)


@SETTINGS
@given(data=st.data())
def test_any_colmap_text(originals: dict[str, Path], data: st.DataObject) -> None:
    file_fuzz(originals, "text", [f"sparse/0/{n}.txt" for n in ("cameras", "images", "points3D")], data)


@SETTINGS
@given(data=st.data())
def test_any_kapture(originals: dict[str, Path], data: st.DataObject) -> None:
    names = ["sensors", "rigs", "trajectories", "records_camera", "records_lidar"]
    file_fuzz(originals, "kapture", [f"sensors/{n}.txt" for n in names], data)


@settings(SETTINGS, max_examples=300)
@given(data=st.data())
def test_any_cloud(data: st.DataObject) -> None:
    content = mutations(data, clouds.FILES[data.draw(st.sampled_from(sorted(clouds.FILES)))])
    with tempfile.NamedTemporaryFile(suffix=".ply") as file:
        file.write(content)
        file.flush()
        survives(lambda: read_cloud(Path(file.name), Findings()))


@settings(SETTINGS, max_examples=200)
@given(
    st.binary(max_size=300),
    st.sampled_from([b"", b"ply\n", b"VERSION 0.7\nFIELDS x y z\n", b"ply\nformat ascii 1.0\n"]),
)
def test_any_bytes_as_a_cloud(content: bytes, head: bytes) -> None:
    with tempfile.NamedTemporaryFile() as file:
        file.write(head + content)
        file.flush()
        survives(lambda: read_cloud(Path(file.name), Findings()))


@pytest.fixture(scope="module")
def stored(originals: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stored")
    save_capture(read(originals["nerfstudio"]), folder)
    (folder / "whole.json").write_bytes((folder / "capture.json").read_bytes())
    return folder


@SETTINGS
@given(data=st.data())
def test_any_value_in_a_stored_capture(stored: Path, data: st.DataObject) -> None:
    tree = json.loads((stored / "whole.json").read_text())
    for _ in range(data.draw(st.integers(1, 3))):
        tree = replaced(tree, data.draw(st.sampled_from(places(tree))), data.draw(trees))
    (stored / "capture.json").write_text(json.dumps(tree))
    survives(lambda: load_capture(stored))


@SETTINGS
@given(data=st.data())
def test_any_bytes_in_a_stored_capture(stored: Path, data: st.DataObject) -> None:
    (stored / "capture.json").write_bytes((stored / "whole.json").read_bytes())
    path = data.draw(st.sampled_from([stored / "capture.json", next(stored.glob("cloud-*.npz"))]))
    content = path.read_bytes()
    try:
        path.write_bytes(mutations(data, content))
        survives(lambda: load_capture(stored))
    finally:
        path.write_bytes(content)


IMAGE = np.add.outer(np.arange(24), np.arange(32)).astype(np.uint8)
ENCODED = [cv2.imencode(s, IMAGE)[1].tobytes() for s in (".png", ".jpg", ".webp", ".bmp", ".tiff", ".pgm")]


@settings(SETTINGS, max_examples=300)
@given(data=st.data())
def test_any_bytes_in_an_image(data: st.DataObject) -> None:
    content = mutations(data, data.draw(st.sampled_from(ENCODED)))
    with tempfile.NamedTemporaryFile() as file:
        file.write(content)
        file.flush()
        survives(lambda: decode(Path(file.name)))


@SETTINGS
@given(st.binary(max_size=60) | st.lists(texts, max_size=4).map(lambda words: "\n".join(words).encode(errors="ignore")))
def test_any_list_of_captures(content: bytes) -> None:
    with tempfile.NamedTemporaryFile(suffix=".captures") as file:
        file.write(content)
        file.flush()
        survives(lambda: listed_captures(Path(file.name)))
        check(Path(file.name))
