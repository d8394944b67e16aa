"""The mode that cleans a splat: real mouse events select Gaussians, and applying changes the project."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PySide6.QtCore import QPoint, Qt
from pytestqt.qtbot import QtBot

from nvsim.cli.main import main
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.mapping.config import MappingConfig
from nvsim.project import ledger
from nvsim.project.cleaning import read_whole_splat, remove_gaussians
from nvsim.project.graph import recorded_config
from nvsim.project.project import Project
from nvsim.project.stages import levels
from nvsim.project.stages.mapped import for_splats, map_key
from nvsim.project.state import graph_table
from nvsim.splats.formats.choice import write_splats
from nvsim.splats.types import Gaussians, SubmapModel, joined
from nvsim_app.drawing.marked_model import MARKS, MarkedModel, Marks
from nvsim_app.drawing.painter import Models, Painter
from nvsim_app.drawing.render_child import WholeSplatSource
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.session import Session
from nvsim_app.state.cleaning import SplatCleaning, rows_in_outline
from nvsim_app.state.document import Document
from nvsim_app.state.side_work import RemovableGaussians
from nvsim_app.wiring.cleaning import CHANGED, CleanPart, with_splat_project
from nvsim_app.wiring.jobs import JobsPart
from nvsim_app.wiring.window import MainWindow
from tests.unit.splat_rooms import two_rooms

SECONDS = 60_000
FOG = 60
LEFT, NONE, SHIFT = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.ShiftModifier
CONTROL = Qt.KeyboardModifier.ControlModifier


def found(count: int = 8) -> RemovableGaussians:
    none = np.zeros(count, bool)
    means = np.column_stack([np.arange(count), np.full(count, 5.0), np.zeros(count)]).astype(np.float32)
    candidates = {"floater": np.arange(count) < 2, "outside": np.arange(count) == 3}
    return RemovableGaussians(means, {0: np.arange(count)}, none, candidates)  # type: ignore[arg-type]


def rows(mask: NDArray[np.bool_]) -> list[int]:
    return list(np.flatnonzero(mask))


def test_an_outline_selects_the_centers_that_project_into_it_also_behind_others() -> None:
    camera = Camera(Intrinsics(100, 80, 50.0, 50.0, 50.0, 40.0), camera_pose(np.zeros(3), 0.0))  # looks along +y
    # x, y, z -> pixel 50 + 50 x / y, 40 - 50 z / y
    means = np.array([[0, 2, 0], [0, 8, 0], [0, -2, 0], [0.5, 2, 0], [0, 2, 0.5], [0.9, 2, 0]], np.float32)
    box = np.array([[40.0, 30.0], [70.0, 30.0], [70.0, 50.0], [40.0, 50.0]])
    assert list(rows_in_outline(camera, means, box)) == [0, 1, 3]
    assert list(rows_in_outline(camera, means, box, reach=4.0)) == [0, 3]
    lasso = np.array([[45.0, 35.0], [56.0, 35.0], [45.0, 46.0]])  # the pixel (50, 40) is inside, (62.5, 40) is not
    assert list(rows_in_outline(camera, means, lasso)) == [0, 1]


def test_every_step_can_be_undone_and_redone(qapp: object) -> None:
    cleaning = SplatCleaning(found())
    assert rows(cleaning.removed) == [0, 1, 3] and cleaning.edited
    states = [(cleaning.removed.copy(), cleaning.selected.copy())]
    steps: list[Callable[[], None]] = [
        lambda: cleaning.set_reason("floater", False),
        lambda: cleaning.select(np.array([3, 4, 5])),
        lambda: cleaning.select(np.array([5, 6]), toggles=True),
        lambda: cleaning.remove_selected(),
        lambda: cleaning.select(np.array([3])),
        lambda: cleaning.select(np.array([6]), adds=True),
        lambda: cleaning.keep_selected(),
        lambda: cleaning.keep_all(),
    ]
    for step in steps:
        step()
        states.append((cleaning.removed.copy(), cleaning.selected.copy()))
    assert [rows(removed) for removed, _ in states[1:]] == [[3], [3], [3], [3, 4, 6], [3, 4, 6], [3, 4, 6], [4], []]
    assert [rows(chosen) for _, chosen in states[1:5]] == [[], [3, 4, 5], [3, 4, 6], []]
    assert not cleaning.edited
    for move, order in ((cleaning.undo, states[-2::-1]), (cleaning.redo, states[1:])):
        for removed, selected in order:
            move()
            np.testing.assert_array_equal(cleaning.removed, removed)
            np.testing.assert_array_equal(cleaning.selected, selected)
        move()  # nothing is left


def test_a_removal_that_is_stored_is_shown_rather_than_the_candidates(qapp: object) -> None:
    cleaning = SplatCleaning(replace(found(), removed=np.arange(8) == 6))
    assert rows(cleaning.removed) == [6] and not cleaning.edited
    assert cleaning.count("floater") == (0, 2)


def test_marks_name_the_reason_the_selection_and_what_is_hidden(qapp: object) -> None:
    cleaning = SplatCleaning(found())
    cleaning.select(np.array([1, 5]))
    shown, hiding = cleaning.marks(False), cleaning.marks(True)
    assert [MARKS[c] for c in shown.codes] == ["floater", "selected", "outside", "selected"]
    assert list(shown.rows) == [0, 1, 3, 5] and shown.number != hiding.number
    assert [MARKS[c] for c in hiding.codes] == ["hidden", "hidden", "hidden", "selected"]


def test_marked_gaussians_have_their_color_in_the_image_and_hidden_ones_are_absent() -> None:
    room = two_rooms()
    model = SubmapModel(room, None, None, FloorSurface.flat(0.0))
    painter = Painter(Models(lambda camera: (0, model)))
    camera = Camera(Intrinsics.from_fov(64, 48, 1.5), camera_pose(np.array([2.0, 2.5, 1.5]), 0.0))
    everything, before = np.arange(len(room), dtype=np.int32), painter.paint(camera, "rgb", "CPU", False)[1]

    def image(mark: str) -> NDArray[np.uint8]:
        codes = np.full(len(room), MARKS.index(mark), np.uint8)  # type: ignore[arg-type]
        return painter.paint(camera, "rgb", "CPU", False, 0, Marks(MARKS.index(mark), everything, codes))[1]  # type: ignore[arg-type]

    blue, green, red, _ = image("outside")[24, 32]
    assert blue > green > red  # a blue
    empty = painter.paint(camera, "rgb", "CPU", False, 0, Marks(99, everything, np.zeros(len(room), np.uint8)))[1]
    assert np.ptp(empty.reshape(-1, 4), axis=0).max() == 0
    np.testing.assert_array_equal(painter.paint(camera, "rgb", "CPU", False)[1], before)  # the model is unchanged
    marked, marks = MarkedModel(), Marks(1, everything[:0], np.zeros(0, np.uint8))
    assert marked.of(model, marks) is marked.of(model, marks)


def test_only_projects_from_splat_files_offer_it(window: MainWindow, document: Document) -> None:
    assert "splat files" in str(with_splat_project(document))
    assert not window.actions_table["mode_clean"].isEnabled()


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cleaning")
    room = two_rooms()
    fog = Gaussians(*(a[:FOG].copy() for a in vars(room).values()))
    fog.means[:] = np.random.default_rng(0).uniform([1.2, 0.8, 0.9], [3.2, 2.2, 1.8], (FOG, 3))
    fog.log_scales[:], fog.opacity_logits[:] = np.log(0.06), -1.0
    write_splats(folder / "room.ply", joined(room, fog), False, "ply")
    words = ["--project", str(folder / "room.nvsim"), "--scale", "1", "--up", "z"]
    assert main(["import", str(folder / "room.ply"), *words]) == 0
    return folder / "room.nvsim"


def drag(qtbot: QtBot, session: Session, *corners: QPoint) -> None:
    """Presses the left button at the first corner, moves over the others, and releases it in the 3D view. Waits until
    the selection changed."""
    part, seen, view = session.window.part(CleanPart), [], session.window.scene
    assert part.mode.cleaning is not None
    part.mode.cleaning.changed.connect(lambda: seen.append(1))
    qtbot.mousePress(view, LEFT, NONE, corners[0])
    for start, end in pairwise(corners):
        for k in range(1, 5):
            qtbot.mouseMove(view, start + (end - start) * k / 4)
    qtbot.mouseRelease(view, LEFT, NONE, corners[-1])
    qtbot.waitUntil(lambda: bool(seen), timeout=SECONDS)


def opened(qtbot: QtBot, session: Session, project: Path) -> SplatCleaning:
    session.window.resize(1500, 950)
    session.open(project)
    document, scene = session.document, session.window.scene
    qtbot.waitUntil(lambda: scene.feed.link.ready and not document.contents.reading, timeout=SECONDS)
    scene.stay_at(ViewPose((2.0, 4.0, 1.6), np.pi))  # looks along -y, to the fog
    session.window.actions_table["mode_clean"].trigger()
    part = session.window.part(CleanPart)
    assert isinstance(scene.feed.source, WholeSplatSource) and not session.window.docks["clean"].isHidden()
    qtbot.waitUntil(lambda: part.mode.cleaning is not None, timeout=SECONDS)
    qtbot.waitUntil(lambda: scene.picture is not None and scene.picture.request.marks is not None, timeout=SECONDS)
    assert part.mode.cleaning is not None
    return part.mode.cleaning


def test_a_splat_is_cleaned_with_the_mouse(qtbot: QtBot, session: Session, project: Path) -> None:
    cleaning = opened(qtbot, session, project)
    window, part = session.window, session.window.part(CleanPart)
    floaters = cleaning.removed.copy()
    assert floaters[-FOG:].mean() > 0.8 and part.panel.reasons["floater"].isChecked()
    part.panel.reasons["floater"].click()
    assert not cleaning.removed.any() and not part.panel.apply.isEnabled()
    # A box up to 3.4 m contains the fog, but not the wall 4 m behind it.
    part.panel.reach.setValue(3.4)
    width, height = window.scene.width(), window.scene.height()
    corner = QPoint(4, height // 4), QPoint(width - 4, height - 4)
    drag(qtbot, session, *corner)
    assert cleaning.selected[-FOG:].any() and cleaning.selected.sum() < len(cleaning.selected) / 2
    pixels, depths = window.scene.overlay_camera.project(cleaning.found.means)
    (x, y), (a, b) = corner[0].toTuple(), corner[1].toTuple()
    inside = (pixels[:, 0] >= x) & (pixels[:, 0] <= a) & (pixels[:, 1] >= y) & (pixels[:, 1] <= b)
    np.testing.assert_array_equal(cleaning.selected, inside & (depths > 0.05) & (depths <= 3.4))
    chosen = cleaning.selected.copy()
    qtbot.keyClick(window.scene, Qt.Key.Key_Delete)
    np.testing.assert_array_equal(cleaning.removed, chosen)
    qtbot.keyClick(window.scene, Qt.Key.Key_Z, CONTROL)
    qtbot.keyClick(part.panel.keep_all, Qt.Key.Key_Z, CONTROL)  # also in the panel
    assert not cleaning.removed.any() and not cleaning.selected.any()
    qtbot.keyClick(window.scene, Qt.Key.Key_Z, CONTROL)
    np.testing.assert_array_equal(cleaning.removed, floaters)
    qtbot.keyClick(window.scene, Qt.Key.Key_K)  # a lasso keeps what it surrounds
    assert part.mode.lasso and part.panel.lasso.isChecked()
    drag(qtbot, session, corner[0], QPoint(width - 4, height // 4), corner[1])  # the upper right half of the box
    assert 0 < cleaning.selected.sum() < chosen.sum() and not (cleaning.selected & ~chosen).any()
    expected = floaters & ~cleaning.selected
    qtbot.keyClick(window.scene, Qt.Key.Key_Delete, SHIFT)
    np.testing.assert_array_equal(cleaning.removed, expected)
    assert expected.sum() < floaters.sum()
    qtbot.mouseClick(part.panel.apply, LEFT)
    qtbot.waitUntil(lambda: window.modes.current.name == "select", timeout=SECONDS)
    with Project.open(project) as again:
        scene = again.scene()
        assert scene is not None and len(scene.model(0).gaussians) == (~expected).sum()
    assert window.scene.feed.source is not None and not isinstance(window.scene.feed.source, WholeSplatSource)
    texts = session.window.notice_area.texts
    assert any("Gaussians are removed." in text for text in texts) and not any("again" in text for text in texts)


@pytest.fixture
def mapped(project: Path, tmp_path: Path) -> Path:
    """A copy of the project with a floor and a map."""
    shutil.copytree(project, tmp_path / "mapped.nvsim")
    with Project.open(tmp_path / "mapped.nvsim", writable=True) as writable:
        whole = read_whole_splat(writable)
        remove_gaussians(writable, whole.rows, np.zeros_like(whole.removed))
        levels.run(writable)
        config = for_splats(MappingConfig())
        ledger.begin_part(writable, "map", map_key(writable, config))
        graph = NavGraph("mapped", {"a": Viewpoint("a", (2.0, 2.5, 1.5), 1.5, 0)})
        ledger.finish(writable, "map", 1.0, recorded_config(config), write_rows=partial(graph_table.write, graph=graph))
    return tmp_path / "mapped.nvsim"


def test_the_stage_bar_names_results_of_other_gaussians_until_they_fit_again(
    qtbot: QtBot, session: Session, mapped: Path
) -> None:
    window, bar = session.window, session.window.part(JobsPart).bar

    def apply(keep_all: bool) -> None:
        cleaning = opened(qtbot, session, mapped)
        panel = window.part(CleanPart).panel
        if keep_all:
            qtbot.mouseClick(panel.keep_all, LEFT)
        assert cleaning.removed.any() != keep_all
        qtbot.mouseClick(panel.apply, LEFT)
        qtbot.waitUntil(lambda: window.modes.current.name == "select", timeout=SECONDS)

    opened(qtbot, session, mapped)
    assert not bar.isVisible() and session.document.contents.missing == ""
    qtbot.keyClick(window.scene, Qt.Key.Key_Escape)
    for _ in range(2):  # removed, restored, removed again, restored again
        apply(keep_all=False)
        qtbot.waitUntil(bar.isVisible, timeout=SECONDS)
        assert bar.sentence.text() == "The splat has changed since the floor was found."
        assert "Run “Find the floor” and “Build the map” again" in window.notice_area.texts[-1]
        apply(keep_all=True)
        qtbot.waitUntil(lambda: not bar.isVisible(), timeout=SECONDS)
        assert window.notice_area.texts[-1] == "0 Gaussians are removed."
    apply(keep_all=False)
    qtbot.waitUntil(bar.isVisible, timeout=SECONDS)
    session.open(mapped)  # also after it is opened again
    qtbot.waitUntil(lambda: not session.document.contents.reading and bar.isVisible(), timeout=SECONDS)
    assert bar.sentence.text() == "The splat has changed since the floor was found."
    qtbot.mouseClick(bar.stage, LEFT)
    built = "The splat has changed since the map was built."
    qtbot.waitUntil(lambda: bar.isVisible() and bar.sentence.text() == built, timeout=SECONDS)
    assert bar.stage.text() == "Build the map only"


def test_a_change_of_the_splat_ends_the_cleaning_with_a_notice_once_something_is_marked(
    qtbot: QtBot, session: Session, project: Path
) -> None:
    opened(qtbot, session, project)
    window, part = session.window, session.window.part(CleanPart)
    qtbot.keyClick(window.scene, Qt.Key.Key_Escape)
    changed = frozenset({"scene_stamp"})
    window.actions_table["mode_clean"].trigger()
    session.document.contentsChanged.emit(changed)  # the reload after an earlier cleaning comes late
    assert window.modes.current is part.mode
    qtbot.waitUntil(lambda: part.mode.cleaning is not None, timeout=SECONDS)
    assert window.scene.feed.source is part._source and CHANGED not in window.notice_area.texts
    session.document.contentsChanged.emit(changed)
    assert window.modes.current.name == "select" and CHANGED in window.notice_area.texts
    assert not isinstance(window.scene.feed.source, WholeSplatSource)
    session.document.contentsChanged.emit(changed)
    assert window.notice_area.texts.count(CHANGED) == 1


def test_escape_leaves_without_changes_and_the_removal_can_be_undone(
    qtbot: QtBot, session: Session, project: Path
) -> None:
    with Project.open(project, writable=True) as writable:
        whole = read_whole_splat(writable)
        remove_gaussians(writable, whole.rows, np.arange(len(whole.removed)) < 50)
    cleaning = opened(qtbot, session, project)
    window, part = session.window, session.window.part(CleanPart)
    before = cleaning.removed.copy()
    assert before.sum() == 50 and not cleaning.edited
    part.panel.keep_all.click()
    window.actions_table["cancel"].trigger()
    assert window.modes.current.name == "select" and window.scene.feed.marks is None
    cleaning = opened(qtbot, session, project)
    np.testing.assert_array_equal(cleaning.removed, before)
    part.panel.keep_all.click()
    part.panel.apply.click()
    qtbot.waitUntil(lambda: window.modes.current.name == "select", timeout=SECONDS)
    with Project.open(project) as again:
        scene = again.scene()
        assert scene is not None and len(scene.model(0).gaussians) == len(before)
