"""Connectivity files, lists of scans and notes that lie or are damaged: one sentence each, in little memory."""

from __future__ import annotations

import json
import os
import threading
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.errors import InputError
from nvsim.graph.connectivity import list_scan, read_connectivity
from nvsim.graph.foreign import ForeignFile, connectivity_files
from nvsim.graph.foreign.notes import read_original

MEGABYTE = 1 << 20
READERS: list[Callable[[Path], Any]] = [ForeignFile.open, read_connectivity]


def entry(name: str = "a", count: int = 1, **changes: Any) -> dict[str, Any]:
    pose = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    flags = [False] * count
    return {"image_id": name, "pose": pose, "included": True, "visible": flags, "unobstructed": flags, **changes}


def posed(at: int, value: float) -> list[float]:
    pose: list[float] = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    pose[at] = value
    return pose


def refused(read: Callable[[Path], Any], path: Path, words: str = "house") -> None:
    started = time.monotonic()
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=words) as caught:
            read(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 64 * MEGABYTE + 10 * path.stat().st_size
    assert time.monotonic() - started < 60  # tracing makes it several times slower
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 1000


def laid(folder: Path, text: str | bytes) -> Path:
    path = folder / "house_connectivity.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize(
    "change",
    [
        {"pose": posed(3, 1e308)},
        {"pose": posed(11, -1e8)},
        {"pose": posed(0, 1e308)},
        {"pose": [1e308, -1e308, 1e308, 0, 1e308, 1e308, -1e308, 0, 1e308, 1e308, 1e308, 0, 0, 0, 0, 1]},
        {"pose": posed(3, float("nan"))},
        {"pose": posed(3, float("inf"))},
        {"pose": "x" * 16},
        {"pose": [[1] * 4] * 4},
        {"pose": None},
        {"height": 1e999},
        {"height": [1]},
        {"included": 2},
        {"image_id": "\ud800"},
        {"image_id": "x" * 5000},
        {"image_id": {}},
        {"image_id": ""},
        {"unobstructed": [None]},
        {"unobstructed": {}},
        {"unobstructed": "true"},
        {"unobstructed": [2]},
        {"visible": [1.5]} | {"unobstructed": 1},
    ],
    ids=range(21),
)
def test_an_entry_with_values_that_cannot_be_is_named(tmp_path: Path, read: Any, change: dict[str, Any]) -> None:
    refused(read, laid(tmp_path, json.dumps([entry(**change)])))


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize("key", ["image_id", "pose", "included", "height", "unobstructed", "other"])
@pytest.mark.parametrize("value", ["9" * 5000, "[" * 100_000, '{"a":' * 100_000, "-" + "1" * 10_000, "tru", "\x01"])
def test_numbers_of_thousands_of_digits_and_deep_nests_are_refused(
    tmp_path: Path, read: Any, key: str, value: str
) -> None:
    text = json.dumps([{**entry(), key: "HERE"}]).replace('"HERE"', value)
    refused(read, laid(tmp_path, text))


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"\xff\xfe[\0]\0",
        b"[",
        b"{}",
        b"[[]]",
        b"[1]",
        b"null",
        b"[" * 500_000,
        b"NaN",
        b"[{}]",
        b"[" + json.dumps(entry()).encode().replace(b'"pose"', b'"image_id": "b", "pose"') + b"]",
    ],
    ids=range(11),
)
def test_what_is_no_list_of_viewpoints_is_refused(tmp_path: Path, read: Any, text: bytes) -> None:
    refused(read, laid(tmp_path, text))


def test_a_million_entries_without_their_flags_take_no_square_of_memory(tmp_path: Path) -> None:
    one = json.dumps(entry("HERE", 0), separators=(",", ":"))
    text = "[" + ",".join(one.replace("HERE", f"{i:x}") for i in range(200_000)) + "]"
    refused(ForeignFile.open, laid(tmp_path, text), "too short to hold a list of flags")


