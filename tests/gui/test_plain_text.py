"""Texts from outside are plain text: never markup that reads files, never misleading, and never so long that they slow
the layout."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import hostile
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PySide6.QtCore import QByteArray, QPoint, QPointF
from PySide6.QtGui import QTextDocument
from PySide6.QtWidgets import QApplication, QLabel, QToolTip, QWidget
from pytestqt.qtbot import QtBot

from nvsim.events import Failed, Log, Progress
from nvsim.graph.selection import GraphSelection
from nvsim.project.jobs.joblist import JobList, JobStatus
from nvsim.project.project import Project
from nvsim_app.look.labels import Label, MarkedLabel, Value
from nvsim_app.look.plain_text import caption, escape_html, in_window, lines, plain, title, tooltip_text
from nvsim_app.modes.mode import Pointer
from nvsim_app.panels.help import HelpWindow
from nvsim_app.panels.results import ResultPanel
from nvsim_app.panels.validation import ValidationPanel
from nvsim_app.state.document import Document
from nvsim_app.state.results import EvaluationResult, ResultTable
from nvsim_app.wiring.checking import ComparePart
from nvsim_app.wiring.files import RecentPart
from nvsim_app.wiring.frames import FramePart
from nvsim_app.wiring.modes import ContextPart
from nvsim_app.wiring.window import MainWindow

ANY = st.text(st.characters(exclude_categories=()), max_size=300)


class _Reading(QTextDocument):
    """Records the files that it would read."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[object] = []

    def loadResource(self, type: int, name: object) -> object:
        self.asked.append(name)
        return QByteArray()  # for None Qt would read it


@given(ANY)
def test_a_name_is_one_line_that_shows_every_letter(text: str) -> None:
    shown = plain(text, 100)
    assert len(shown) <= 100 and not hostile._UNSEEN.search(shown) and "\n" not in shown
    assert shown == text or not text.isprintable() or len(text) > 100


@given(ANY.filter(lambda text: in_window(f"<{text}") == f"<{text}" and in_window(text) == text))  # names no option
def test_a_tip_and_our_own_markup_say_the_text_and_read_nothing(text: str) -> None:
    for markup in (f"<b>{escape_html(text)}</b>", tooltip_text(f"<{text}")):
        document = _Reading()
        document.setHtml(markup)
        words = lines(text) if markup.startswith("<b>") else lines(f"<{text}")
        said = document.toPlainText().replace("\xa0", " ")
        said, words = said.replace("\u200b", ""), words.replace("\u200b", "")
        assert said.split() == words.replace("\xa0", " ").split() and not document.asked


def test_what_cannot_be_seen_is_made_visible() -> None:
    assert plain("photo\u202egpj.exe\x07\n") == "photo‹U+202E›gpj.exe\\x07\\n"
    assert plain("\udcff\x7f\u2028\u200b") == "\\udcff\\x7f‹U+2028›‹U+200B›"
    assert lines("a\r\nb\tc\u2066") == "a\nb    c‹U+2066›"
    assert plain("Größe 3 µm, 東京, שלום") == "Größe 3 µm, 東京, שלום"


def test_a_long_text_is_cut_where_its_ends_can_be_seen() -> None:
    assert plain("a" * 10**6 + ".jpg", 20) == "a" * 13 + "…" + "aa.jpg"
    assert len(lines("row\n" * 10**5).split("\n")) == 40 and lines("x" * 10**6).endswith("…")


def test_captions_and_titles_keep_their_signs() -> None:
    assert caption("R&D\tCtrl+Q") == "R&&D\\tCtrl+Q" and title("a[*]b") == "a[*][*]b"


def test_a_label_is_plain_and_does_not_widen_the_window(qtbot: QtBot) -> None:
    label = Label("<b>" + "x" * 10**5)
    qtbot.addWidget(label)
    assert label.minimumSizeHint().width() <= 400 and label.text().startswith("<b>xxx")
    assert not hostile.faults(label)


def test_a_path_in_a_label_is_copied_as_it_is(qtbot: QtBot) -> None:
    path = "/home/person/captures of the building/" + "a-folder_of-frames/" * 12
    label = Label(f"Cannot read {path}; is it there?")
    qtbot.addWidget(label)
    assert path in label.text() and lines("x" * 300) == "x" * 300


