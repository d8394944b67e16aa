"""What the views show of the graph: its colors by a property, and one of its storeys."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, QSettings, Qt
from PySide6.QtGui import QColor, QPainter, QPen, QPixmap
from PySide6.QtWidgets import QComboBox

from nvsim.figures import SHAPES
from nvsim.graph.edits import EditError
from nvsim_app.actions import Action
from nvsim_app.look import colors, lengths
from nvsim_app.look.widgets import named
from nvsim_app.painting.graph_ink import LARGE, SMOOTH_LINES, DrawingCache
from nvsim_app.painting.picking import NEAR
from nvsim_app.painting.primitives import Primitives, disc
from nvsim_app.panels.deferred_refresh import DeferredRefresh
from nvsim_app.state.document import Document
from nvsim_app.state.graph_arrays import GraphArrays, column_bounds
from nvsim_app.state.graph_coloring import Coloring, Group, coloring
from nvsim_app.state.reasons import Reason, with_graph, with_occupancy
from nvsim_app.views.graph_surface import GraphSurface
from nvsim_app.views.map_legend import LegendRow
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.part import Part, WindowContext

MOST_ROWS = 9  # of the legend
SETTLE = 80  # milliseconds after the last edit until the legend below the map is updated
_SYMBOL = (28, 12)  # width and height of the symbols of the legend, pixels
_LINES = (
    Qt.PenStyle.SolidLine,
    Qt.PenStyle.DashLine,
    Qt.PenStyle.DotLine,
    Qt.PenStyle.DashDotLine,
    Qt.PenStyle.DashDotDotLine,
)
_WAYS = {
    "": ("One colo&r", "Draw the graph in one color"),
    "storey": ("Color by s&torey", "One color for each storey"),
    "component": ("Color by com&ponent", "One color for each connected component"),
    "degree": ("Color by nei&ghbors", "Number of neighbors of each viewpoint"),
    "evidence": ("Color by &evidence", "Distance of the evidence of each edge from the thresholds"),
    "photographed": ("Color by p&hotographed share", "Share of the directions around each viewpoint that images show"),
    "reviewed": ("Color by re&view", "Reviewed and unreviewed viewpoints and edges"),
    "validity": ("Color by &validity", "Whether viewpoints and edges are over free cells of the occupancy map"),
    "origin_submap": ("Color by subm&ap", "Submap whose model renders each viewpoint"),
}


def _enabled(by: str) -> Callable[[Document], Reason]:
    if by == "validity":
        return lambda document: with_graph(document) or with_occupancy(document)
    return with_graph


class ColoringPart(Part):
    """Colors the graph and draws the legend."""

    ACTIONS = tuple(
        Action("&View", 6, f"color_{by or 'plain'}", text, tip, lambda self, by=by: self._choose(by),
               enabled=_enabled(by), check="off" if by else "on", group="coloring")
        for by, (text, tip) in _WAYS.items()
    )  # fmt: skip

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.by = ""
        self._of: tuple[object, ...] = ()
        self._coloring: Coloring | None = None
        self._rows: tuple[GraphArrays, Coloring, NDArray[np.int64], NDArray[np.int64]] | None = None
        self._primitives = Primitives()
        self._sprites: dict[tuple[str, str], QPixmap] = {}
        self._symbols: dict[tuple[str, int], QPixmap] = {}
        self._kept: dict[GraphSurface, DrawingCache] = {}
        context.modes.beneath.append(self.paint)

    def restore(self, settings: QSettings) -> None:
        document = self.context.document
        self._legend = DeferredRefresh(self.context.part(MapPart).view, self._show_legend, SETTLE)
        for changed in (document.graphChanged, document.contentsChanged, document.storeys.changed):
            changed.connect(self._legend.mark)
        by = str(settings.value("graph_colors", ""))
        if by in _WAYS:
            self.context.window.actions_table[f"color_{by or 'plain'}"].setChecked(True)
            self.by = by
        self._legend.mark()

    def _choose(self, by: str) -> None:
        self.by = by
        self._kept.clear()
        self.context.settings.setValue("graph_colors", by)
        self.context.modes.refresh()
        self._legend.finish()

    @property
    def coloring(self) -> Coloring | None:
        """The current coloring; None for one color. It is computed once for each graph."""
        document = self.context.document
        if not self.by:
            return None
        key = self.by, document.graph, document.contents.occupancy, document.contents.thresholds
        if len(self._of) != len(key) or any(a is not b for a, b in zip(self._of, key, strict=True)):
            self._of = key
            try:
                self._coloring = coloring(document, self.by.removeprefix("origin_"))
            except EditError:
                self._coloring = None  # the coloring needs a map, and the project has none
        return self._coloring

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        found, arrays = self.coloring, self.context.document.shown_arrays
        if found is None or not arrays.ids or not surface.shows_graph:
            return
        if self._rows is None or self._rows[0] is not arrays or self._rows[1] is not found:
            self._rows = arrays, found, *_groups(arrays, found)
        if len(arrays.edges) > LARGE:
            low, high = column_bounds(arrays.feet)
            corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
            # The projections of eight corners identify the camera pose.
            place = tuple(np.column_stack(surface.project(corners)).ravel().tolist()), float(surface.disc_radii().max())
            if surface not in self._kept:
                self._kept[surface] = DrawingCache(surface.widget, surface.widget.update)
            size = surface.widget.size()
            draw = partial(self._draw, surface)
            self._kept[surface].paint(painter, size.width(), size.height(), place, draw, self._rows)
        else:
            self._draw(surface, painter)
        if surface.widget is self.context.scene and not self._legend.in_sight:
            self._paint_legend(painter, found)

    def _draw(self, surface: GraphSurface, painter: QPainter, within: QRectF | None = None) -> None:
        assert self._rows is not None
        arrays, found, viewpoints, edges = self._rows
        ends = arrays.feet[arrays.edges]
        lines, index, _ = surface.segments(ends[:, 0], ends[:, 1])
        pixels, depths = surface.project(arrays.feet)
        radii = surface.disc_radii()
        seen = depths > NEAR
        for number, group in enumerate(found.groups):
            # Dashed lines are slow, and with thousands of lines the dashes cannot be seen.
            painter.setPen(QPen(QColor(group.color), 2.4, _LINES[0] if len(lines) > SMOOTH_LINES else _line(group)))
            self._primitives.draw_lines(painter, lines[edges[index] == number])
        for number, group in enumerate(found.groups):
            rows = np.flatnonzero((viewpoints == number) & seen)
            rows = rows[np.argsort(-depths[rows], kind="stable")]
            self._primitives.draw_sprites(painter, pixels[rows], radii[rows] / 12, self._sprite(group))

    def _sprite(self, group: Group) -> QPixmap:
        key = group.color, SHAPES[group.mark % len(SHAPES)]
        if key not in self._sprites:
            self._sprites[key] = disc(group.color, "#11151a", shape=key[1])
        return self._sprites[key]

    def _paint_legend(self, painter: QPainter, found: Coloring) -> None:
        """Draws the legend at the lower left of the 3D view, if the map does not show it."""
        rows, more = self._legend_rows(found)
        below = [f"and {more} more"] if more else []
        metrics, view = painter.fontMetrics(), painter.viewport()
        step = metrics.height() + 2
        lines = [found.title, *(words for _, words in rows), *below]
        width = max(metrics.horizontalAdvance(line) for line in lines) + 46
        height = step * len(lines) + 10
        box = QRectF(8, view.height() - height - 34, width, height)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(16, 20, 26, 205))
        painter.drawRoundedRect(box, 5, 5)
        painter.setPen(QColor("#f2f5f8"))
        for number, line in enumerate(lines, 1):
            y = box.top() + step * number - 2
            painter.drawText(QPointF(box.left() + (8 if number == 1 else 40), y), line)
            if 1 < number <= len(rows) + 1:
                painter.drawPixmap(QPointF(box.left() + 6, y - 4 - _SYMBOL[1] / 2), rows[number - 2][0])

    def _legend_rows(self, found: Coloring) -> tuple[list[LegendRow], int]:
        """The first groups with items: their symbols, and their words with the number of items. And the number of the
        other groups."""
        groups = [(group, int(count)) for group, count in zip(found.groups, found.counts, strict=True) if count]
        rows: list[LegendRow] = [(self._symbol(g), f"{g.words}  ({count:,})") for g, count in groups[:MOST_ROWS]]
        return rows, len(groups) - len(rows)

    def _symbol(self, group: Group) -> QPixmap:
        """The line and the disc of a group."""
        key = group.color, group.mark
        if key not in self._symbols:
            symbol = QPixmap(2 * _SYMBOL[0], 2 * _SYMBOL[1])
            symbol.setDevicePixelRatio(2.0)
            symbol.fill(Qt.GlobalColor.transparent)
            painter = QPainter(symbol)
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            painter.setPen(QPen(QColor(group.color), 2.4, _line(group)))
            middle = _SYMBOL[1] / 2
            painter.drawLine(QPointF(0, middle), QPointF(_SYMBOL[0], middle))
            places, scales = np.array([[_SYMBOL[0] / 2, middle]]), np.full((1, 2), 5.0 / 12)
            self._primitives.draw_sprites(painter, places, scales, self._sprite(group))
            painter.end()
            self._symbols[key] = symbol
        return self._symbols[key]

    def _show_legend(self) -> None:
        """Updates the legend below the map."""
        found = self.coloring if self.context.document.shown_arrays.ids else None
        legend = self.context.part(MapPart).view.legend
        if found is None:
            legend.show_rows("", [], 0)
        else:
            legend.show_rows(found.title, *self._legend_rows(found))


def _line(group: Group) -> Qt.PenStyle:
    return _LINES[group.mark % len(_LINES)]


def _groups(arrays: GraphArrays, found: Coloring) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The group of each viewpoint (N,) and of each edge (M,), int64; -1 for none."""
    viewpoints = np.array([found.viewpoints.get(id, -1) for id in arrays.ids], np.int64)
    keys = (arrays.edge_key(row) for row in range(len(arrays.edges)))
    edges = np.array([found.edges.get((min(key), max(key)), -1) for key in keys], np.int64)
    return viewpoints, edges


