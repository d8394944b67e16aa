"""Compiles the renderer in a side process while no reconstruction is shown, with a note in the status bar. This is
necessary once per machine, and the installation usually does it."""

from __future__ import annotations

from PySide6.QtCore import QObject, QTimer

from app.drawing import compilation
from app.look.labels import Label
from app.processes.child import Program
from app.processes.side_process import SideProcess
from app.wiring.window import MainWindow

WORDS = "Preparing the 3D view, once on this machine; this takes half a minute."
LATER = 2000  # milliseconds after the window opens until compilation starts; the first project is loaded by then
_PROGRAM = Program(compilation.serve, "compilation", "The renderer was not compiled ahead")


class Preparing(QObject):
    """Runs `program`. If it sends a notice, it has work to do and the note is shown."""

    def __init__(self, window: MainWindow, parent: QObject, program: Program = _PROGRAM) -> None:
        super().__init__(parent)
        self._window = window
        self._label = Label(window)
        self._label.setText(WORDS)
        self._label.hide()
        self._process = SideProcess(program, self)
        self._process.heard.connect(self._show)
        self._process.ended.connect(self._label.hide)
        self._later = QTimer(self, singleShot=True, interval=LATER)
        self._later.timeout.connect(lambda: self._process.open(None))
        window.scene.feed.changed.connect(self._on_feed)

    def begin(self) -> None:
        """Starts compilation after a delay, unless a reconstruction is shown by then, which compiles the renderer
        too."""
        self._later.start()

    def stop(self) -> None:
        """Ends the process. Finished compilations stay in the cache."""
        self._later.stop()
        self._process.close()
        self._label.hide()

    def _on_feed(self) -> None:
        if self._window.scene.feed.source is not None:
            self.stop()

    def _show(self) -> None:
        self._window.statusBar().addPermanentWidget(self._label)
        self._label.show()