def test_markup_from_a_file_is_shown_as_plain_text(qtbot: QtBot, tmp_path: Path) -> None:
    with hostile.trap(tmp_path / "trap") as opened:
        for markup in ('<b>ours</b> <img src="{}">', '<table background="{}"><tr><td>x</td></tr></table>'):
            label = MarkedLabel(markup.format(tmp_path / "trap"))
            qtbot.addWidget(label)
            label.show()
            label.grab()
            assert "<" in label.text() and not opened and not hostile.faults(label)
    ours = MarkedLabel("<b>ours</b>")
    qtbot.addWidget(ours)
    plainly = Label("ours")
    qtbot.addWidget(plainly)
    assert ours.sizeHint().width() > 0 and ours.grab().toImage() != plainly.grab().toImage()


def test_the_help_reads_its_own_pictures_alone(qtbot: QtBot, tmp_path: Path) -> None:
    window = HelpWindow("first-project")
    qtbot.addWidget(window)
    with hostile.trap(tmp_path / "trap") as opened:
        window.text.setHtml(f'<img src="{tmp_path / "trap"}"><img src="file://{tmp_path / "trap"}">')
        window.show()
        window.grab()
        window.text.setSource(f"file://{tmp_path / 'trap'}")
        assert not opened


# The whole window ------------------------------------------------------------------------------------------------