_FAINT, _RADIUS = 0.55, 3.0  # opacity, and ring radius in pixels, of hidden storeys


def with_storeys(document: Document) -> Reason:
    return with_graph(document) or (None if len(document.storeys.found) > 1 else "all viewpoints are on one storey")


class StoreyPart(Part):
    """Shows one storey or all. Clicks, areas, and Select all apply to visible storeys only."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self._storeys = context.document.storeys
        self.choice = named(QComboBox(context.window), "Storey", "Visible storey of the graph (Alt+PgUp, Alt+PgDown)")
        self.choice.activated.connect(self._choose)
        self.choice.hide()
        self._primitives = Primitives()
        self._ring = disc(colors.TRAJECTORY, "#20252b", shape="ring")

    def restore(self, settings: QSettings) -> None:
        plan = self.context.part(MapPart).view
        plan.frame.set_title(self.choice)
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
        arrays = self._storeys.other_storeys(self.context.document.graph_arrays)
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
        self.context.part(MapPart).view.frame.place()
        self.choice.raise_()
        self.context.window.actions_table.refresh()

    ACTIONS = (
        Action("&View", 5, "storey_up", "Storey &above",
               "Show only the next higher storey of the graph, in the map and in 3D",
               lambda self: self._storeys.step(1), "Alt+PgUp", with_storeys),
        Action("&View", 5, "storey_down", "Storey &below", "Show only the next lower storey of the graph",
               lambda self: self._storeys.step(-1), "Alt+PgDown", with_storeys),
        Action("&View", 5, "storey_others", "&Fade other storeys",
               "Draw the other storeys faintly, in addition to the visible one", _fade_others, enabled=with_storeys,
               check="on"),
        Action("&View", 5, "fade_hidden", "Fade items behind &walls",
               "Draw items faintly in 3D if the occupancy map has walls before them", _fade_hidden,
               enabled=lambda document: with_graph(document) or with_occupancy(document), check="on"),
        Action("&View", 5, "storey_all", "All sto&reys", "Show all storeys of the graph",
               lambda self: self._storeys.choose(None), "Alt+Home", with_storeys),
    )  # fmt: skip
