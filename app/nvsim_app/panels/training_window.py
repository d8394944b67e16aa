"""The training window: images of the training steps, curves, and a comparison with another run."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QComboBox, QSlider, QSplitter, QWidget

from nvsim_app.jobs.queue import JobHandle, JobQueue
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.labels import Label, WrappingRow
from nvsim_app.look.plain_text import CAPTION, plain, tooltip_text
from nvsim_app.look.widgets import Dialog, named
from nvsim_app.panels.job_plots import JobPlots
from nvsim_app.panels.job_table import STATE_WORDS, time_of_day
from nvsim_app.panels.training_images import TrainingImages
from nvsim_app.state.reasons import TRAININGS

_SMOOTHEST = 99  # percent: the largest weight of the mean so far


class TrainingWindow(Dialog):
    """A non-modal window for one training run."""

    def __init__(self, queue: JobQueue, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._queue = queue
        self.setWindowTitle("Training")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowFlag(Qt.WindowType.WindowMaximizeButtonHint)
        self.run = self._choice("Training run to show")
        self.submap = self._choice("Submap whose images and curves are shown")
        self.other = self._choice("Another run of this project to compare with; its curves are dashed")
        self.images = TrainingImages(self)
        self.plots = JobPlots(self, large=True)
        self.legend = Label(self, wordWrap=True, quiet=True)
        self.smoothing = named(QSlider(Qt.Orientation.Horizontal, self), "Smoothing")
        self.smoothing.setRange(0, _SMOOTHEST)
        self.smoothing.setToolTip(
            tooltip_text("How much the curves are smoothed; the measured values stay visible behind them")
        )
        self.smoothing.setMinimumWidth(90)
        self.smoothed = Label(self)
        head = WrappingRow()
        for words, box in (("Run", self.run), ("Submap", self.submap), ("Compare with", self.other)):
            name = Label(words, self)
            name.setMinimumHeight(box.sizeHint().height())  # so that both are on one line
            head.addWidget(name)
            head.addWidget(box)
        right = QWidget(self)
        row = hbox(Label("Smoothing", self), (self.smoothing, 1), self.smoothed, margins=(8, 4, 8, 0))
        vbox(row, (self.plots, 1), self.legend, on=right, margins=0)
        self.legend.setContentsMargins(8, 0, 8, 4)
        self.splitter = QSplitter(Qt.Orientation.Horizontal, self, childrenCollapsible=True)
        self.splitter.addWidget(self.images)
        self.splitter.addWidget(right)
        self.splitter.setSizes([640, 420])
        self.splitter.setStretchFactor(0, 3)
        self.splitter.setStretchFactor(1, 2)
        vbox(head, (self.splitter, 1), on=self, margins=(8, 8, 8, 4))
        self.run.currentIndexChanged.connect(lambda _: self._on_run())
        self.submap.currentIndexChanged.connect(lambda _: self._show())
        self.other.currentIndexChanged.connect(lambda _: self._on_other())
        self.smoothing.valueChanged.connect(lambda _: self._on_smoothing())
        queue.changed.connect(self._list)
        queue.progressed.connect(self._refresh)
        self.resize(1080, 680)
        self.fit_screen()
        self._on_smoothing()
        self._list()

    def _choice(self, about: str) -> QComboBox:
        return named(QComboBox(self, sizeAdjustPolicy=QComboBox.SizeAdjustPolicy.AdjustToContents), tip=about)

    # Contents ---------------------------------------------------------------------------------------------------

    def show_run(self, handle: JobHandle | None) -> None:
        """Shows this training, or the newest one if `handle` is None."""
        row = -1 if handle is None else self.run.findData(handle.number)
        self.run.setCurrentIndex(max(0, row))

    @property
    def handle(self) -> JobHandle | None:
        return self._chosen(self.run)

    @property
    def other_handle(self) -> JobHandle | None:
        return self._chosen(self.other)

    def _chosen(self, box: QComboBox) -> JobHandle | None:
        number = box.currentData()
        return None if number is None else self._queue.handle(number)

    def _list(self) -> None:
        """Lists the training runs, newest first."""
        found = [h for h in reversed(self._queue.handles) if h.job.order.verb in TRAININGS]
        self._fill(self.run, [(_words(h), h.number) for h in found])
        self._list_others()
        self._on_run()

    def _list_others(self) -> None:
        found = [h for h in reversed(self._queue.handles) if h.job.order.verb in TRAININGS]
        rows = [(_words(h), h.number) for h in found if h.number != self.run.currentData()]
        self._fill(self.other, [("No other run", None), *rows])
        self.other.setEnabled(bool(rows))

    def _list_submaps(self) -> None:
        handle = self.handle
        series = {} if handle is None else handle.history.series
        known = sorted({submap for one in series.values() for submap in one if submap >= 0})
        rows: list[tuple[str, int | None]] = [("All", None)] if len(known) != 1 else []
        self._fill(self.submap, rows + [(f"{n}", n) for n in known])

    @staticmethod
    def _fill(box: QComboBox, rows: list[tuple[str, int | None]]) -> None:
        """Replaces the rows of a box. Keeps the selected row if it still exists."""
        if [(box.itemText(i), box.itemData(i)) for i in range(box.count())] == rows:
            return
        chosen = box.currentData()
        with QSignalBlocker(box):
            box.clear()
            for words, data in rows:
                box.addItem(plain(words, CAPTION), data)
            data_of = [data for _, data in rows]
            box.setCurrentIndex(data_of.index(chosen) if chosen in data_of else 0)

    def _on_run(self) -> None:
        if self.handle is not None:
            self._queue.read_events_of(self.handle)
        self._list_others()
        self._list_submaps()
        self._show()

    def _on_other(self) -> None:
        if self.other_handle is not None:
            self._queue.read_events_of(self.other_handle)
        self._show()

    def _show(self) -> None:
        submap = self.submap.currentData()
        self.plots.show_submap(submap)
        self.plots.compare(self.other_handle)
        self.plots.show_job(self.handle)
        self.images.show_images(self.handle, self.other_handle, submap)
        self._say_legend()

    def _refresh(self) -> None:
        """Updates the window after a job reported progress."""
        before = self.submap.currentData()
        self._list_submaps()
        if self.submap.currentData() != before:
            self._show()
        self.plots.refresh()
        self.images.refresh()
        self._say_legend()

    def _on_smoothing(self) -> None:
        weight = self.smoothing.value() / 100
        self.smoothed.setText(f"{weight:.2f}")
        self.plots.set_smoothing(weight)

    def _say_legend(self) -> None:
        """States which curves belong to which run."""
        handle, other = self.handle, self.other_handle
        words = "" if handle is None else f"Solid: {_words(handle)}."
        if other is not None:
            submap = self.submap.currentData()
            trained = {s for one in other.history.series.values() for s in one}
            words += f" Dashed: {_words(other)}."
            if not other.has_unread_events and (not trained or (submap is not None and submap not in trained)):
                words += " It has no curves." if submap is None else f" It has no curves of submap {submap}."
        self.legend.setText(words)
        self.legend.setVisible(bool(words))

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._refresh()


def _words(handle: JobHandle) -> str:
    """For example "Train, 14:05, done"."""
    at = handle.job.status.started or handle.job.order.ordered
    return f"{handle.title}, {time_of_day(at)}, {STATE_WORDS.get(handle.state, handle.state)}"
