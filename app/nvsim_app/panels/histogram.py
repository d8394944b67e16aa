"""The histogram of a quantity of the graph. Drag the ends of the region to select a range of values."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import compress

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QWidget

from nvsim.graph.edits import EditError
from nvsim.graph.quantities import Kind, QuantityInputs, quantity
from nvsim.graph.selection import GraphSelection
from nvsim_app.look import colors
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.labels import Label
from nvsim_app.look.theme import Plot
from nvsim_app.look.widgets import named, push_button
from nvsim_app.panels.deferred_refresh import DeferredRefresh
from nvsim_app.state.document import Document

QUANTITIES: dict[str, tuple[str, Kind]] = {
    "Degree of viewpoints": ("degree", "viewpoints"),
    "Component of viewpoints": ("component", "viewpoints"),
    "Storey of viewpoints": ("storey", "viewpoints"),
    "Height above the floor": ("height", "viewpoints"),
    "Evidence of viewpoints": ("evidence", "viewpoints"),
    "Validity of viewpoints on the map": ("validity", "viewpoints"),
    "Photographed share of viewpoints": ("photographed", "viewpoints"),
    "Submap of viewpoints": ("submap", "viewpoints"),
    "Reviewed viewpoints": ("reviewed", "viewpoints"),
    "Length of edges": ("length", "edges"),
    "Evidence of edges": ("evidence", "edges"),
    "Slope of edges": ("slope", "edges"),
    "Validity of edges on the map": ("validity", "edges"),
    "Reviewed edges": ("reviewed", "edges"),
}
"""Label -> name and kind of a quantity of nvsim.graph.quantities."""
BARS = 40
SETTLE = 95  # milliseconds


class HistogramPanel(QWidget):
    """The histogram of one quantity of the document's graph."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self._ids: tuple[object, ...] = ()
        self._values = np.zeros(0)
        self._trouble = ""
        self._quiet = False
        self.choice = named(QComboBox(self), "Quantity")
        self.choice.addItems(list(QUANTITIES))
        self.words = Label(self, quiet=True)
        self.plot = Plot("Histogram", self)
        self.bars = pg.BarGraphItem(x=[0.0], height=[0.0], width=1.0, brush=pg.mkBrush(colors.NODE), pen=pg.mkPen(None))
        self.region = pg.LinearRegionItem(brush=pg.mkBrush(255, 209, 102, 50), pen=pg.mkPen(colors.SELECTED, width=2))
        self.region.setZValue(10)
        self.plot.addItem(self.bars)
        self.plot.addItem(self.region)
        self.region.sigRegionChanged.connect(self._show_counts)
        self.region.sigRegionChangeFinished.connect(self.select_range)
        self._none = push_button(
            "Whole range", self, self._open, "Extend the region to all values without selecting anything"
        )
        row = hbox(self.choice, (self.words, 1, Qt.AlignmentFlag.AlignLeft), self._none)
        vbox(row, self.plot, on=self, margins=4, spacing=4)
        self.refresh = DeferredRefresh(self, self._renewal, SETTLE)
        self.refresh.mark()
        self.refresh.refresh_after_edits_of(document)
        self.choice.currentIndexChanged.connect(self.refresh.finish)

    def _renewal(self) -> Iterator[None]:
        name, kind = QUANTITIES[self.choice.currentText()]
        if name == "evidence":
            yield from self._document.evidence.fill()
        self._count(name, kind)
        yield
        self._show()

    def _count(self, name: str, kind: Kind) -> None:
        graph = self._document.graph
        self._ids, self._values, self._trouble = (), np.zeros(0), "this graph has no such values"
        if graph is None:
            return
        known = QuantityInputs(self._document.contents.occupancy, clearness=self._document.evidence.at)
        try:
            ids, found = quantity(graph, name, known, kind)
        except EditError as error:
            self._trouble = str(error)
            return
        values = found.astype(np.float64)
        finite = np.isfinite(values)
        self._ids, self._values = tuple(compress(ids, finite)), values[finite]

    def _show(self) -> None:
        if not len(self._values):
            self.bars.setOpts(x=[0.0], height=[0.0], width=1.0)
            self.words.setText(self._trouble)
            return
        counts, edges = _histogram_of(self._values)
        width = float(edges[1] - edges[0])
        self.bars.setOpts(x=(edges[:-1] + edges[1:]) / 2, height=counts, width=0.9 * width)
        self.plot.setXRange(edges[0], edges[-1], padding=0.04)
        self.plot.setYRange(0, counts.max() * 1.05, padding=0)
        self.region.setBounds((edges[0] - width / 2, edges[-1] + width / 2))
        self._open()

    @property
    def chosen(self) -> tuple[object, ...]:
        """The viewpoint ids or edges whose value is in the region."""
        low, high = self.region.getRegion()
        inside = (self._values >= low) & (self._values <= high)
        return tuple(self._ids[i] for i in np.flatnonzero(inside))

    def select_range(self) -> None:
        """Selects the items in the region. If the region contains all items, clears the selection."""
        if self._quiet:
            return
        found = self.chosen
        if len(found) == len(self._ids):
            found = ()
        edges = frozenset(key for key in found if isinstance(key, tuple))
        ids = frozenset(key for key in found if isinstance(key, str))
        self._document.editing.select(GraphSelection(ids, edges))

    def _open(self) -> None:
        self._quiet = True
        self.region.setRegion(self._bounds())
        self._quiet = False
        self._show_counts()

    def _bounds(self) -> tuple[float, float]:
        _, edges = _histogram_of(self._values)
        return float(edges[0]), float(edges[-1])

    def _show_counts(self) -> None:
        low, high = self.region.getRegion()
        self.words.setText(f"{low:.4g} to {high:.4g}: {len(self.chosen):,} of {len(self._ids):,}")


def _histogram_of(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Counts (N,) and bin edges (N + 1,) of `values` (M,). Few whole numbers get one bar each."""
    if not len(values):
        return np.zeros(1), np.array([0.0, 1.0])
    low, high = float(values.min()), float(values.max())
    if np.array_equal(values, np.round(values)) and high - low <= BARS:
        return np.histogram(values, bins=np.arange(low - 0.5, high + 1.5))
    return np.histogram(values, bins=BARS, range=(low, high if high > low else low + 1e-6))
