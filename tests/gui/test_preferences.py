"""The preferences: each acts, is remembered, and is found; and the table of keys."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from editing_room import Hand
from PySide6.QtCore import QPointF, QSettings, Qt
from PySide6.QtGui import QKeySequence
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDoubleSpinBox, QPushButton

from nvsim import kernel_threads
from nvsim_app.look import lengths, theme
from nvsim_app.look.labels import Value
from nvsim_app.panels.preferences import FIXED, OF, PREFERENCES, Preferences
from nvsim_app.panels.tables import TablePanel
from nvsim_app.state.document import Document
from nvsim_app.views.navigation import ControlSettings, flight_directions
from nvsim_app.wiring.appearance import PreferencePart
from nvsim_app.wiring.editing import AutosavePart
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.window import MainWindow


@pytest.fixture(autouse=True)
def meters_again():
    yield
    lengths.choose("metres")


def texts(window: MainWindow) -> str:
    window.show_dock("details")
    QApplication.processEvents()
    fields = window.panels["details"].findChildren(Value)
    return " ".join(field.text() for field in fields if not field.isHidden())


def test_every_length_that_is_shown_is_in_feet(window: MainWindow, document: Document) -> None:
    id = document.graph_arrays.ids[3]
    document.select(viewpoint=id)
    height = document.graph.viewpoints[id].height
    assert f"{height:.2f} m" in texts(window)
    window.preferences.set("units", "feet")
    assert f"{height / 0.3048:.2f} ft" in texts(window) and " m" not in texts(window)
    tables = window.panels["tables"]
    assert isinstance(tables, TablePanel)
    tables.refresh.finish()
    columns = range(tables.edges.columnCount())
    titles = [tables.edges.headerData(c, Qt.Orientation.Horizontal).strip() for c in columns]
    column = titles.index("Length, ft")
    meters = tables.edges.columns[column].value(tables.edges.row(0))
    assert tables.edges.data(tables.edges.index(0, column)) == f"{meters / 0.3048:.2f}"
    plan = window.part(MapPart).view
    assert plan._scale.text.toPlainText().endswith(" ft")
    shown = float(plan._scale.text.toPlainText().split()[0])
    assert plan._scale.size == pytest.approx(shown * 0.3048)
    plan.frame.show_position((3.048, 6.096))
    assert plan.frame.coordinates.text() == "10.00, 20.00 ft"
    window.preferences.set("units", "metres")
    assert f"{height:.2f} m" in texts(window) and plan._scale.text.toPlainText().endswith(" m")


def test_what_is_measured_is_in_feet(window: MainWindow, document: Document) -> None:
    window.preferences.set("units", "feet")
    window.modes.choose("measure")
    said: list[str] = []
    window.modes.said.connect(said.append)
    hand = Hand(window, window.modes.canvases[1].surface)
    a, b = document.graph_arrays.feet[:2]
    hand.click(a)
    hand.click(b)
    assert said[-1] == f"{float(((a - b) ** 2).sum() ** 0.5) / 0.3048:.2f} ft"


def test_a_button_does_what_was_chosen_for_it(window: MainWindow) -> None:
    motions = ControlSettings(left="look", middle="turn", right="shift")
    button = Qt.MouseButton
    assert motions.motion(button.LeftButton, False) == "look" == motions.motion(button.LeftButton, True)
    assert motions.motion(button.MiddleButton, True) == "shift" and motions.motion(button.NoButton, False) == ""
    before = window.scene.pose
    window.preferences.set("mouse/middle", "look")
    _drag(window, button.MiddleButton)
    looked = window.scene.pose
    assert looked.position == before.position and looked.elevation < before.elevation
    window.preferences.set("mouse/upside_down", True)
    window.preferences.set("mouse/turning", 2.0)
    _drag(window, button.MiddleButton)
    assert window.scene.pose.elevation - looked.elevation == pytest.approx(2 * (before.elevation - looked.elevation))


def _drag(window: MainWindow, button: Qt.MouseButton) -> None:
    from PySide6.QtCore import QEvent
    from PySide6.QtGui import QMouseEvent

    scene = window.scene
    for kind, y, held in (
        (QEvent.Type.MouseButtonPress, 50, button),
        (QEvent.Type.MouseMove, 70, button),
        (QEvent.Type.MouseButtonRelease, 70, Qt.MouseButton.NoButton),
    ):
        pressed = Qt.MouseButton.NoButton if kind == QEvent.Type.MouseMove else button
        place = QPointF(60, y)
        event = QMouseEvent(kind, place, place, pressed, held, Qt.KeyboardModifier.NoModifier)
        QApplication.sendEvent(scene, event)


def test_the_graph_is_saved_by_itself_where_that_is_wanted(window: MainWindow, document: Document, monkeypatch) -> None:
    saved: list[bool] = []
    monkeypatch.setattr(document.editing, "save", lambda: saved.append(True))
    monkeypatch.setattr("nvsim_app.wiring.editing.can_save", lambda d: None if d.editing.dirty else "nothing")
    timer = window.part(AutosavePart).timer
    document.editing.run("remove_edges", {"pairs": [list(next(iter(document.graph.edges)))]})
    assert not timer.isActive()
    window.preferences.set("autosave_minutes", 2)
    assert timer.isActive() and timer.interval() == 120_000
    timer.timeout.emit()
    assert saved == [True]
    window.preferences.set("autosave_minutes", 0)
    assert not timer.isActive()


def test_the_theme_and_what_is_drawn_follow(window: MainWindow) -> None:
    table = window.actions_table
    for name in ("light", "dark"):
        window.preferences.set("theme", name)
        assert theme.is_dark(QApplication.palette()) == (name == "dark") == table["dark"].isChecked()
    window.preferences.set("splat_budget", "100000")
    assert window.scene.feed.budget == 100_000 and table["budget_100000"].isChecked()
    table["budget_0"].trigger()
    assert window.preferences["splat_budget"] == "0"
    window.preferences.set("renderer", "CPU")
    assert window.scene.feed.renderer == "CPU" and table["renderer_CPU"].isChecked()


def test_jobs_get_so_many_threads(window: MainWindow, monkeypatch, tmp_path: Path) -> None:
    from nvsim.cli import worker

    started: list[dict[str, str]] = []
    ended = SimpleNamespace(poll=lambda: 0)
    monkeypatch.setattr(worker.subprocess, "Popen", lambda *a, env=None, **k: started.append(env) or ended)
    monkeypatch.setattr(worker, "_started", [])
    monkeypatch.setattr(kernel_threads, "cores", lambda: 8)
    window.preferences.set("job_threads", 1)
    assert window.jobs.threads == 1
    window.jobs.start("floors", [], tmp_path, "floors")
    assert started[0]["NUMBA_NUM_THREADS"] == started[0]["OMP_NUM_THREADS"] == "1"
    window.preferences.set("job_threads", 0)
    window.jobs.start("floors", [], tmp_path, "floors")
    assert started[1] is None
    monkeypatch.setenv("NUMBA_NUM_THREADS", "3")
    assert kernel_threads.allowed_threads() == 3 and kernel_threads.limit(99)["OMP_NUM_THREADS"] == "8"


def test_settings_of_any_kind_become_values_that_fit(settings: QSettings) -> None:
    for preference in PREFERENCES:
        settings.setValue(preference.key, "nonsense")
    assert all(Preferences(settings)[p.key] == p.default for p in PREFERENCES)
    settings.setValue("mouse/turning", 1e9)
    assert Preferences(settings)["mouse/turning"] == 1.0
    assert OF["mouse/upside_down"].fitting("true") is True


def test_the_dialog_shows_the_values_sets_them_and_finds_them(window: MainWindow) -> None:
    dialog = window.part(PreferencePart).open()
    editor = dialog.editors["mouse/flying"]
    assert isinstance(editor, QDoubleSpinBox)
    editor.setValue(7.5)
    assert window.scene.navigation.speed == 7.5
    window.preferences.set("mouse/flying", 3.0)
    assert editor.value() == 3.0
    dialog.search.setText("aircraft")
    shown = [key for key, each in dialog.editors.items() if each.isVisibleTo(dialog)]
    assert shown == ["mouse/upside_down"]
    dialog.search.setText("component")
    assert dialog.tabs.currentWidget() is dialog.keys and not dialog.nothing.isHidden()
    dialog.search.setText("")
    bar = dialog.tabs.tabBar()
    for page in (1, 0):
        QTest.mouseClick(bar, Qt.MouseButton.LeftButton, pos=bar.tabRect(page).center())
        buttons = [b for b in dialog.findChildren(QPushButton) if b.text() == "Reset to defaults" and b.isVisible()]
        assert len(buttons) == 1 and buttons[0] in (dialog.keys.reset_all, *dialog.buttons.buttons())
    QTest.mouseClick(buttons[0], Qt.MouseButton.LeftButton)
    assert window.scene.navigation.speed == editor.value() == 2.0
    assert dialog.minimumSizeHint().height() < 500 and dialog.minimumSizeHint().width() < 900
    dialog.close()


def test_a_key_is_changed_kept_and_given_back(window: MainWindow, settings: QSettings, document, make_window) -> None:
    dialog = window.part(PreferencePart).open_keys()
    dialog.keys.choose("depth")
    dialog.keys.editor.setKeySequence(QKeySequence("Ctrl+Alt+9"))
    dialog.keys.editor.editingFinished.emit()
    table = window.actions_table
    assert table.keys("depth") == "Ctrl+Alt+9" and "(Ctrl+Alt+9)" in table["depth"].toolTip()
    dialog.keys.choose("fly_up")
    dialog.keys.editor.setKeySequence(QKeySequence("Ctrl+U"))
    dialog.keys.editor.editingFinished.emit()
    assert "without Ctrl" in dialog.keys.words.text()
    dialog.keys.editor.setKeySequence(QKeySequence("U"))
    dialog.keys.editor.editingFinished.emit()
    assert window.scene.navigation.hands.keys[Qt.Key.Key_U] == (0, 0, 1)
    assert Qt.Key.Key_E not in window.scene.navigation.hands.keys
    dialog.close()
    window.close()
    again = make_window(document)
    assert again.actions_table.keys("depth") == "Ctrl+Alt+9" and Qt.Key.Key_U in again.scene.navigation.hands.keys
    again.part(PreferencePart).bindings.reset_all()
    assert again.actions_table.keys("depth") == "4" and Qt.Key.Key_E in again.scene.navigation.hands.keys
    assert not [key for key in settings.allKeys() if key.startswith("keys/")]


def test_keys_that_exclude_each_other_are_named(window: MainWindow) -> None:
    part = window.part(PreferencePart)
    assert part.bindings.conflicts() == {}
    assert part.bindings.bind("depth", "W") == ""
    assert part.bindings.conflicts() == {"depth": ("Fly forward",), "fly_forward": ("Depth",)}
    dialog = part.open_keys()
    dialog.keys.only.setChecked(True)
    assert dialog.keys.search("") == 2 and "2 commands" in dialog.keys.words.text()
    dialog.keys.choose("depth")
    QTest.mouseClick(dialog.keys.reset, Qt.MouseButton.LeftButton)
    assert part.bindings.conflicts() == {} and dialog.keys.search("") == 0
    dialog.keys.only.setChecked(False)
    assert 1 <= dialog.keys.search("ctrl+p") < 6
    assert dialog.keys.search("") == len(part.bindings.rows) > len(FIXED)
    dialog.close()


def test_what_flies_is_one_key() -> None:
    assert flight_directions({"fly_up": "U", "fly_down": "Ctrl+U", "fly_left": ""}) == {int(Qt.Key.Key_U): (0, 0, 1)}