@pytest.fixture
def fifo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A FIFO that every text names, in the working folder: names of files hold no slash."""
    monkeypatch.chdir(tmp_path)
    with hostile.trap(tmp_path / "trap") as opened:
        yield tmp_path / "trap"
        assert not opened


@pytest.fixture
def attacked(fifo: Path, make_window: Callable[[Document], MainWindow], qtbot: QtBot) -> Iterator[MainWindow]:
    """The window on a project every text of which names the FIFO, with a job and a notice."""
    project = fifo.parent / f"{hostile.EVIL}<img src=trap> & \u202e\n.nvsim"
    Project.create_or_open(project).close()
    jobs = JobList(project)
    job = jobs.add("train", ["--preset", hostile.text(fifo)], hostile.text(fifo, long=True))
    jobs._write(job, JobStatus("failed", started=1.7e9, finished=1.7e9 + 5, code=1, message=hostile.text(fifo)))
    job.messages.write_text(hostile.text(fifo, long=True), errors="replace")
    document = Document()
    window = make_window(document)
    document.set_contents(hostile.contents(fifo, project))
    qtbot.waitUntil(lambda: len(window.jobs.handles) == 1, timeout=10_000)
    yield window
    document.editing.close()
    window.close()


def _part(window: MainWindow, kind: type) -> object:
    return window.part(kind)


def _shown(window: MainWindow) -> list[str]:
    """Every panel comes to the front and is drawn; then what is wrong is looked for."""
    for name in window.panels:
        window.show_dock(name)
        QApplication.processEvents()
        window.panels[name].grab()
    return hostile.faults(window)


def test_texts_from_outside_are_text_in_the_whole_window(attacked: MainWindow, fifo: Path, qtbot: QtBot) -> None:
    window, document = attacked, attacked.document
    width = window.minimumSizeHint().width()
    assert _shown(window) == []
    # Notices, the log, the status bar and a job that speaks.
    window.notices.error(hostile.text(fifo, long=True), hostile.text(fifo, long=True))
    window.notices.warning(hostile.text(fifo))
    window.parts[0].context.modes.said.emit(hostile.text(fifo))
    handle = window.jobs.handles[0]
    for event in (
        Log(hostile.text(fifo)),
        Failed(hostile.text(fifo), hostile.text(fifo), 1),
        Progress(hostile.text(fifo), 1, 2, hostile.text(fifo)),
    ):
        handle.history.receive(1.7e9, event)
    window.panels["jobs"].choose(handle)
    window.panels["jobs"].offer.show_jobs([handle])
    window.jobs.changed.emit()
    assert _shown(window) == []
    # What is selected, and what was done.
    a, b = list(document.graph.viewpoints)[2:4]
    for selection in (
        GraphSelection(frozenset({a})),
        GraphSelection(frozenset(), frozenset({next(iter(document.graph.edges))})),
        GraphSelection(frozenset({a, b})),
    ):
        document.editing.select(selection)
        assert _shown(window) == []
    document.select(viewpoint=a)
    assert _shown(window) == []
    document.select(submap=1)
    assert _shown(window) == []
    document.editing.run("remove_edges", {"pairs": [list(key) for key in document.graph.edges if a in key]})
    document.editing.run("add_edge", {"a": a, "b": b})
    document.editing.run("add_edge", {"a": hostile.text(fifo), "b": b})  # there is none of that name
    validation = window.panels["validation"]
    assert isinstance(validation, ValidationPanel)
    qtbot.waitUntil(lambda: bool(document.editing.findings), timeout=10_000)
    validation.renew()
    validation.choose(validation.model.rows[0])
    document.editing.ignore(validation.model.rows[0].key, hostile.text(fifo, long=True))
    validation.ignored.setChecked(True)
    validation.renew()
    _part(window, ComparePart).compare_with_step(0)
    assert _shown(window) == []
    assert window.minimumSizeHint().width() <= max(width, 1400)


def test_texts_of_pages_menus_and_results_are_text(attacked: MainWindow, fifo: Path, qtbot: QtBot) -> None:
    window, document = attacked, attacked.document
    browser = _part(window, FramePart).browser
    browser.open(1)
    QApplication.processEvents()
    assert _shown(window) == [] and browser.page.title.text().startswith("<b>EVIL1 &lt;img")
    window.actions_table["leave_frame"].trigger()
    # The palette.
    window.findChild(QWidget, "commandPalette").open()
    for typed in ("", hostile.EVIL, f"{hostile.EVIL}3 <img"):
        window.findChild(QWidget, "commandPalette").line.setText(typed)
        assert _shown(window) == []
    window.findChild(QWidget, "commandPalette").close()
    # Menus: of what is under the cursor, and of the projects of late.
    scene = window.scene
    for point in (QPointF(scene.width() / 2, scene.height() * k / 20) for k in range(1, 20)):
        menu = _part(window, ContextPart).menu(Pointer(scene.surface, point))
        assert hostile.faults(menu) == []
        menu.deleteLater()
    part = _part(window, RecentPart)
    part._on_project()
    part._fill_menu()
    assert len(part.projects.paths) == 1 and hostile.faults(part._menu) == []
    # Results.
    evil = hostile.text(fifo)
    rows = tuple((f"{evil}{i}", float(i), evil) for i in range(5))
    results = window.panels["results"]
    assert isinstance(results, ResultPanel)
    results.show_results([EvaluationResult("x", evil, 1.7e9, (ResultTable(evil, ("name", evil, f"{evil}2"), rows),))])
    assert _shown(window) == [] and results.plot.isVisibleTo(results)
    document.select()
    # Nothing to show: what is missing, and the projects of late.
    document.set_contents(
        replace(document.contents, capture=None, graph=None, submaps=(), scene_stamp=None, occupancy=None)
    )
    window.start.show_recent(part.projects.paths)
    window.empty.show_message(evil, "import")
    assert _shown(window) == []


def _labels() -> list[QLabel]:
    return [w for w in QApplication.topLevelWidgets() if isinstance(w, QLabel)]


def test_a_tool_tip_that_is_really_shown_reads_nothing(fifo: Path, qtbot: QtBot) -> None:
    widget = QWidget()
    qtbot.addWidget(widget)
    widget.show()
    QToolTip.showText(QPoint(10, 10), tooltip_text(hostile.text(fifo)), widget)
    (label,) = [w for w in _labels() if w.isVisible()]
    label.grab()
    assert "EVIL0" in label.text() and label.width() < 1500
    QToolTip.hideText()
    qtbot.waitUntil(lambda: not any(w.isVisible() for w in _labels()), timeout=20_000)


def test_a_value_wider_than_its_field_ends_in_an_ellipsis(qtbot: QtBot) -> None:
    long, field = "304ddcc1ce6477d8cdaeb08220bacf3c" * 2, Value()
    qtbot.addWidget(field)
    field.show_value(long)
    field.resize(120, 20)
    field.show()

    def last_columns() -> set[int]:
        image = field.grab().toImage()
        return {image.pixel(x, y) for x in range(image.width() - 3, image.width()) for y in range(image.height())}

    assert len(last_columns()) == 1 and field.text() == long
