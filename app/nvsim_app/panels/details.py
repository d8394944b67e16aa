"""The details of the selection: its position, and for a viewpoint the reason why each direction is open or blocked."""

from __future__ import annotations

import math

from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QComboBox, QFrame, QGridLayout, QScrollArea, QSizePolicy, QWidget

from nvsim.capture.findings import SCALE_ASSUMED, SCALE_IN_HEIGHTS
from nvsim.reconstruction.report import rows
from nvsim_app.layers.labels import short_id, short_ids
from nvsim_app.look import colors, lengths
from nvsim_app.look.boxes import STRETCH, vbox
from nvsim_app.look.labels import Label, MarkedLabel, Value
from nvsim_app.look.plain_text import escape_html, plain
from nvsim_app.look.theme import type_font
from nvsim_app.panels.submaps import is_training, model_words
from nvsim_app.state.directions import Direction, directions, path_between
from nvsim_app.state.document import Document
from nvsim_app.state.graph_details import (
    edge_details,
    pair_details,
    photographed_of,
    selection_details,
    user_marks,
    verdicts,
)

_LONG = 24  # characters that fit beside their name in a narrow panel


class DirectionRose(QWidget):
    """The corridors of a viewpoint as petals: green if the step is open, red if it is blocked."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._directions: tuple[Direction, ...] = ()
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def show_directions(self, found: tuple[Direction, ...]) -> None:
        self._directions = found
        self.setVisible(bool(found))
        self.update()

    def sizeHint(self) -> QSize:
        return QSize(180, 168)

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.translate(self.width() / 2, self.height() / 2)
        radius = min(self.width(), self.height()) / 2 - 18
        ring = QColor(self.palette().text().color())
        ring.setAlpha(40)
        painter.setPen(QPen(ring, 1))
        for share in (0.5, 1.0):
            painter.drawEllipse(QPointF(0, 0), radius * share, radius * share)
        for direction in self._directions:
            painter.save()
            painter.rotate(math.degrees(direction.evidence.heading))
            color = QColor(colors.OPEN if direction.passable else colors.BLOCKED)
            color.setAlpha(225 if direction.passable else 170)
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(color)
            length = radius * direction.reach
            if direction.lattice:
                painter.drawPie(QRectF(-length, -length, 2 * length, 2 * length), 16 * 75, 16 * 30)
            else:
                painter.drawRect(QRectF(-1.5, -length, 3, length))
            painter.restore()
        painter.setPen(self.palette().placeholderText().color())
        for text, x, y in (("N", 0, -1), ("E", 1, 0), ("S", 0, 1), ("W", -1, 0)):
            box = QRectF(x * (radius + 9) - 10, y * (radius + 9) - 9, 20, 18)
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, text)


class DetailsPanel(QScrollArea):
    """The details of the selection; without a selection, the report about the poses of a video.

    pieceWanted(int): the user selected another piece of the video.
    """

    pieceWanted = Signal(int)

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        content = QWidget(self)
        self.title = Label(content, font=type_font("large", bold=True), selectable=True)
        self.title.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self._facts = QGridLayout()
        self._facts.setColumnStretch(1, 1)
        self._facts.setHorizontalSpacing(16)
        self.rose = DirectionRose(content)
        self.words = MarkedLabel(content)
        self.words.setWordWrap(True)
        self.words.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.pieces = QComboBox(content)
        self.pieces.setAccessibleName("Piece of the video")
        self.pieces.setToolTip("Import another piece of the video; each has its own unit")
        self.pieces.activated.connect(lambda row: self.pieceWanted.emit(row))
        vbox(self.title, self.pieces, self._facts, self.rose, self.words, STRETCH, on=content, margins=8, spacing=8)
        self.setWidget(content)
        document.selectionChanged.connect(self.refresh)
        document.graphChanged.connect(self.refresh)
        document.unitsChanged.connect(self.refresh)
        document.contentsChanged.connect(self._on_contents)
        self.refresh()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if parts & {"graph", "capture", "submaps", "occupancy", "growing", "poses"}:
            self.refresh()

    def changeEvent(self, event: QEvent) -> None:
        """Rewrites the details in the colors of the new theme."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "words"):
            self.refresh()

    def refresh(self, _: object = None) -> None:
        selection, contents = self._document.selection, self._document.contents
        viewpoint = self._document.selected_viewpoint
        graph, chosen = self._document.graph, self._document.editing.selection
        if viewpoint is not None and graph is not None:
            found = directions(graph, self._document.graph_arrays, viewpoint.id, contents.thresholds)
            neighbors = graph.neighbors(viewpoint.id)
            x, y, z = viewpoint.position
            self._show(
                f"Viewpoint {short_id(graph, viewpoint.id)}",
                {
                    "Position": lengths.position_text(x, y, z),
                    "Above the floor": lengths.length(viewpoint.height),
                    "Neighbors": str(len(neighbors)),
                    "Submap": str(viewpoint.submap) if viewpoint.submap >= 0 else "none",
                    "Origin": _ORIGINS.get(viewpoint.origin, viewpoint.origin),
                    **photographed_of(viewpoint),
                    **user_marks(viewpoint),
                    "Identifier": viewpoint.id,
                },
                found,
            )
        elif graph is not None and len(chosen.edges) == 1 and not chosen.viewpoints:
            (key,) = chosen.edges
            title = f"Edge {short_id(graph, key[0])} – {short_id(graph, key[1])}"
            self._show(title, edge_details(graph, key, contents.thresholds), ())
        elif graph is not None and len(chosen.viewpoints) == 2 and not chosen.edges:
            self._show_pair(*sorted(chosen.viewpoints))
        elif graph is not None and chosen:
            self._show(*selection_details(graph, chosen), ())
        elif selection.frame is not None and contents.capture is not None:
            frame = contents.capture.frames[selection.frame]
            x, y, z = frame.camera_to_world[:3, 3]
            owner = int(self._document.trajectory.submaps[selection.frame])
            self._show(
                frame.name,
                {
                    "Frame": f"{selection.frame + 1} of {len(contents.capture.frames)}",
                    "Position": lengths.position_text(x, y, z),
                    "Image": f"{frame.lens.width}×{frame.lens.height}, {frame.lens.model}",
                    "Submap": str(owner) if owner >= 0 else "none",
                    "Sensor": frame.sensor,
                },
                (),
            )
        elif selection.submap is not None:
            submap = next(s for s in contents.submaps if s.index == selection.submap)
            info = contents.model_info.get(submap.index)
            facts = {"Frames": str(len(submap.core)), "Shared frames": str(len(submap.frames) - len(submap.core))}
            facts["Model"] = model_words(contents, submap.index, is_training(self._document))
            facts |= {_plain(k): _figure(v) for k, v in (info or {}).items() if isinstance(v, str | int | float)}
            self._show(f"Submap {submap.index}", facts, ())
            if info is None:
                self.words.setText("Not trained yet.")
        else:
            report, growing = contents.poses, contents.growing
            title = "" if report is None else "Computed poses"
            facts = {} if report is None else rows(report)
            if report is not None and contents.capture is not None and not contents.capture.alignment.scale_known:
                assumed = f"{SCALE_ASSUMED.removeprefix('the scale is ')}; {SCALE_IN_HEIGHTS}"
                facts = {"Scale": assumed} | facts
            if growing is not None and contents.capture is None:
                title = "Poses so far"
                facts["Frames with a pose"] = f"{len(growing.positions):,}"
                facts["Pieces"] = f"{len(set(growing.submaps.tolist()))}, each in its own color and unit"
            if report is not None and not report.usable and contents.capture is None:
                facts = {"Result": report.refusal} | facts
            self._show(title, facts, ())
            self._show_pieces()
            self.words.setText("Select a viewpoint, an edge, a frame, or a submap to see its details.")

    def _show_pieces(self) -> None:
        """Offers the pieces of the video if there are several, or if one must be chosen."""
        report, capture = self._document.contents.poses, self._document.contents.capture
        if report is None or report.models < (2 if report.usable else 1):
            return
        used = -1
        if capture is not None:
            names = {frame.name for frame in capture.frames}
            used = next((k for k, members in enumerate(report.members) if names & set(members)), -1)
        self.pieces.clear()
        for number, frames in enumerate(report.pieces[: report.models]):
            words = " (in use)" if number == used else ""
            self.pieces.addItem(f"Piece {number}: {frames:,} frames{words}")
        self.pieces.setCurrentIndex(used)
        self.pieces.setPlaceholderText("Choose a piece to import…")
        self.pieces.show()

    def _show_pair(self, a: str, b: str) -> None:
        """Explains why two viewpoints have an edge or not."""
        graph, found = self._document.graph, path_between(self._document, a, b)
        if found is None:
            return
        self._show(f"Between {short_id(graph, a)} and {short_id(graph, b)}", pair_details(graph, found), ())
        names = (escape_html(short_id(graph, id)) for id in (a, b))
        heads = "".join(f"<td align='right' style='padding:2px 8px'>from {name}</td>" for name in names)
        rows = "".join(
            f"<tr><td style='padding:2px 8px 2px 0'>{escape_html(name)}</td>{''.join(map(_verdict, cells))}</tr>"
            for name, cells in verdicts(found)
        )
        criteria = f"<table><tr><td></td>{heads}</tr>{rows}</table>" if rows else ""
        joins = "" if found.joined else "<br>Ctrl+J connects them."
        self.words.setText(f"<b>{escape_html(short_ids(graph, found.sentence))}</b><br>{criteria}{joins}")

    def _show(self, title: str, facts: dict[str, str], found: tuple[Direction, ...]) -> None:
        self.title.setText(plain(title))
        self.title.setVisible(bool(title))
        self.pieces.hide()
        while (item := self._facts.takeAt(0)) is not None:
            if (widget := item.widget()) is not None:
                widget.hide()
                widget.deleteLater()
        for row, (name, value) in enumerate(facts.items()):
            label, text = Label(plain(name)), _shown(value)
            label.setForegroundRole(label.palette().ColorRole.PlaceholderText)
            text.setAccessibleName(plain(name))
            self._facts.addWidget(label, row, 0)
            self._facts.addWidget(text, row, 1)
        self.rose.show_directions(found)
        inks = {True: colors.text("open"), False: colors.text("blocked")}
        rows = (
            f'<tr><td style="padding:2px 10px 2px 0; color:{inks[f.passable]}">'
            f"{escape_html(f.place)}</td><td style='padding:2px 0'>{escape_html(f.sentence)}</td></tr>"
            for f in found
        )
        self.words.setText(f"<table>{''.join(rows)}</table>" if found else "")


_ORIGINS = {
    "start": "the start of the search",
    "step": "a step of the search",
    "person": "a user",
    "file": "an imported file",
}


def _verdict(cell: tuple[str, bool | None]) -> str:
    words, passes = cell
    if passes is None:
        return f"<td align='right' style='padding:2px 8px'>{escape_html(words)}</td>"
    ink, sign = (colors.text("open"), "✓") if passes else (colors.text("blocked"), "✗")
    return f"<td align='right' style='padding:2px 8px; color:{ink}'>{escape_html(words)} {sign}</td>"


def _shown(value: str) -> QWidget:
    """A line for text without spaces, which is copied as a whole, or a label that wraps longer text."""
    if len(value) < _LONG or " " not in value:
        return Value(value)
    return Label(plain(value), wordWrap=True, selectable=True)


def _plain(key: str) -> str:
    return key.replace("_", " ").capitalize().replace("psnr", "PSNR").replace("Psnr", "PSNR")


def _figure(value: object) -> str:
    return f"{value:.2f}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else str(value)
