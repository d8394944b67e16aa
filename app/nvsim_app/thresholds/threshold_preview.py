"""Other thresholds tried on the whole graph: prepared in a thread, decided within one step of a slider, and drawn over
both views. Edges that would appear are green, edges that would disappear are red."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QPainter, QPen

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.evidence.rethreshold import Rethresholder, ThresholdEffect
from nvsim_app.layers.layer import Layer
from nvsim_app.look import colors
from nvsim_app.painting.picking import projected_segments
from nvsim_app.painting.primitives import Primitives
from nvsim_app.state.document import Document
from nvsim_app.views.graph_surface import GraphSurface, MapSurface


class ThresholdPreview(QObject):
    """Tries thresholds. changed(): `config` changed, the outcome follows. decided(): `outcome` changed."""

    changed = Signal()
    decided = Signal()
    _prepared = Signal(int, object)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self.config = document.contents.thresholds
        self.outcome: ThresholdEffect | None = None
        self.refusal = ""
        """The reason why `config` cannot decide the graph: a criterion needs values that were not measured."""
        self.milliseconds = 0.0  # duration of the last decision
        self._redecider: Rethresholder | None = None
        self._number = 0
        self._thread: threading.Thread | None = None
        self._due = QTimer(self, singleShot=True, interval=0)
        self._due.timeout.connect(self._decide)
        self._prepared.connect(self._on_prepared)

    @property
    def project_config(self) -> MappingConfig:
        """The thresholds of the project's graph."""
        return self._document.contents.thresholds

    @property
    def differs(self) -> bool:
        """Whether the thresholds differ from the project's."""
        return self.config != self.project_config

    @property
    def preparing(self) -> bool:
        return self._redecider is None and self._thread is not None

    @property
    def redecider(self) -> Rethresholder | None:
        return self._redecider

    def set_config(self, config: MappingConfig) -> None:
        """Tries these thresholds. Several calls in one turn of the event loop are decided once."""
        if config == self.config:
            return
        self.config = config
        self.changed.emit()
        self.prepare()
        if self._redecider is not None:
            self._due.start()

    def prepare(self) -> None:
        """Starts to sum up the evidence in a thread, unless that is done or running."""
        graph = self._document.graph
        if graph is None or self._thread is not None or (self._redecider and self._redecider.graph is graph):
            return
        self._number += 1
        number, walk, config = self._number, self._document.trajectory.positions, self.config
        self._redecider = None

        def work() -> None:
            redecider = Rethresholder(graph, walk)
            with contextlib.suppress(InputError):  # `_decide` reports it in the main thread
                redecider.decide(config)  # computes the sums for this width of the robot
            self._prepared.emit(number, redecider)

        self._thread = threading.Thread(target=work, name="thresholds", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stops all work, and returns when it has ended."""
        self._number += 1
        self._due.stop()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def on_graph(self, fresh: bool) -> None:
        """Drops the outcome, because the graph changed. `fresh`: it was built or opened, and has its own thresholds."""
        if fresh:
            self.config = self.project_config
        self._redecider, self.outcome, self.refusal = None, None, ""
        self._number += 1  # the running preparation is for an old graph
        self.changed.emit()
        self.decided.emit()
        if self.differs:
            self.prepare()

    def graph(self) -> NavGraph | None:
        """The graph with the edges of the outcome; None if there is no outcome."""
        if self._redecider is None or self.outcome is None:
            return None
        return self._redecider.apply(self.outcome)

    def _on_prepared(self, number: int, redecider: Rethresholder) -> None:
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if number != self._number:
            if self.differs:
                self.prepare()
            return
        self._redecider = redecider
        self._decide()

    def _decide(self) -> None:
        if self._redecider is None:
            return
        begin = time.perf_counter()
        try:
            self.outcome, self.refusal = self._redecider.decide(self.config), ""
        except InputError as error:
            self.outcome, self.refusal = None, str(error)
        self.milliseconds = 1e3 * (time.perf_counter() - begin)
        self.decided.emit()


_MANY = 800  # lines in view; more wide lines would make the slider stutter
_LIFT = 0.02  # meters above the existing edges
Points = NDArray[np.float64]
Segments = Callable[[Points, Points], tuple[Points, NDArray[np.int64], Points]]  # see `GraphSurface.segments`


def changed_segments(trial: ThresholdPreview, document: Document) -> dict[str, NDArray[np.float64]]:
    """The segments that would "appear" and "disappear", each (M, 2, 3) world positions on the floor in meters."""
    outcome, redecider = trial.outcome, trial.redecider
    nothing = np.zeros((0, 2, 3))
    if outcome is None or redecider is None:
        return {"appear": nothing, "disappear": nothing}
    arrays = document.graph_arrays
    rows = np.array([arrays.index.get(id, -1) for id in redecider.ids], np.int64)
    result = {}
    for name, pairs in (("appear", outcome.new_edges), ("disappear", outcome.lost_edges)):
        known = rows[pairs]
        result[name] = arrays.feet[known[(known >= 0).all(axis=1)]] if len(pairs) else nothing
    return result


_TONES = {"disappear": colors.BLOCKED, "appear": "#5dff9b"}


class PreviewLayer(Layer):
    """The preview as a layer of the 3D view, and on the map."""

    name = "preview"
    title = "Edges under other thresholds"

    def __init__(self, trial: ThresholdPreview, document: Document) -> None:
        self._trial, self._document = trial, document
        self._primitives = Primitives()
        self._of: object = None
        self._ends: dict[str, NDArray[np.float64]] = {}

    @property
    def missing(self) -> str:
        """The reason why there is nothing to draw; "" if there is something."""
        return "" if self._trial.outcome else "the thresholds tried change no edge"

    def paint(self, painter: QPainter, camera: Camera) -> None:
        """Draws over the image of `camera`, which is scaled to the widget's logical pixels."""
        self._paint(painter, partial(projected_segments, camera), 2.0)

    def paint_on_map(self, painter: QPainter, surface: GraphSurface) -> None:
        if isinstance(surface, MapSurface):
            painter.save()
            self._paint(painter, surface.segments, 2.6)
            painter.restore()

    def _paint(self, painter: QPainter, segments: Segments, far: float) -> None:
        """`far`: width in pixels of lines that are farther than 8 m from the camera."""
        if not self._trial.outcome:
            return
        if self._of is not self._trial.outcome:
            self._ends, self._of = changed_segments(self._trial, self._document), self._trial.outcome
        for name, tone in _TONES.items():
            places = self._ends[name] + [0.0, 0.0, _LIFT]
            lines, _, depth = segments(places[:, 0], places[:, 1])
            many = len(lines) > _MANY
            painter.setRenderHint(QPainter.RenderHint.Antialiasing, not many)
            for least, most, width in ((8.0, np.inf, far), (0.0, 8.0, 3.6)):
                pen = QPen(QColor(tone), 1.0 if many else width)
                if name == "appear" and not many:
                    pen.setStyle(Qt.PenStyle.DashLine)
                painter.setPen(pen)
                self._primitives.draw_lines(painter, lines[(depth >= least) & (depth < most)])
