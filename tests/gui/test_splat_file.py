"""Splat files of other programs in the window: shown with their own colors, turned upright, the rest disabled."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QSettings
from pytestqt.qtbot import QtBot

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.splats.formats.choice import write_splats
from nvsim.splats.turning import UPS, upright
from nvsim.splats.types import Gaussians
from nvsim_app.session import Session
from nvsim_app.state.document import Document
from nvsim_app.state.opened_files import SplatFile, outline_of
from nvsim_app.state.reasons import with_graph, with_scene, with_splat_file


def pole(count: int = 400) -> Gaussians:
    """Red Gaussians on top of green ones, 2 m tall, y pointing down as splat files have it."""
    r = np.random.default_rng(0)
    means = r.uniform([-0.2, -2, -0.2], [0.2, 0, 0.2], (count, 3))
    color = np.where(means[:, 1:2] < -1, [[1.5, -1.5, -1.5]], [[-1.5, 1.5, -1.5]])
    arrays = means, np.full((count, 3), -2.5), np.tile([1, 0, 0, 0], (count, 1)), np.full(count, 3), color[:, None]
    return Gaussians(*(np.ascontiguousarray(a, np.float32) for a in arrays))


@pytest.fixture
def spz(tmp_path: Path) -> Path:
    write_splats(tmp_path / "pole.spz", pole(), False, "spz")
    return tmp_path / "pole.spz"


def test_y_is_taken_to_point_down_and_the_thing_stands(spz: Path) -> None:
    contents = SplatFile.of(spz).contents()
    assert SplatFile.of(spz).up == "-y"
    assert contents.outline is not None and contents.missing == ""
    np.testing.assert_allclose(contents.outline[:, 2].min(), 0.0, atol=0.1)
    np.testing.assert_allclose(contents.outline[:, 2].max(), 2.0, atol=0.1)


def test_a_file_that_says_z_is_up_is_believed(tmp_path: Path) -> None:
    write_splats(tmp_path / "ours.ply", pole(), True, "ply")
    assert SplatFile.of(tmp_path / "ours.ply").up == "z"


@pytest.mark.parametrize("up", UPS)
def test_every_axis_can_be_up(up: str) -> None:
    axis = np.zeros(3, np.float32)
    axis["xyz".index(up[-1])] = -1 if up.startswith("-") else 1
    gaussians = pole(1)
    gaussians.means[:] = axis
    np.testing.assert_allclose(upright(gaussians, up).means[0], [0, 0, 1], atol=1e-6)


def test_the_drawing_process_shows_its_own_colors(spz: Path) -> None:
    from nvsim.render.model import render_model

    _, model = SplatFile.of(spz).open().at(None)
    camera = Camera(Intrinsics.from_fov(60, 80, 1.0), camera_pose(np.array([0.0, -3.0, 1.0]), 0.0))
    rgb = render_model(model, camera).rgb
    above, below = rgb[20, 30], rgb[60, 30]
    assert above[0] > 0.5 > above[1] and below[1] > 0.5 > below[0]


def test_what_a_splat_file_cannot_do_says_why(spz: Path, qapp) -> None:
    document = Document()
    document.set_contents(SplatFile.of(spz).contents())
    assert with_scene(document) is None and with_splat_file(document) is None
    assert "splat file" in with_graph(document)


def test_outline_of_nothing_is_empty() -> None:
    assert outline_of(Gaussians.empty()).shape == (0, 3)


def test_a_session_opens_a_file_and_turns_it(spz: Path, settings: QSettings, qtbot: QtBot, tmp_path: Path) -> None:
    session = Session(settings)
    qtbot.addWidget(session.window)
    session.window.show()
    try:
        session.open(spz)
        qtbot.waitUntil(lambda: session.document.contents.outline is not None, timeout=20_000)
        assert "-y is up" in session.window._summary.text()
        session.window.turnWanted.emit()
        qtbot.waitUntil(lambda: "x is up" in session.window._summary.text(), timeout=20_000)
        damaged = tmp_path / "damaged.ply"
        damaged.write_bytes(b"ply\n")
        session._on_chosen(damaged)
        qtbot.waitUntil(lambda: any("damaged.ply" in t for t in session.window.notice_area.texts), timeout=20_000)
    finally:
        session.close()
        qtbot.waitUntil(lambda: not session.window.scene.link.ready, timeout=20_000)


def test_window_says_how_many_gaussians_are_left_out(settings: QSettings, qtbot: QtBot, tmp_path: Path) -> None:
    gaussians = pole()
    gaussians.means[:3] = np.nan
    write_splats(tmp_path / "pole.ply", gaussians, False, "ply")
    session = Session(settings)
    qtbot.addWidget(session.window)
    session.window.show()
    try:
        session.open(tmp_path / "pole.ply")
        qtbot.waitUntil(lambda: any("3 of 400" in t for t in session.window.notice_area.texts), timeout=20_000)
    finally:
        session.close()
        qtbot.waitUntil(lambda: not session.window.scene.link.ready, timeout=20_000)


def test_window_says_where_the_image_of_a_moved_map_was_found(tmp_path: Path) -> None:
    from nvsim_app.state.opened_files import GraphSource

    (tmp_path / "s_connectivity.json").write_text("[]")
    (tmp_path / "map.yaml").write_text("image: /home/ann/map.pgm\nresolution: 0.1\norigin: [0, 0, 0]\n")
    (tmp_path / "map.pgm").write_bytes(b"P5\n1 1\n255\n\xfe")
    (note,) = GraphSource(tmp_path).contents().notes
    assert "/home/ann/map.pgm is not there" in note


def test_web_page_under_the_name_of_a_splat_file_does_not_open_the_window(tmp_path: Path) -> None:
    from nvsim.project.path_kind import check_openable

    (tmp_path / "a.splat").write_bytes(b"<!DOCTYPE html>\n<html>404</html>".ljust(320))
    with pytest.raises(InputError, match="is a web page, not the file"):
        check_openable(tmp_path / "a.splat")


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    from nvsim.project.path_kind import check_openable

    (tmp_path / "a.txt").write_text("hello")
    with pytest.raises(InputError, match=r"a\.txt is not a splat file"):
        check_openable(tmp_path / "a.txt")
    assert os.path.exists(tmp_path / "a.txt")


def unpacked_sog(folder: Path) -> Path:
    """The meta.json of a SOG of four Gaussians, laid out as its format says."""
    import json

    import cv2

    rows = np.full((2, 2, 4), 255, np.uint8)  # the tag 255 leaves the last component of a rotation out
    folder.mkdir()
    for name in ("means_l", "means_u", "quats", "scales", "sh0"):
        cv2.imwrite(str(folder / f"{name}.webp"), rows, [cv2.IMWRITE_WEBP_QUALITY, 101])
    book = np.linspace(-3, -2, 256).tolist()
    meta = {
        "version": 2,
        "count": 4,
        "means": {"mins": [0, 0, 0], "maxs": [1, 1, 1], "files": ["means_l.webp", "means_u.webp"]},
        "quats": {"files": ["quats.webp"]},
        **{name: {"codebook": book, "files": [f"{name}.webp"]} for name in ("scales", "sh0")},
    }
    (folder / "meta.json").write_text(json.dumps(meta))
    return folder / "meta.json"


def test_the_meta_json_of_an_unpacked_sog_opens_as_splats_and_not_as_a_graph(tmp_path: Path) -> None:
    from nvsim.project.path_kind import check_openable

    path = unpacked_sog(tmp_path / "scene")
    check_openable(path)
    found = SplatFile.of(path).contents()
    assert found.outline is not None
    np.testing.assert_allclose(np.abs(found.outline).max(), np.expm1(1), rtol=1e-3)


def test_what_no_reader_can_open_is_a_sentence_and_not_waited_for(tmp_path: Path) -> None:
    from nvsim.project.path_kind import check_openable

    (tmp_path / "lod-meta.json").write_text('{"lodLevels": 2}')
    os.mkfifo(tmp_path / "pipe.ply")
    for name, words in (("lod-meta.json", "streamed SOG"), ("pipe.ply", "it is a pipe"), ("x" * 300, "too long")):
        with pytest.raises(InputError, match=words):
            check_openable(tmp_path / name)