def test_an_entry_of_very_many_keys_is_refused(tmp_path: Path) -> None:
    keys = ",".join(f'"{i:x}":0' for i in range(500_000))
    refused(ForeignFile.open, laid(tmp_path, json.dumps([entry()])[:-2] + "," + keys + "}]"), "more than 1000 keys")


def test_a_byte_order_mark_is_no_reason(tmp_path: Path) -> None:
    text = "\ufeff" + json.dumps([entry("a", 2), entry("b", 2)])
    assert len(ForeignFile.open(laid(tmp_path, text)).graph.viewpoints) == 2
    assert len(read_connectivity(laid(tmp_path, text)).viewpoints) == 2


@pytest.mark.parametrize("scan", ["x" * 300, "x" * 100_000, "../house", "a\0b", "\x1b[2J", "house/../house"])
def test_a_scan_that_no_file_can_be_called_after_is_named(tmp_path: Path, scan: str) -> None:
    laid(tmp_path, json.dumps([entry()]))
    (tmp_path / "scans.txt").write_text(f"house\n{scan}\n")
    with pytest.raises(InputError, match="scans.txt lists") as caught:
        connectivity_files(tmp_path)
    assert len(str(caught.value)) <= 1000 and str(caught.value).isprintable()


def test_a_list_of_scans_that_is_no_text_or_no_file_is_refused(tmp_path: Path) -> None:
    listed = tmp_path / "scans.txt"
    listed.write_bytes(b"\xff\xfe\0")
    for read in (lambda: connectivity_files(tmp_path), lambda: list_scan(listed, "house")):
        with pytest.raises(InputError, match="scans.txt"):
            read()
    listed.unlink()
    os.mkfifo(listed)
    in_time(lambda: connectivity_files(tmp_path), "it is a pipe")
    listed.unlink()
    listed.mkdir()
    in_time(lambda: connectivity_files(tmp_path), "it is a folder")


def in_time(read: Callable[[], Any], words: str) -> None:
    """Refused, and not waited for."""
    found: list[str] = []

    def run() -> None:
        try:
            read()
        except InputError as error:
            found.append(str(error))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(10)
    assert found and words in found[0]


@pytest.mark.parametrize("read", READERS)
def test_a_pipe_a_folder_and_a_device_are_no_connectivity_files(tmp_path: Path, read: Any) -> None:
    os.mkfifo(tmp_path / "pipe.json")
    (tmp_path / "folder.json").mkdir()
    (tmp_path / "device.json").symlink_to("/dev/zero")
    for name, words in (("pipe", "it is a pipe"), ("folder", "it is a folder"), ("device", "a device")):
        in_time(lambda name=name: read(tmp_path / f"{name}.json"), words)  # type: ignore[misc]


def test_an_over_long_name_of_a_file_is_refused(tmp_path: Path) -> None:
    for read in (*READERS, lambda p: ForeignFile.open(connectivity_files(p)[0])):
        with pytest.raises(InputError, match="too long"):
            read(tmp_path / ("x" * 300 + "_connectivity.json"))


@pytest.mark.parametrize(
    "notes",
    [
        b"",
        b"[]",
        b"3",
        b"[" * 200_000,
        b'{"ignored":' * 200_000,
        b'{"ignored": ' + b"9" * 5000 + b"}",
        b'{"ignored": []}',
        b'{"ignored": 3}',
        b'{"reviewed": {"edges": [3]}}',
        b'{"reviewed": {"edges": [[1, 2, 3]]}}',
        b'{"reviewed": {"edges": [[[], {}]]}}',
        b'{"reviewed": []}',
        b'{"reviewed": {"viewpoints": 3}}',
        b'{"reviewed": {}, "reviewed": {}}',
        b'{"locked": NaN}',
        b"\xff\xff",
        b'{"x":[' + b"[]," * 1_000_000 + b"[]]}",
    ],
    ids=range(17),
)
def test_notes_that_are_damaged_are_refused_with_what_to_do(tmp_path: Path, notes: bytes) -> None:
    path = laid(tmp_path, json.dumps([entry("a", 2), entry("b", 2)]))
    (tmp_path / "house_review.json").write_bytes(notes)
    tracemalloc.start()
    with pytest.raises(InputError, match=r"house_review\.json.*(mend|move it away)"):
        ForeignFile.open(path)
    assert tracemalloc.get_traced_memory()[1] < 64 * MEGABYTE + 10 * len(notes)
    tracemalloc.stop()


