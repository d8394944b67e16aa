"""Damaged files of training and of the window give one sentence each, or are treated as missing."""

from __future__ import annotations

import io
import json
import os
import struct
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy
from hypothesis import given, settings
from hypothesis import strategies as st
from test_splats_files import model

from nvsim.errors import InputError
from nvsim.geometry.camera_path import KeyPose, read_camera_path, write_camera_path
from nvsim.graph.store import decode_evidence, decode_graph, encode_evidence, encode_graph
from nvsim.graph.types import Edge, Evidence, NavGraph, Viewpoint
from nvsim.splats.files import load_model, memory_needed, save_model
from nvsim.training.checkpoint import Checkpoint, check_shapes, load, save

MEGABYTE = 1 << 20


def refused(read: Callable[[], Any], size: int, words: str = "") -> None:
    tracemalloc.start()
    try:
        with pytest.raises(InputError) as caught:
            read()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 64 * MEGABYTE + 10 * size
    assert words in str(caught.value) and "\n" not in str(caught.value)


# Model folders -------------------------------------------------------------------------------------------------------


def described(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    data = json.loads((folder / "model.json").read_text())
    change(data)
    (folder / "model.json").write_text(json.dumps(data))


def put(*path: str, value: object) -> Callable[[dict[str, Any]], object]:
    def change(data: dict[str, Any]) -> None:
        for key in path[:-1]:
            data = data[key]
        data[path[-1]] = value

    return change


@pytest.mark.parametrize(
    "change",
    [
        put("files", value=[]),
        put("files", value=3),
        put("files", value={"gaussians-../x.ply": {}, "networks-a.safetensors": {}}),
        put("version", value=10**400),
        put("background", value=[]),
        put("background", "octaves", value=10**9),
        put("background", "period", value=0),
        put("texture", "levels", value=10**9),
        put("texture", "low", value=[1]),
        put("texture", "low", value=[1e999, 0]),
        put("floor", "spacing", value="x"),
        put("floor", "spacing", value=-1),
        put("floor", "origin", value=[None, 0]),
        put("floor", value=None),
        put("info", value=3),
        put("appearance", value={"kind": []}),
        put("appearance", value=7),
    ],
    ids=range(17),
)
def test_a_description_that_does_not_fit_its_files_is_refused(tmp_path: Path, change: Any) -> None:
    save_model(model(), tmp_path)
    described(tmp_path, change)
    refused(lambda: load_model(tmp_path), 10_000, str(tmp_path))


@pytest.mark.parametrize(
    "text", [b"", b"[" * 200_000, b"\xff\xfe", b"[]", b'{"format": ' + b"9" * 5000 + b"}", b"{" * 9]
)
def test_a_description_that_is_none_is_refused(tmp_path: Path, text: bytes) -> None:
    save_model(model(), tmp_path)
    (tmp_path / "model.json").write_bytes(text)
    for read in (load_model, memory_needed):
        refused(lambda read=read: read(tmp_path), len(text), "model.json")  # type: ignore[misc]


@pytest.mark.parametrize("value", ["x", 1e999, None, [], "9" * 5000])
def test_a_description_with_counts_that_are_none_is_refused(tmp_path: Path, value: object) -> None:
    save_model(model(), tmp_path)
    for name in ("count", "sh_degree"):
        described(tmp_path, put(name, value=value))
        refused(lambda: memory_needed(tmp_path), 1000, "train this submap again")


def renamed(folder: Path, start: str, data: bytes) -> None:
    """Puts other content in place of a file, with the fingerprint that a maker of such files would give it."""
    import hashlib

    def change(description: dict[str, Any]) -> None:
        name = next(n for n in description["files"] if n.startswith(start))
        (folder / name).write_bytes(data)
        description["files"][name] = {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}

    described(folder, change)


def tensors(**changes: Any) -> bytes:
    arrays = {
        "floor.heights": np.zeros((2, 2), np.float32),
        "background.base.weight": np.zeros((3, 4), np.float32),
        "background.base.bias": np.zeros(3, np.float32),
        "texture.0": np.zeros((2, 3, 3), np.float32),
        "texture.1": np.zeros((8, 5, 3), np.float32),
        **changes,
    }
    return safetensors.numpy.save({name: array for name, array in arrays.items() if array is not None})


def header(text: str, body: bytes = b"") -> bytes:
    return struct.pack("<Q", len(text)) + text.encode() + body


@pytest.mark.parametrize(
    "data",
    [
        b"",
        bytes(8),
        struct.pack("<Q", 1 << 60) + b"{}",
        header("[" * 100_000),
        header('{"floor.heights":{"dtype":"F32","shape":[100000000,100000000],"data_offsets":[0,16]}}', bytes(16)),
        header('{"floor.heights":{"dtype":"F32","shape":[2,2],"data_offsets":[0,1600000000000]}}', bytes(16)),
        tensors(**{"floor.heights": np.zeros(4, np.float32)}),
        tensors(**{"floor.heights": np.zeros((0, 4), np.float32)}),
        tensors(**{"floor.heights": np.full((2, 2), np.nan, np.float32)}),
        tensors(**{"texture.1": np.zeros((2, 2), np.float32)}),
        tensors(**{"texture.1": None}),
        tensors(**{"background.embed.0.weight": np.zeros((5, 7), np.float32)}),
        tensors(**{"background.index.vectors": np.zeros((5, 9), np.float32)}),
    ],
    ids=range(13),
)
def test_networks_whose_header_lies_or_whose_shapes_do_not_fit_are_refused(tmp_path: Path, data: bytes) -> None:
    save_model(model(), tmp_path)
    renamed(tmp_path, "networks", data)
    refused(lambda: load_model(tmp_path), len(data), "train this submap again")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"element vertex 7", b"element vertex 999999999999"),
        (b"element vertex 7", b"element vertex " + b"9" * 5000),
        (b"element vertex 7", b"element vertex 8"),
        (b"f_rest_44", b"more_44"),
        (b"end_header", b"".join(b"property float p%d\n" % i for i in range(2000)) + b"end_header"),
        (b"ply", b""),
    ],
    ids=range(6),
)
def test_a_model_file_with_a_false_header_is_refused(tmp_path: Path, old: bytes, new: bytes) -> None:
    save_model(model(), tmp_path)
    data = next(tmp_path.glob("gaussians*")).read_bytes()
    assert old in data
    renamed(tmp_path, "gaussians", data.replace(old, new, 1))
    refused(lambda: load_model(tmp_path), len(data), "train this submap again")


