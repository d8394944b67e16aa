"""Files that stand in for the wanted file: pointers of Git LFS and git-annex, web pages, metadata files of macOS."""

from __future__ import annotations

import json
import re
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from capture_samples import room, walk, write_colmap, write_nerfstudio

from nvsim.capture.check import check
from nvsim.capture.findings import Findings
from nvsim.capture.pointcloud import read_cloud
from nvsim.errors import InputError
from nvsim.files.opening import opened, read_bytes, read_json, read_text
from nvsim.files.placeholders import is_metadata_name, placeholder_reason
from nvsim.files.stored_arrays import read_arrays
from nvsim.graph.foreign import connectivity_files
from nvsim.graph.scripts import script_lines
from nvsim.networks.installation import add
from nvsim.networks.onnx_session import Session
from nvsim.occupancy.read import read_map
from nvsim.project.path_kind import check_openable, path_kind
from nvsim.splats.formats.choice import read_splats

LFS = (
    b"version https://git-lfs.github.com/spec/v1\n"
    b"oid sha256:4d7a214614ab2935c943f9e0ff69d22eadbb8f32b1258daaa5e2ca24d17e2393\nsize 12345\n"
)
ANNEX = b"/annex/objects/SHA256E-s31390--4d7a214614ab2935.ply\n"
ANNEX_LINK = b"../.git/annex/objects/Wx/9z/SHA256E-s31390--4d7a/SHA256E-s31390--4d7a.ply"
PAGE = b"\n\n  <!DOCTYPE html>\n<html lang='en'><head><title>404</title></head></html>\n" + b" " * 4000
S3 = b'<?xml version="1.0" encoding="UTF-8"?>\n<Error><Code>NoSuchKey</Code></Error>'
APPLE = b"\x00\x05\x16\x07\x00\x02\x00\x00Mac OS X        " + b"\0" * 100


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (LFS, "Git LFS pointer, not the file; run `git lfs pull`"),
        (LFS.replace(b"\n", b"\r\n"), "Git LFS pointer"),
        (LFS.replace(b"oid", b"ext-0-foo sha256:aa\noid"), "Git LFS pointer"),
        (ANNEX, "git-annex pointer.*git annex get"),
        (ANNEX_LINK, "git-annex pointer"),
        (b"# xet version 0\nfilesize = 12\nhash = 'ab'\n", "Git-Xet"),
        (PAGE, "is a web page, not the file; download"),
        (b"\xef\xbb\xbf<html>", "web page"),
        (b"<!-- saved from url -->\n<HTML>", "web page"),
        ("\ufeff<!doctype html><p>".encode("utf-16-le"), "web page"),
        (b'<?xml version="1.0"?><!DOCTYPE html PUBLIC "-//W3C//DTD XHTML 1.0 Strict//EN">', "web page"),
        (S3, "error message of a server"),
        (b"404: Not Found", "error message of a server"),
        (b"Entry not found", "error message of a server"),
        (APPLE, "metadata file of macOS.*without the leading"),
    ],
)
def test_every_way_of_opening_names_what_stands_in_for_the_file(tmp_path: Path, data: bytes, words: str) -> None:
    path = tmp_path / "scan.bin"
    path.write_bytes(data)
    readers: tuple[Callable[[], object], ...] = (
        lambda: read_bytes(path),
        lambda: read_text(path, "a text", "write it again"),
        lambda: read_json(path, "a list", "write it again"),
        lambda: read_arrays(path, "arrays", {"a": ("f", 1)}, "write it again"),
        lambda: script_lines(path),
        lambda: Session(path),
    )
    for read in readers:
        with pytest.raises(InputError, match=words) as refusal:
            read()
        assert str(refusal.value).startswith(f"{path} is ") and str(refusal.value).endswith(".")
        assert refusal.value.__cause__ is not refusal.value  # a chain of causes has an end


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"version https://git-lfs.github.com/spec/v1\n" + b"x" * 2000,  # longer than a pointer can be
        b"# version https://git-lfs.github.com/spec/v1\n",
        b"the folder annex/objects/ is explained here",
        b"ply\ncomment <html>\n",
        b'<?xml version="1.0"?><svg></svg>',
        b"<h>",
        b"Not Found here but there",
        b"\x00\x05\x16\x08",
    ],
)
def test_usual_files_are_read(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a").write_bytes(data)
    assert read_bytes(tmp_path / "a") == data


@pytest.mark.parametrize("piece", [b"<!---->", b"<?xml>", b"<!-- ", b"<", b" ", b"./", b"annex/objects/", b"404: "])
def test_no_beginning_of_a_file_takes_long_to_recognize(piece: bytes) -> None:
    began = time.process_time()
    for end in (b"", b"x", b"<p>", b"-->", b"<html"):
        placeholder_reason(piece * 600 + end, 600)
        placeholder_reason((piece * 600)[: 512 - len(end)] + end, 600)
    assert time.process_time() - began < 0.5


@pytest.mark.parametrize("name", ["scan.ply", "scan.splat", "scan.spz", "scan.sog", "scan.ksplat", "meta.json", "scan"])
@pytest.mark.parametrize(("data", "words"), [(LFS, "git lfs pull"), (PAGE, "web page")])
def test_splat_readers_and_the_window_name_a_pointer_and_a_web_page(
    tmp_path: Path, name: str, data: bytes, words: str
) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    for read in (read_splats, check_openable):
        with pytest.raises(InputError, match=words):
            read(path)


@pytest.mark.parametrize("name", ["cloud.ply", "cloud.pcd"])
def test_cloud_reader_names_a_web_page(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(PAGE)
    with pytest.raises(InputError, match="web page"):
        read_cloud(tmp_path / name, Findings())


def test_check_names_pointers_of_a_colmap_model(tmp_path: Path) -> None:
    write_colmap(tmp_path, walk(4), room(20), binary=True)
    for name in ("cameras", "images", "points3D"):
        (tmp_path / "sparse/0" / f"{name}.bin").write_bytes(LFS)
    assert any("git lfs pull" in f.message for f in check(tmp_path).findings if f.severity == "error")


def test_check_names_a_pointer_in_place_of_transforms_json(tmp_path: Path) -> None:
    (tmp_path / "transforms.json").write_bytes(LFS)
    assert [f.severity for f in check(tmp_path).findings if "git lfs pull" in f.message] == ["error"]


def test_check_names_images_that_are_pointers(tmp_path: Path) -> None:
    write_nerfstudio(tmp_path, walk(4), room(20))
    for image in (tmp_path / "images").iterdir():
        image.write_bytes(LFS)
    found = [f for f in check(tmp_path).findings if "git lfs pull" in f.message]
    assert len(found) == 4 and all(f.message.startswith("the image is a Git LFS pointer") for f in found)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (lambda path: path.symlink_to("../.git/annex/objects/a/b/KEY/KEY"), "git annex get"),
        (lambda path: path.symlink_to("moved/away.png"), "moved/away.png.*does not exist"),
        (lambda path: path.with_name(f".{path.name}.icloud").write_bytes(b"bplist00"), "iCloud"),
        (lambda path: path.with_name(f"{path.name}.dvc").write_text("outs:\n"), "dvc pull"),
    ],
)
def test_a_missing_file_is_explained_by_what_is_there_of_it(
    tmp_path: Path, place: Callable[[Path], object], words: str
) -> None:
    write_nerfstudio(tmp_path, walk(4), room(20))
    image = sorted((tmp_path / "images").iterdir())[0]
    image.unlink()
    place(image)
    with pytest.raises(InputError, match=words), opened(image):
        pass
    assert any(re.search(words, f.consequence) for f in check(tmp_path).findings)


