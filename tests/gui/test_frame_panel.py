"""The list of frames: found by name, submap and floor, with thumbnails that another process makes."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import cv2
import demo_room
import numpy as np
import pytest
from demo_project import write_project
from PySide6.QtCore import Qt
from PySide6.QtGui import QImage
from pytestqt.qtbot import QtBot

from nvsim.capture.store import save_capture
from nvsim.project.corrections import save_correction
from nvsim.project.layout import Layout
from nvsim.project.project import Project
from nvsim_app.frames.link import FrameLink
from nvsim_app.frames.state import Score, Scores, frame_words, mask_words, newest_scores
from nvsim_app.frames.worker import thumbnail_path
from nvsim_app.panels.frames import COVERAGES, FramePanel
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents, ProjectReader
from nvsim_app.state.results import EvaluationResult, tables_of

PATIENCE = 240_000  # milliseconds until an expected event counts as missing, also on a busy machine
pytestmark = pytest.mark.timeout(1800)


def with_images(folder: Path, frames: int) -> Path:
    """A project with a picture for each of `frames` frames, the floor found in all but the last."""
    project = write_project(folder / "house.nvsim", count=500, models=1)
    walk = demo_room.capture(frames)
    made = []
    for i, frame in enumerate(walk.frames):
        path = folder / "images" / f"{i:05d}.jpg"
        path.parent.mkdir(exist_ok=True)
        image = np.full((480, 640, 3), (i * 37 % 255, 90, 200 - i % 200), np.uint8)
        cv2.imwrite(str(path), image)
        made.append(replace(frame, image_path=path))
        if i < frames - 1:
            mask = np.zeros((480, 640), np.uint8)
            mask[480 - 480 * i // frames :] = 255
            Layout(project).masks.mkdir(exist_ok=True)
            cv2.imwrite(str(Layout(project).mask(i)), mask)
    walk = replace(walk, frames=tuple(made))
    with Project.open(project, writable=True) as opened:
        save_capture(walk, opened.layout.imported)
        opened.set_submaps(demo_room.submaps(walk))
    return project


def opened_document(project: Path) -> Document:
    with Project.open(project) as p:
        made = Document()
        made.set_contents(Contents(project))
        made.set_contents(Contents(project, p.capture(), p.submaps()))
    return made


@pytest.fixture
def panel(document: Document, qtbot: QtBot) -> FramePanel:
    made = FramePanel(document)
    qtbot.addWidget(made)
    made.resize(320, 500)
    made.show()
    yield made
    made.close()


def test_a_frame_is_found_by_name_and_opened_by_double_click(
    panel: FramePanel, document: Document, qtbot: QtBot
) -> None:
    qtbot.keyClicks(panel.search, "00042")
    assert panel.list.model().rowCount() == 1
    index = panel.list.model().index(0, 0)
    with qtbot.waitSignal(panel.opened) as opened:
        place = panel.list.visualRect(index).center()
        qtbot.mouseClick(panel.list.viewport(), Qt.MouseButton.LeftButton, pos=place)
        qtbot.mouseDClick(panel.list.viewport(), Qt.MouseButton.LeftButton, pos=place)
    assert opened.args == [42] and document.selection.frame == 42


def test_return_opens_the_frame_too(panel: FramePanel, document: Document, qtbot: QtBot) -> None:
    document.select(frame=7)
    with qtbot.waitSignal(panel.opened) as opened:
        qtbot.keyClick(panel.list, Qt.Key.Key_Return)
    assert opened.args == [7]


def test_the_model_keeps_qts_rules_while_the_document_changes(
    panel: FramePanel, document: Document, qtmodeltester
) -> None:
    qtmodeltester.check(panel.model)
    document.set_contents(replace(document.contents, submaps=document.contents.submaps[:2]))
    qtmodeltester.check(panel.model)
    document.set_contents(Contents(Path("empty.nvsim")))
    qtmodeltester.check(panel.model)
    assert panel.model.rowCount() == 0


def test_a_submap_shows_its_frames_and_those_it_shares(panel: FramePanel, document: Document) -> None:
    panel.submap.setCurrentIndex(2)  # after "all": submap 1
    assert set(panel.model.rows) == set(document.contents.submaps[1].frames)
    assert panel.count.text() == "38 of 120"
    # Stages that begin and end read the submaps anew; the choice stays.
    document.set_contents(replace(document.contents, submaps=tuple(document.contents.submaps)[:3]))
    assert panel.submap.currentData() == 1 and panel.model.rowCount() == 38
    document.set_contents(replace(document.contents, submaps=document.contents.submaps[:1]))
    assert panel.submap.currentData() is None and panel.model.rowCount() == 120


def test_frames_are_found_by_how_much_floor_they_show(panel: FramePanel) -> None:
    panel.state.coverage = {0: 0.0, 1: 0.05, 2: 0.2, 3: 0.5}
    panel.state.learn(4, 0.31, corrected=True)
    found = []
    for row in range(len(COVERAGES)):
        panel.coverage.setCurrentIndex(row)
        found.append(panel.model.rows)
    assert len(found[0]) == 120 and found[1:] == [[0], [1], [2], [3, 4]]
    panel.coverage.setCurrentIndex(0)
    panel.kind.setCurrentText("Corrected")
    assert panel.model.rows == [4]
    panel.kind.setCurrentIndex(0)


def test_frames_with_a_doubtful_mask_are_found_until_it_is_corrected(tmp_path: Path, qtbot: QtBot) -> None:
    project = with_images(tmp_path, 6)
    (Layout(project).masks / "failures.json").write_text('{"2": "unsure", "4": "short"}')
    document = opened_document(project)
    made = FramePanel(document)
    qtbot.addWidget(made)
    document.contentsChanged.emit(frozenset({"submaps"}))
    made.kind.setCurrentText("Doubtful masks")
    assert made.model.rows == [2, 4] and frame_words(made.state, 2).endswith("doubtful")
    made.state.learn(2, 0.3, corrected=True)
    assert made.model.rows == [4] and frame_words(made.state, 2).endswith("corrected by hand")


def evaluated(at: float, **psnr: float) -> EvaluationResult:
    """An evaluation with rows for the frames f4, f12, ... as `evaluate views` prints them."""
    rows = [{"frame": int(f[1:]), "submap": 0, "psnr": v, "ssim": round(1 - v / 100, 3)} for f, v in psnr.items()]
    return EvaluationResult("job 1", "Evaluate views", at, tables_of({"psnr": 1.0, "per_frame": rows}))


def test_held_out_frames_are_found_and_the_worst_stands_first(panel: FramePanel, document: Document) -> None:
    document.set_contents(replace(document.contents, held_out=frozenset({4, 12, 20}), modified_time=50.0))
    panel.kind.setCurrentText("Held out")
    assert panel.model.rows == [4, 12, 20]
    assert not panel.order.isEnabled() and "Jobs > Evaluate views" in panel.order.toolTip()
    older, newer = evaluated(60.0, f4=1.0), evaluated(100.0, f4=24.0, f12=19.0, f33=3.0)
    panel.state.show_scores(newest_scores([newer, older]))
    assert panel.order.isEnabled()
    panel.order.setCurrentText("Worst PSNR")
    assert panel.model.rows == [12, 4, 20], "a frame without a score comes last"
    panel.order.setCurrentText("Worst SSIM")
    assert panel.model.rows == [4, 12, 20]
    assert panel.state.score(12) == Score(19.0, 0.81)
    assert panel.state.score(33) is None, "it is not held out any more"
    assert frame_words(panel.state, 12).endswith("held out: PSNR 19.0 dB, SSIM 0.81")
    assert frame_words(panel.state, 20).endswith("held out of training")
    panel.kind.setCurrentText("Trained on")
    assert len(panel.model.rows) == 117 and 12 not in panel.model.rows
    # Models that were made since then are others than those that were measured.
    document.set_contents(replace(document.contents, modified_time=200.0, scene_stamp="others"))
    assert frame_words(panel.state, 12).endswith("SSIM 0.81 of earlier models")
    panel.state.show_scores(Scores())
    assert panel.order.currentData() == "" and not panel.order.isEnabled()


def test_a_held_out_row_shows_its_mark_and_figures_in_little_room(panel: FramePanel, document: Document) -> None:
    def pixels() -> bytes:
        return bytes(panel.list.viewport().grab().toImage().convertToFormat(QImage.Format.Format_RGB32).constBits())

    bare = pixels()
    document.set_contents(replace(document.contents, held_out=frozenset({0}), modified_time=1.0))
    panel.state.show_scores(newest_scores([evaluated(2.0, f1=20.0)]))
    marked = pixels()
    panel.state.show_scores(newest_scores([evaluated(2.0, f0=20.0)]))
    assert len({bare, marked, pixels()}) == 3


def test_an_evaluation_of_something_else_gives_frames_no_score() -> None:
    floor = EvaluationResult("job 2", "Evaluate floor", 9.0, tables_of({"per_frame": [{"frame": 1, "iou": 0.5}]}))
    assert newest_scores([floor, evaluated(3.0, f1=20.0)]).at == 3.0
    assert newest_scores([floor]) == Scores()


def test_what_is_held_out_is_read_with_the_project(tmp_path: Path) -> None:
    project = with_images(tmp_path, 20)
    reader = ProjectReader(project)
    *_, contents = reader.updates()
    reader.close()
    assert contents.held_out == {4, 12}
    assert abs(contents.modified_time - (Layout(project).model(0) / "model.json").stat().st_mtime) < 5


def test_hiding_the_selected_frame_selects_no_other(panel: FramePanel, document: Document) -> None:
    document.select(frame=50)
    panel.search.setText("0007")
    assert document.selection.frame == 50
    panel.search.clear()
    assert panel.list.currentIndex().row() == 50


def test_thumbnails_and_coverage_come_from_the_process_and_stay_on_disk(qtbot: QtBot, tmp_path: Path) -> None:
    project = with_images(tmp_path, 12)
    save_correction(Layout(project), demo_room.capture(12).frames[3], np.ones((480, 640), bool))
    document = opened_document(project)
    link = FrameLink()
    panel = FramePanel(document, link)
    link.open(project)
    panel.state._on_contents(frozenset({"capture", "submaps"}))
    qtbot.addWidget(panel)
    panel.resize(320, 500)
    panel.show()
    index, state = panel.model.index, panel.state
    assert mask_words(state, 6) == mask_words(state, 11) == "reading masks…"
    qtbot.waitUntil(lambda: index(0, 0).data(Qt.ItemDataRole.DecorationRole) is not None, timeout=PATIENCE)
    qtbot.waitUntil(lambda: len(state.coverage) == 11, timeout=PATIENCE)
    assert state.coverage[6] == pytest.approx(0.5, abs=0.01)
    assert state.coverage[3] == 1.0 and 3 in state.corrected
    qtbot.waitUntil(lambda: not state.reading, timeout=PATIENCE)
    assert mask_words(state, 6) == "50 % floor" and mask_words(state, 11) == "no mask yet"
    assert 11 not in state.coverage and document.trajectory.submaps[0] == 0
    assert "corrected by hand" in index(3, 0).data(Qt.ItemDataRole.ToolTipRole)
    assert panel.thumbnails.pixmap(0).width() == 160
    assert thumbnail_path(Layout(project), document.contents.capture.frames[0]).is_file()
    link.stop_process()
    assert not link.running
    # A second window needs no process for what is on disk.
    again = FramePanel(document, FrameLink())
    qtbot.addWidget(again)
    assert again.thumbnails.pixmap(0) is None
    qtbot.waitUntil(lambda: again.thumbnails.pixmap(0) is not None, timeout=PATIENCE)
    panel.close()


def test_a_killed_process_is_started_again_and_an_unreadable_image_is_asked_for_once(
    qtbot: QtBot, tmp_path: Path
) -> None:
    project = with_images(tmp_path, 6)
    (tmp_path / "images" / "00002.jpg").write_bytes(b"no image")
    link = FrameLink()
    link.open(project)
    with qtbot.waitSignal(link.failed, timeout=PATIENCE) as failed:
        link.ask_thumbnails([2])
    assert failed.args[:2] == ["thumbnail", 2] and "can be decoded" in failed.args[2]
    os.kill(link.process_id, signal.SIGKILL)
    with qtbot.waitSignal(link.thumbnailMade, timeout=PATIENCE):
        link.ask_thumbnails([4])
    link.stop_process()


def test_a_restarted_process_repeats_no_finished_request(qtbot: QtBot, tmp_path: Path) -> None:
    link, made, shares = FrameLink(), [], []
    link.thumbnailMade.connect(lambda frame, _: made.append(frame))
    link.coverageRead.connect(lambda some, _: shares.append(some))
    link.open(with_images(tmp_path, 6))
    link.ask_thumbnails([1, 0])
    link.ask_coverage()
    qtbot.waitUntil(lambda: made == [1, 0] and not link._process.unanswered, timeout=PATIENCE)
    heard = len(shares)
    assert heard
    os.kill(link.process_id, signal.SIGKILL)
    with qtbot.waitSignal(link._process.opened, timeout=PATIENCE):
        pass
    link.ask_thumbnails([3])
    qtbot.waitUntil(lambda: 3 in made, timeout=PATIENCE)
    assert made == [1, 0, 3] and len(shares) == heard
    link.stop_process()


def test_two_thousand_frames_scroll_smoothly(qtbot: QtBot, tmp_path: Path) -> None:
    project = with_images(tmp_path, 40)
    with Project.open(project) as opened:
        few = opened.need_capture().frames
    walk = demo_room.capture(2000)
    walk = replace(walk, frames=tuple(replace(f, image_path=few[i % 40].image_path) for i, f in enumerate(walk.frames)))
    document = Document()
    document.set_contents(Contents(project, walk, demo_room.submaps(walk)))
    for frame in few:
        path = thumbnail_path(Layout(project), frame)
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.full((120, 160, 3), 90, np.uint8))
    panel = FramePanel(document, FrameLink())
    qtbot.addWidget(panel)
    panel.resize(320, 900)
    panel.show()
    bar = panel.list.verticalScrollBar()
    times = []
    for value in np.linspace(0, bar.maximum(), 40).astype(int):
        begin = time.process_time()
        bar.setValue(int(value))
        panel.list.viewport().grab()
        times.append(time.process_time() - begin)
        qtbot.wait(1)
    assert np.median(times) < 0.05  # some 4 ms on a quiet machine
    panel.close()