# Checkpoints ---------------------------------------------------------------------------------------------------------


def kept(path: Path) -> bytes:
    save(path, Checkpoint(3, {"fit/sums": np.ones((4, 3), np.float32)}, {"order": []}), "key")
    return path.read_bytes()


def test_a_checkpoint_that_unpacks_to_gigabytes_or_announces_them_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.ckpt"
    kept(path)
    with np.load(path) as file:
        about = file["about"]
    with open(path, "wb") as stream:
        np.savez_compressed(stream, about=about, big=np.zeros(30 * MEGABYTE))
    refused(lambda: load(path, "key"), path.stat().st_size, "delete it to train from the start")
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f4", "fortran_order": False, "shape": (10**11,)})
    with zipfile.ZipFile(path, "w") as archive:
        whole = io.BytesIO()
        np.save(whole, about)
        archive.writestr("about.npy", whole.getvalue())
        archive.writestr("big.npy", head.getvalue() + bytes(100))
    refused(lambda: load(path, "key"), path.stat().st_size, "delete it to train from the start")


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_checkpoint_with_other_bytes_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("changed") / "a.ckpt"
    path.write_bytes(mutated(kept(path), data))
    try:
        load(path, "key")
    except InputError as error:
        assert "a.ckpt" in str(error)


def mutated(content: bytes, data: st.DataObject) -> bytes:
    changed = bytearray(content)
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(changed)))
        changed[at : at + data.draw(st.integers(0, 6))] = data.draw(st.binary(max_size=6))
    return bytes(changed)


@pytest.mark.parametrize(
    "change",
    [
        {"fit/sums": None},
        {"fit/sums": np.zeros((4, 3))},
        {"fit/means.values": np.zeros((4, 2), np.float32)},
        {"fit/means.values": np.zeros((9, 3), np.float32)},
        {"fit/means.values": np.full((4, 3), np.nan, np.float32)},
        {"robust/errors": np.zeros((5, 2), np.float32)},
    ],
    ids=range(6),
)
def test_arrays_that_cannot_take_the_place_of_a_training_are_refused(change: dict[str, Any]) -> None:
    def arrays(count: int) -> dict[str, Any]:
        return {
            "fit/sums": np.zeros((count, 3), np.float32),
            "fit/means.values": np.zeros((count, 3), np.float32),
            "robust/errors": np.zeros((5, 7), np.float32),
        }

    of_gaussians = {"fit/sums", "fit/means.values"}
    check_shapes(arrays(7), arrays(4), of_gaussians)  # refined since
    stored = {name: array for name, array in {**arrays(4), **change}.items() if array is not None}
    with pytest.raises(ValueError):
        check_shapes(arrays(7), stored, of_gaussians)


# Evidence and graphs -------------------------------------------------------------------------------------------------


def evidence() -> Evidence:
    cells = np.zeros((4, 5), np.uint8)
    return Evidence("a", 0, 0.5, 2.0, cells, cells, cells.astype(bool), 0.5, 0.1, 0.6, 0, (1.0, 2.0), "b", "open")


def graph() -> NavGraph:
    viewpoints = {id: Viewpoint(id, (1.0, 2.0, 1.5)) for id in "ab"}
    return NavGraph("house", viewpoints, {("a", "b"): Edge("a", "b")}, {("a", 0): evidence()}, {"x": "y"})


def blob(header: dict[str, Any] | bytes, cells: bytes) -> bytes:
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<BI", 1, len(text)) + text + zlib.compress(cells, 9)


