"""The preview over the 3D view and the map: edges that would appear are green, edges that would disappear are red."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QObject, Qt
from PySide6.QtGui import QColor, QPainter, QPen

from app.layers.layer import Layer
from app.look import colors
from app.painting.picking import projected_segments
from app.painting.primitives import Primitives
from app.state.document import Document
from app.thresholds.threshold_preview import ThresholdPreview
from nvsim.geometry.camera import Camera

_MANY = 800  # lines in view; more wide lines would make the slider stutter
_LIFT = 0.02  # meters above the existing edges


def ends(trial: ThresholdPreview, document: Document) -> dict[str, NDArray[np.float64]]:
    """The segments that would "appear" and "disappear", each (M, 2, 3) world positions on the floor in meters."""
    outcome, redecider = trial.outcome, trial.redecider
    nothing = np.zeros((0, 2, 3))
    if outcome is None or redecider is None:
        return {"appear": nothing, "disappear": nothing}
    arrays = document.graph_arrays
    rows = np.array([arrays.index.get(id, -1) for id in redecider.ids], np.int64)
    result = {}
    for name, pairs in (("appear", outcome.appear), ("disappear", outcome.disappear)):
        known = rows[pairs]
        result[name] = arrays.feet[known[(known >= 0).all(axis=1)]] if len(pairs) else nothing
    return result


_TONES = {"disappear": colors.BLOCKED, "appear": "#5dff9b"}


class PreviewLayer(Layer):
    """The preview in the 3D view."""

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
        if not self._trial.outcome:
            return
        if self._of is not self._trial.outcome:
            self._ends, self._of = ends(self._trial, self._document), self._trial.outcome
        for name, tone in _TONES.items():
            places = self._ends[name] + [0.0, 0.0, _LIFT]
            lines, _, depth = projected_segments(camera, places[:, 0], places[:, 1])
            many = len(lines) > _MANY
            painter.setRenderHint(QPainter.RenderHint.Antialiasing, not many)
            for near, far, width in ((8.0, np.inf, 2.0), (0.0, 8.0, 3.6)):
                pen = QPen(QColor(tone), 1.0 if many else width)
                if name == "appear" and not many:
                    pen.setStyle(Qt.PenStyle.DashLine)
                painter.setPen(pen)
                self._primitives.draw_lines(painter, lines[(depth >= near) & (depth < far)])


class PreviewMarks(QObject):
    """The preview on the map."""

    def __init__(self, plot: pg.PlotWidget, trial: ThresholdPreview, document: Document, parent: QObject) -> None:
        super().__init__(parent)
        self._trial, self._document = trial, document
        self._items = {}
        for name, tone in _TONES.items():
            item = pg.PlotCurveItem(connect="pairs", pen=pg.mkPen(tone, width=2.6))
            item.setZValue(26)
            item.setAcceptedMouseButtons(Qt.MouseButton.NoButton)
            plot.addItem(item, ignoreBounds=True)
            self._items[name] = item
        self._of: object = None
        trial.decided.connect(self.refresh)

    def refresh(self) -> None:
        if self._of is self._trial.outcome:
            return
        self._of = self._trial.outcome
        for name, places in ends(self._trial, self._document).items():
            flat = places.reshape(-1, 3)
            few = len(places) <= _MANY
            style = Qt.PenStyle.DashLine if name == "appear" and few else Qt.PenStyle.SolidLine
            self._items[name].setPen(pg.mkPen(_TONES[name], width=2.6 if few else 1.0, style=style))
            self._items[name].setData(flat[:, 0], flat[:, 1])
