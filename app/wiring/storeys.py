"""Storeys of the graph: a selection box over the map, and commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from PySide6.QtCore import QSettings, Qt
from PySide6.QtGui import QColor, QPainter, QPen
from PySide6.QtWidgets import QComboBox

from app.actions import Action
from app.look import colors, lengths
from app.painting.graph_ink import SMOOTH_LINES
from app.painting.picking import NEAR
from app.painting.primitives import Primitives, disc
from app.state.document import Document
from app.state.reasons import Reason, with_graph, with_occupancy
from app.views.graph_surface import GraphSurface
from app.wiring.panels import MapPart
from app.wiring.part import Part, WindowContext

_EDGE = 8  # pixels from the corner of the map
_FAINT, _RADIUS = 0.55, 3.0  # opacity, and ring radius in pixels, of hidden storeys


def with_storeys(document: Document) -> Reason:
    return with_graph(document) or (None if len(document.storeys.found) > 1 else "all viewpoints are on one storey")


class StoreyPart(Part):
    """Shows one storey or all. Clicks, areas, and Select all apply to visible storeys only."""

    ACTIONS = (
        Action("storey_up", "Storey &above", "Show only the next higher storey of the graph, in the map and in 3D",
               "&View", 5, "Alt+PgUp", enabled=with_storeys),
        Action("storey_down", "Storey &below", "Show only the next lower storey of the graph", "&View", 5, "Alt+PgDown",
               enabled=with_storeys),
        Action("storey_others", "&Fade other storeys", "Draw the other storeys faintly, beside the visible one",
               "&View", 5, check="on", enabled=with_storeys),
        Action("fade_hidden", "Fade items behind &walls",
               "Draw items faintly in 3D if the occupancy map has walls before them", "&View", 5, check="on",
               enabled=lambda document: with_graph(document) or with_occupancy(document)),
        Action("storey_all", "All sto&reys", "Show all storeys of the graph", "&View", 5, "Alt+Home",
               enabled=with_storeys),
    )  # fmt: skip

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self._storeys = context.document.storeys
        self.choice = QComboBox(context.window)
        self.choice.setToolTip("Visible storey of the graph (Alt+PgUp, Alt+PgDown)")
        self.choice.setAccessibleName("Storey")
        self.choice.activated.connect(self._choose)
        self.choice.hide()
        self._primitives = Primitives()
        self._ring = disc(colors.TRAJECTORY, "#20252b", shape="ring")

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {
            "storey_up": lambda: self._storeys.step(1),
            "storey_down": lambda: self._storeys.step(-1),
            "storey_all": lambda: self._storeys.choose(None),
            "storey_others": self._fade_others,
            "fade_hidden": self._fade_hidden,
        }

    def restore(self, settings: QSettings) -> None:
        plan = self.context.part(MapPart).view
        self.choice.setParent(plan)
        self.choice.move(_EDGE, _EDGE)
        self._storeys.changed.connect(self._show)
        self.context.document.unitsChanged.connect(self._show)
        self._storeys.changed.connect(self.context.scene.update)
        self._storeys.changed.connect(plan.graph.update)
        self.context.modes.beneath.insert(0, self.paint)
        table = self.context.window.actions_table
        for id in ("storey_others", "fade_hidden"):
            table[id].setChecked(settings.value(id, "true") in (True, "true"))
        self._show()

    def _fade_others(self, on: bool) -> None:
        self.context.settings.setValue("storey_others", on)
        self._storeys.fade_others(on)

    def _fade_hidden(self, on: bool) -> None:
        self.context.settings.setValue("fade_hidden", on)
        self.context.scene.overlays.graph.fades_hidden = on
        self.context.scene.update()

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        """Draws the other storeys with thin dotted lines and small rings."""
        arrays = self._storeys.others(self.context.document.graph_arrays)
        if not arrays.ids or not surface.shows_graph:
            return
        ends = arrays.feet[arrays.edges]
        lines, _, _ = surface.segments(ends[:, 0], ends[:, 1])
        pixels, depths = surface.project(arrays.feet)
        painter.save()
        painter.setOpacity(_FAINT)
        many = len(lines) > SMOOTH_LINES
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, not many)
        style = Qt.PenStyle.SolidLine if many else Qt.PenStyle.DotLine
        painter.setPen(QPen(QColor(colors.TRAJECTORY), 1.0, style))
        self._primitives.draw_lines(painter, lines)
        seen = np.flatnonzero(depths > NEAR)
        scales = np.full((len(seen), 2), _RADIUS / 12)
        self._primitives.draw_sprites(painter, pixels[seen], scales, self._ring)
        painter.restore()

    def _choose(self, row: int) -> None:
        self._storeys.choose(None if row == 0 else len(self._storeys.found) - row)

    def _show(self) -> None:
        found = self._storeys.found
        self.choice.clear()
        self.choice.addItem("All storeys")
        # As in an elevator, the highest storey is first.
        for number, storey in reversed(list(enumerate(found, 1))):
            self.choice.addItem(f"Storey {number}, {lengths.length(storey.floor, 1)}, {storey.count:,} viewpoints")
        self.choice.setCurrentIndex(0 if self._storeys.chosen is None else len(found) - self._storeys.chosen)
        self.choice.setVisible(len(found) > 1)
        self.choice.adjustSize()
        self.choice.raise_()
        self.context.window.actions_table.refresh()