def header_of(**changes: Any) -> dict[str, Any]:
    data = encode_evidence(evidence())
    size = struct.unpack_from("<BI", data)[1]
    return {**json.loads(data[5 : 5 + size]), **changes}


@pytest.mark.parametrize(
    "pack",
    [
        lambda: blob(header_of(), bytes(300 * MEGABYTE)),
        lambda: blob(header_of(shape=[20_000, 20_000]), bytes(800 * MEGABYTE // 8)),
        lambda: blob(header_of(shape=[-4, -5]), bytes(43)),
        lambda: blob(header_of(shape=["4", 5]), bytes(43)),
        lambda: blob(header_of(shape=[10**400, 1]), bytes(43)),
        lambda: blob(header_of(heading="x"), bytes(43)),
        lambda: blob(header_of(heading=1e999), bytes(43)),
        lambda: blob(header_of(direction=True), bytes(43)),
        lambda: blob(header_of(target=[1e999, 0]), bytes(43)),
        lambda: blob(header_of(viewpoint=[1]), bytes(43)),
        lambda: blob(b"[" * 100_000, bytes(43)),
        lambda: blob(b"9" * 5000, bytes(43)),
        lambda: blob(b"[]", bytes(43)),
        lambda: b"",
    ],
    ids=range(14),
)
def test_evidence_with_false_sizes_is_refused(pack: Callable[[], bytes]) -> None:
    data = pack()
    refused(lambda: decode_evidence(data), len(data), "damaged")


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_evidence_and_graphs_with_other_bytes_are_read_or_refused(data: st.DataObject) -> None:
    for content, decode in ((encode_evidence(evidence()), decode_evidence), (encode_graph(graph()), decode_graph)):
        try:
            decode(mutated(content, data))
        except InputError as error:
            assert "damaged" in str(error) or "newer" in str(error)


def packed(index: Any, data: bytes = b"") -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("graph.json", index if isinstance(index, bytes) else json.dumps(index))
        archive.writestr("evidence.bin", data)
    return out.getvalue()


INDEX: dict[str, Any] = {"version": 1, "scan": "a", "viewpoints": [], "edges": [], "evidence": []}


@pytest.mark.parametrize(
    "pack",
    [
        lambda: packed(b" " * (200 * MEGABYTE)),
        lambda: packed(INDEX, bytes(200 * MEGABYTE)),
        lambda: packed(b"[" * 100_000),
        lambda: packed({**INDEX, "viewpoints": [["a", ["x", 0, 0]]]}),
        lambda: packed({**INDEX, "viewpoints": [["a", [1e999, 0, 0]]]}),
        lambda: packed({**INDEX, "viewpoints": [["a", [0, 0, 0], "high"]]}),
        lambda: packed({**INDEX, "viewpoints": [[3, [0, 0, 0]]]}),
        lambda: packed({**INDEX, "ignored": [1]}),
        lambda: packed({**INDEX, "ignored": {"a": 1}}),
        lambda: packed({**INDEX, "evidence": [0] * 10}),
        lambda: packed({**INDEX, "evidence": [-5]}),
    ],
    ids=range(11),
)
def test_a_graph_record_with_false_counts_is_refused(pack: Callable[[], bytes]) -> None:
    data = pack()
    refused(lambda: decode_graph(data), len(data), "damaged")


# Camera paths and the window's keeping -------------------------------------------------------------------------------

KEYS = [KeyPose((0.0, 1.0, 2.0)), KeyPose((1.0, 1.0, 2.0), 0.5)]


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"\xff\xff",
        b"[" * 100_000,
        b'{"keys": ' + b"9" * 5000 + b"}",
        b'{"keys": 3}',
        b'{"keys": [1, 2]}',
        b'{"keys": [{"position": "123", "heading": 0, "elevation": 0, "fov": 1}]}',
        b'{"keys": [{"position": [1, 2, 1e300], "heading": 0, "elevation": 0, "fov": 1}]}',
        b'{"keys": [{"position": [1, 2, ' + b"9" * 400 + b'], "heading": 0, "elevation": 0, "fov": 1}]}',
        b'{"keys": [{"position": [1, 2, true], "heading": 0, "elevation": 0, "fov": 1}]}',
        b'{"keys": [{"position": [1, 2, NaN], "heading": 0, "elevation": 0, "fov": 1}]}',
        b'{"keys": [' + b'{"position":[1,2,3],"heading":0,"elevation":0,"fov":1},' * 20_000 + b"0]}",
    ],
    ids=range(12),
)
def test_a_camera_path_that_is_none_is_refused(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "way.json"
    path.write_bytes(text)
    refused(lambda: read_camera_path(path), len(text), "way.json")


def test_a_camera_path_that_is_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "way.json")
    refused(lambda: read_camera_path(tmp_path / "way.json"), 0, "it is a pipe")


@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_a_camera_path_with_other_bytes_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("changed") / "way.json"
    write_camera_path(path, KEYS)
    path.write_bytes(mutated(path.read_bytes(), data))
    try:
        read_camera_path(path).frames(7)
    except InputError as error:
        assert "way.json" in str(error)