def test_maps_and_their_images_that_are_pointers_are_named(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text("image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    (tmp_path / "m.pgm").write_bytes(LFS)
    with pytest.raises(InputError, match="m.pgm is a Git LFS pointer"):
        read_map(tmp_path / "m.yaml")
    (tmp_path / "m.bt").write_bytes(LFS)
    with pytest.raises(InputError, match="git lfs pull"):
        read_map(tmp_path / "m.bt")


def test_a_project_whose_database_is_a_pointer_says_so(tmp_path: Path) -> None:
    from nvsim.project.project import Project

    (tmp_path / "project.db").write_bytes(LFS)
    with pytest.raises(InputError, match="git lfs pull"):
        Project.open(tmp_path)


def test_looking_at_a_database_keeps_the_locks_of_its_connection(tmp_path: Path) -> None:
    """Closing any descriptor of a file releases the POSIX locks that SQLite holds on it, so none may be opened."""
    import subprocess
    import sys

    from nvsim.files.databases import check_files

    path = tmp_path / "a.db"
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("CREATE TABLE t (x)")
    connection.execute("BEGIN IMMEDIATE")
    check_files(path)
    code = f"import sqlite3; sqlite3.connect({str(path)!r}, timeout=0).execute('INSERT INTO t VALUES (1)')"
    assert b"locked" in subprocess.run([sys.executable, "-c", code], capture_output=True).stderr
    connection.close()


def test_a_network_that_is_a_pointer_is_not_added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "net.onnx").write_bytes(LFS)
    with pytest.raises(InputError, match="git lfs pull"):
        add([tmp_path / "net.onnx"])


def test_a_trained_model_whose_files_are_pointers_says_so(tmp_path: Path) -> None:
    from nvsim.geometry.floor_surface import FloorSurface
    from nvsim.splats.files import load_model, save_model
    from nvsim.splats.types import Gaussians, SubmapModel

    save_model(SubmapModel(Gaussians.empty(), None, None, FloorSurface.flat(0.0)), tmp_path)
    name = next(n for n in json.loads((tmp_path / "model.json").read_text())["files"] if n.endswith(".ply"))
    (tmp_path / name).write_bytes(LFS)
    with pytest.raises(InputError, match="git lfs pull"):
        load_model(tmp_path)


def test_metadata_files_of_macos_are_no_part_of_a_folder(tmp_path: Path) -> None:
    graph = b'[{"image_id": "a"}]'
    (tmp_path / "b_connectivity.json").write_bytes(graph)
    (tmp_path / "._b_connectivity.json").write_bytes(APPLE)
    assert connectivity_files(tmp_path) == [tmp_path / "b_connectivity.json"]
    (tmp_path / "b_connectivity.json").unlink()
    assert path_kind(tmp_path) == "unknown"
    assert [is_metadata_name(n) for n in ("._a.jpg", ".a.jpg.icloud", "a.jpg", ".a.jpg")] == [True, True, False, False]


def test_an_image_of_zeros_and_a_small_array_are_no_placeholders(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", a=np.zeros(3))
    assert read_arrays(tmp_path / "a.npz", "arrays", {"a": ("f", 1)}, "")["a"].tolist() == [0, 0, 0]