def test_notes_that_are_a_pipe_are_not_waited_for(tmp_path: Path) -> None:
    path = laid(tmp_path, json.dumps([entry()]))
    os.mkfifo(tmp_path / "house_review.json")
    in_time(lambda: ForeignFile.open(path), "it is a pipe")


@pytest.mark.timeout(20)
def test_an_original_is_not_read_from_a_pipe(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "house_review.json")
    assert read_original(tmp_path / "house_review.json") is None


def pictured(folder: Path, data: bytes, id: str = "a") -> ForeignFile:
    pictures = folder / "matterport_skybox_images"
    pictures.mkdir()
    (pictures / f"{id}_skybox_small.jpg").write_bytes(data)
    return ForeignFile.open(laid(folder, json.dumps([entry(id)])))


def jpeg(width: int, height: int) -> bytes:
    return bytes(cv2.imencode(".jpg", np.zeros((height, width, 3), np.uint8))[1])


def test_a_picture_that_says_to_have_gigapixels_is_not_decoded(tmp_path: Path) -> None:
    small = jpeg(60, 10)
    at = small.index(b"\xff\xc0") + 5
    huge = small[:at] + (10_000).to_bytes(2, "big") + (60_000).to_bytes(2, "big") + small[at + 4 :]
    with pytest.raises(InputError, match="60000 x 10000 pixels"):
        pictured(tmp_path, huge).panorama("a", 64)


@pytest.mark.parametrize("data", [b"", b"\xff\xd8\xff", b"GIF89a" + bytes(99), jpeg(60, 10)[:300]], ids=range(4))
def test_a_picture_that_is_none_is_refused(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(InputError, match="a_skybox_small"):
        pictured(tmp_path, data).panorama("a", 64)


@pytest.mark.parametrize("id", ["../a", "/etc/a", "x" * 900, "a\0"])
def test_an_id_that_leads_elsewhere_has_no_pictures(tmp_path: Path, id: str) -> None:
    pictured(tmp_path, jpeg(60, 10))
    file = ForeignFile.open(laid(tmp_path, json.dumps([entry(id)])))
    assert file.panorama(id, 64) is None


WHOLE = json.dumps([entry("a", 3), entry("b", 3, extra={"x": [1, "]"]}), entry("c", 3, height=1.4)]).encode()
NOTES = json.dumps({"ignored": {"a": "b"}, "reviewed": {"viewpoints": ["a"], "edges": [["a", "b"]]}}).encode()


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize("target", ["graph", "notes"])
@settings(max_examples=120, deadline=None)
@given(data=st.data())
def test_bytes_changed_added_and_taken_away_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, read: Any, target: str, data: st.DataObject
) -> None:
    content = bytearray(WHOLE if target == "graph" else NOTES)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content)))
        words = st.sampled_from([b"[", b"]", b"{", b"1e999", b"NaN", b'"', b"\\ud800", b"null", b"-"])
        content[at : at + data.draw(st.integers(0, 8))] = data.draw(st.one_of(st.binary(max_size=8), words))
    folder = tmp_path_factory.mktemp("changed")
    path = laid(folder, bytes(content) if target == "graph" else WHOLE)
    (folder / "house_review.json").write_bytes(NOTES if target == "graph" else bytes(content))
    try:
        read(path)
    except InputError as error:
        assert "house" in str(error) and "\n" not in str(error)
