"""Classify a path: all commands and the window get the same answer for every kind of file."""

import json
import os
import socket
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.errors import InputError
from nvsim.project.path_kind import PathKind, check_openable, path_kind, sentence_about
from nvsim.project.project import Project


def made(root: Path, name: str, text: str = "") -> Path:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("name", "text", "kind"),
    [
        ("house_connectivity.json", "[]", "graph"),
        ("house_connectivity.json", "{", "graph"),  # damaged, which its reader says
        ("house.json", ' \n[{"image_id": "a"}]', "graph"),
        ("transforms.json", '{"frames": []}', "capture"),
        ("walk.json", "\ufeff{}", "capture"),
        ("empty.json", "", "unknown"),
        ("meta.json", "{}", "splats"),
        ("scene.ply", "ply\n", "splats"),
        ("scene", "ply\n", "splats"),
        ("house.splats", "a.ply\n", "splats"),
        ("map.yaml", "image: map.pgm", "occupancy map"),
        ("map.BT", "# Octomap", "occupancy map"),
        ("two.captures", "a\nb\n", "capture"),
        ("notes.txt", "hello", "unknown"),
    ],
)
def test_a_file_is_told_by_its_name_and_its_first_bytes(tmp_path: Path, name: str, text: str, kind: PathKind) -> None:
    assert path_kind(made(tmp_path, name, text)) == kind


@pytest.mark.parametrize(
    ("names", "kind"),
    [
        ([], "unknown"),
        (["readme.txt"], "unknown"),
        (["scans.txt"], "graph folder"),
        (["house_connectivity.json"], "graph folder"),
        (["transforms.json", "images/1.jpg"], "capture"),
        (["sparse/0/cameras.bin", "sparse/0/images.bin"], "capture"),
        (["sensors/sensors.txt"], "capture"),
        (["transforms.json", "house_connectivity.json"], "graph folder"),
    ],
)
def test_a_folder_is_told_by_what_lies_in_it(tmp_path: Path, names: list[str], kind: PathKind) -> None:
    for name in names:
        made(tmp_path, name)
    assert path_kind(tmp_path) == kind


def test_a_project_is_one_whatever_else_lies_in_it(tmp_path: Path) -> None:
    Project.create_or_open(tmp_path / "house.nvsim").close()
    made(tmp_path / "house.nvsim", "transforms.json", "{}")
    made(tmp_path / "house.nvsim", "scans.txt")
    assert path_kind(tmp_path / "house.nvsim") == "project"
    check_openable(tmp_path / "house.nvsim")


def test_a_link_means_what_it_leads_to_and_a_ring_of_links_nothing_that_can_be_read(tmp_path: Path) -> None:
    made(tmp_path, "walk/transforms.json", "{}")
    (tmp_path / "link").symlink_to("walk")
    (tmp_path / "lost").symlink_to("gone")
    (tmp_path / "ring").symlink_to("ring")
    kinds = [path_kind(tmp_path / name) for name in ("link", "lost", "ring")]
    assert kinds == ["capture", "nothing", "unreadable"]


@pytest.mark.parametrize("name", ["pipe", "pipe.ply", "pipe.json", "a_connectivity.json", "map.yaml", "cameras.bin"])
def test_a_pipe_is_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    assert path_kind(tmp_path / name) == "unreadable"
    with pytest.raises(InputError):
        check_openable(tmp_path / name)


def test_pipes_in_a_folder_are_no_files_of_a_capture(tmp_path: Path) -> None:
    for name in ("project.db", "transforms.json", "scans.txt"):
        os.mkfifo(tmp_path / name)
    assert path_kind(tmp_path) == "unknown"


def test_a_socket_cannot_be_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # the name of a socket is short
    with socket.socket(socket.AF_UNIX) as end:
        end.bind("end.ply")
        assert path_kind(Path("end.ply")) == "unreadable"


@pytest.mark.parametrize("name", ["x" * 300, "a\0b", "~nobody-of-that-name/x"])
def test_a_name_that_no_file_can_have_is_no_crash(tmp_path: Path, name: str) -> None:
    path = Path(name) if name.startswith("~") else tmp_path / name
    assert path_kind(path) in ("unreadable", "nothing")
    with pytest.raises(InputError):
        check_openable(path)


def test_what_the_window_cannot_open_says_what_it_is(tmp_path: Path) -> None:
    walk = made(tmp_path, "walk/transforms.json", "{}")
    for path in (walk, walk.parent):
        with pytest.raises(InputError, match="is a capture; make a project of it"):
            check_openable(path)
    with pytest.raises(InputError, match="is an occupancy map"):
        check_openable(made(tmp_path, "map.yaml"))
    assert sentence_about(walk, path_kind(walk)).startswith(str(walk))


@settings(max_examples=60, deadline=None)
@given(
    name=st.sampled_from(["a", "a.json", "a.ply", "a.splat", "cameras.txt", "sensors.txt", "a_connectivity.json"]),
    content=st.binary(max_size=64) | st.sampled_from([b"PK\x03\x04", b"ply\n", b"\x1f\x8b", b"[", b"{", b"NGSP"]),
)
def test_any_content_has_a_kind(tmp_path_factory: pytest.TempPathFactory, name: str, content: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / name
    path.write_bytes(content)
    kind = path_kind(path)
    assert kind in ("graph", "splats", "capture", "unknown")
    assert sentence_about(path, kind).endswith(".")


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers()) | st.dictionaries(st.text(max_size=3), st.integers()))
def test_a_list_is_a_graph_and_an_object_a_capture(tmp_path_factory: pytest.TempPathFactory, value: object) -> None:
    path = tmp_path_factory.getbasetemp() / "any.json"
    path.write_text(json.dumps(value, indent=1))
    assert path_kind(path) == ("graph" if isinstance(value, list) else "capture")
