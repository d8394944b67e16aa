"""Compiles the renderer in a child process while no reconstruction is shown, with a note in the status bar. This is
necessary once per machine, and the installation usually does it."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from PySide6.QtCore import QObject, QProcess, QTimer

from app.look.labels import Label
from app.wiring.window import MainWindow

WORDS = "Preparing the 3D view, once on this machine; this takes half a minute."
LATER = 2000  # milliseconds after the window opens until compilation starts; the first project is loaded by then
_COMMAND = ("-P", "-m", "app.drawing.compilation")


class Preparing(QObject):
    """Runs `command` with the current Python. If the command prints anything, it has work to do and the note is
    shown."""

    def __init__(self, window: MainWindow, parent: QObject, command: Sequence[str] = _COMMAND) -> None:
        super().__init__(parent)
        self._window, self._command = window, tuple(command)
        self._label = Label(window)
        self._label.setText(WORDS)
        self._label.hide()
        self._process: QProcess | None = None
        self._later = QTimer(self, singleShot=True, interval=LATER)
        self._later.timeout.connect(self._start)
        window.scene.feed.changed.connect(self._on_feed)

    def begin(self) -> None:
        """Starts compilation after a delay, unless a reconstruction is shown by then, which compiles the renderer
        too."""
        self._later.start()

    def stop(self) -> None:
        """Ends the process. Finished compilations stay in the cache."""
        self._later.stop()
        process, self._process = self._process, None
        if process is not None:
            process.finished.disconnect(self._on_finished)
            process.kill()
            process.waitForFinished(2000)
            process.deleteLater()
        self._label.hide()

    def _on_feed(self) -> None:
        if self._window.scene.feed.source is not None:
            self.stop()

    def _start(self) -> None:
        process = self._process = QProcess(self)
        process.readyReadStandardOutput.connect(self._on_words)
        process.finished.connect(self._on_finished)
        process.start(sys.executable, list(self._command))

    def _on_words(self) -> None:
        self._window.statusBar().addPermanentWidget(self._label)
        self._label.show()

    def _on_finished(self) -> None:
        self._label.hide()
        process, self._process = self._process, None
        if process is not None:
            process.deleteLater()
