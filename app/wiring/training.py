"""The part that opens the training window, from the Jobs menu or from the Jobs panel."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtCore import QByteArray, QSettings

from app.actions import Action
from app.jobs.queue import JobHandle
from app.look.front import bring_up
from app.panels.training_window import TrainingWindow
from app.state.reasons import with_training
from app.wiring.jobs import JobsPart
from app.wiring.part import Part

_PLACE, _SPLIT, _SMOOTHING = "training/geometry", "training/splitter", "training/smoothing"


class TrainingPart(Part):
    """Opens the training window."""

    ACTIONS = (
        Action("training", "Training &window…",
               "Compare the images of training steps with a held-out photo, and the curves of two runs", "&Jobs", 4,
               "Ctrl+Shift+J", enabled=with_training),
    )  # fmt: skip
    window: TrainingWindow | None = None

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"training": self.open_window}

    def restore(self, settings: QSettings) -> None:
        self.context.part(JobsPart).panel.largeWanted.connect(self._open_for)

    def store(self, settings: QSettings) -> None:
        if self.window is not None:
            self.window.close()

    def open_window(self) -> TrainingWindow:
        """Shows the window with the job that is selected in the Jobs panel. There is only one window."""
        if self.window is None:
            self.window = TrainingWindow(self.context.jobs, self.context.window)
            self._place(self.window)
            self.window.finished.connect(self._on_finished)
        self.window.show_run(self.context.part(JobsPart).panel.handle)
        bring_up(self.window)
        return self.window

    def _open_for(self, handle: JobHandle) -> None:
        self.open_window().show_run(handle)

    def _place(self, window: TrainingWindow) -> None:
        settings = self.context.settings
        place, split, smoothing = (settings.value(name) for name in (_PLACE, _SPLIT, _SMOOTHING))
        if isinstance(place, QByteArray):
            window.restoreGeometry(place)
        if isinstance(split, QByteArray):
            window.splitter.restoreState(split)
        if str(smoothing).isdecimal():
            window.smoothing.setValue(int(str(smoothing)))

    def _on_finished(self) -> None:
        """Stores the place and the settings of the closed window."""
        window, self.window = self.window, None
        if window is not None:
            settings = self.context.settings
            settings.setValue(_PLACE, window.saveGeometry())
            settings.setValue(_SPLIT, window.splitter.saveState())
            settings.setValue(_SMOOTHING, window.smoothing.value())
