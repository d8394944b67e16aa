"""The findings about the graph, updated after every edit. Users can zoom to a finding, fix it with one click, or ignore
it permanently with a reason."""

from __future__ import annotations

from collections import Counter
from functools import partial
from operator import attrgetter
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import (
    QCheckBox,
    QHBoxLayout,
    QHeaderView,
    QLineEdit,
    QMenu,
    QPushButton,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from app.look import colors
from app.look.labels import Label
from app.look.plain_text import SENTENCE, caption, plain, tip
from app.look.table import table
from app.look.wrapping import WrappingRow
from app.panels.deferred_refresh import DeferredRefresh
from app.state.document import Document
from nvsim.graph.components import parted_by
from nvsim.graph.findings import SEVERITIES, Finding, Fix
from nvsim.graph.history import counted
from nvsim.graph.selection import GraphSelection

_Index = QModelIndex | QPersistentModelIndex
_ROOT = QModelIndex()
_COLUMNS = ("Severity", "What", "Kind")
_INKS = {"error": "blocked", "warning": "warning", "notice": "quiet"}
_RANK = {severity: rank for rank, severity in enumerate(SEVERITIES)}
SETTLE = 60  # milliseconds


def selection_of(finding: Finding) -> GraphSelection:
    """The edges of a finding, or its viewpoints if it has no edges."""
    return GraphSelection(frozenset() if finding.edges else frozenset(finding.viewpoints), frozenset(finding.edges))


class FindingModel(QAbstractTableModel):
    """One row for each finding that passes the filter, most severe first."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self.rows: list[Finding] = []
        self.severities = frozenset(SEVERITIES)
        self.text = ""
        self.with_ignored = False

    def renew(self) -> None:
        self.beginResetModel()
        editing = self._document.editing
        ignored = {} if editing.graph is None else editing.graph.ignored
        wanted = self.text.casefold()
        self.rows = [
            f
            for f in editing.findings.values()
            if f.severity in self.severities
            and (self.with_ignored or not ignored or not f.ignored_by(ignored))
            and (not wanted or wanted in f"{f.message} {f.kind}".casefold())
        ]
        # Sort by one key after the other: thousands of key pairs would trigger Python's garbage collector.
        self.rows.sort(key=attrgetter("kind"))
        self.rows.sort(key=lambda f: _RANK[f.severity])
        self.endResetModel()

    def rowCount(self, parent: _Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(self.rows)

    def columnCount(self, parent: _Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(_COLUMNS)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if orientation == Qt.Orientation.Horizontal and role == Qt.ItemDataRole.DisplayRole:
            return _COLUMNS[section] if 0 <= section < len(_COLUMNS) else None
        return None

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if not index.isValid() or index.row() >= len(self.rows):
            return None
        finding = self.rows[index.row()]
        graph = self._document.graph
        by = None if graph is None else finding.ignored_by(graph.ignored)
        reason = None if graph is None or by is None else graph.ignored[by]
        if role == Qt.ItemDataRole.ForegroundRole:
            if reason is not None:
                return QColor(colors.text("quiet"))
            return QColor(colors.text(_INKS[finding.severity])) if index.column() == 0 else None
        if role == Qt.ItemDataRole.ToolTipRole:
            fixes = "\n".join(f"Fix: {fix.text}" for fix in finding.fixes)
            ignored = "" if reason is None else f"\nIgnored: {reason}"
            return tip(f"{finding.message}{ignored}\n{fixes}".strip())
        if role == Qt.ItemDataRole.DisplayRole:
            return plain((finding.severity, finding.message, finding.kind)[index.column()], SENTENCE)
        return None


class ValidationPanel(QWidget):
    """The list of findings. activated(GraphSelection): a finding was double-clicked."""

    activated = Signal(object)

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self.model = FindingModel(document, self)
        self.text = QLineEdit(self)
        self.text.setAccessibleName("Filter by words or ids")
        self.text.setPlaceholderText("Filter by words or ids")
        self.text.setClearButtonEnabled(True)
        self.text.textChanged.connect(self._on_filter)
        self.boxes = {severity: QCheckBox(self) for severity in SEVERITIES}
        self.ignored = QCheckBox("ignored", self)
        self.ignored.setToolTip("Show ignored findings too, with the reason")
        top = WrappingRow()
        for box in self.boxes.values():
            box.setChecked(True)
            box.toggled.connect(self._on_filter)
            top.addWidget(box)
        self.ignored.toggled.connect(self._on_filter)
        top.addWidget(self.ignored)
        self.table = table(self.model, self)
        self.table.setAccessibleName("Findings")
        self.table.setWordWrap(False)  # otherwise a line ends at the last whole word
        header = self.table.horizontalHeader()
        header.setStretchLastSection(False)
        header.setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
        header.setSectionResizeMode(1, QHeaderView.ResizeMode.Stretch)
        header.resizeSection(0, 66)
        header.resizeSection(2, 74)
        self.sentence = Label(self)
        self.sentence.setWordWrap(True)
        self.sentence.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.sentence.hide()
        self.table.selectionModel().currentRowChanged.connect(self._on_row)
        self.table.doubleClicked.connect(self._on_double_click)
        self.fix = QToolButton(self)
        self.fix.setText("Fix")
        self.fix.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextOnly)
        self.fix.setPopupMode(QToolButton.ToolButtonPopupMode.MenuButtonPopup)
        self.fix.clicked.connect(self.apply_first_fix)
        self.reason = QLineEdit(self)
        self.reason.setAccessibleName("Reason to ignore it")
        self.reason.setPlaceholderText("Reason to ignore it permanently")
        self.reason.textChanged.connect(self._enable)
        self.reason.returnPressed.connect(self.ignore)
        self.ignore_button = QPushButton("Ignore", self)
        self.ignore_button.clicked.connect(self.ignore)
        bottom = QHBoxLayout()
        bottom.addWidget(self.reason, 1)
        bottom.addWidget(self.ignore_button)
        self.kind_button = QPushButton("Ignore kind", self)
        self.kind_button.clicked.connect(self.ignore_kind)
        bottom.addWidget(self.kind_button)
        self.clean = Label("No problems found.", self)
        self.clean.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.clean.setForegroundRole(self.clean.palette().ColorRole.PlaceholderText)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(4, 4, 4, 4)
        layout.setSpacing(4)
        layout.addLayout(top)
        layout.addWidget(self.text)
        layout.addWidget(self.table, 1)
        layout.addWidget(self.clean, 1)
        layout.addWidget(self.sentence)
        layout.addWidget(self.fix)
        layout.addLayout(bottom)
        self._soon = DeferredRefresh(self, self.renew, SETTLE)
        document.editing.findingsChanged.connect(self._on_findings)
        self.renew()

    def _on_findings(self) -> None:
        self._soon.mark()

    @property
    def current(self) -> Finding | None:
        row = self.table.currentIndex().row()
        return self.model.rows[row] if 0 <= row < len(self.model.rows) else None

    def renew(self) -> None:
        """Updates the list."""
        kept = self.current
        found = list(self._document.editing.findings.values())
        ignored = {} if self._document.graph is None else self._document.graph.ignored
        counts = Counter(f.severity for f in found if not ignored or not f.ignored_by(ignored))
        complete = self._document.editing.checking.complete
        for severity, box in self.boxes.items():
            box.setText(counted(counts[severity], severity) if complete else f"{severity}s")
        self.model.renew()
        self.table.setVisible(bool(self.model.rows))
        self.clean.setVisible(not self.model.rows)
        nothing = "No problems found." if complete else "Checking…"
        self.clean.setText("No finding matches the filter." if found else nothing)
        if kept is not None:
            for row, finding in enumerate(self.model.rows):
                if finding.key == kept.key:
                    self.table.selectionModel().blockSignals(True)
                    self.table.selectRow(row)
                    self.table.selectionModel().blockSignals(False)
                    break
        self._enable()

    def step(self) -> Finding | None:
        """Selects the next finding, or the first after the last one. Returns it; None if the list is empty."""
        self.renew()
        if not self.model.rows:
            return None
        self.table.selectRow((self.table.currentIndex().row() + 1) % len(self.model.rows))
        return self.current

    def apply_first_fix(self) -> None:
        finding = self.current
        if finding is not None and finding.fixes:
            self._apply(finding.fixes[0])

    def ignore(self) -> None:
        """Ignores the current finding permanently. If it is already ignored, shows it again."""
        finding, graph = self.current, self._document.graph
        if finding is None or graph is None:
            return
        by = finding.ignored_by(graph.ignored)
        if by is not None:
            self._document.editing.heed(by)
        elif self.reason.text().strip():
            self._document.editing.ignore_finding(finding, self.reason.text().strip())
            self.reason.clear()

    def ignore_kind(self) -> None:
        """Ignores every finding of the current one's kind in this graph, with the entered reason."""
        finding, reason = self.current, self.reason.text().strip()
        if finding is not None and reason:
            self._document.editing.ignore(finding.kind_key, reason)
            self.reason.clear()

    def _apply(self, fix: Fix) -> None:
        self._document.editing.run(fix.operation, fix.arguments)

    def _parting(self, fixes: tuple[Fix, ...]) -> str:
        """The effect of removing the edge, as a sentence that follows the finding."""
        graph = self._document.graph
        pairs: list[list[str]] = next((fix.arguments["pairs"] for fix in fixes if fix.operation == "remove_edges"), [])
        keys = [(str(a), str(b)) for a, b in pairs]
        if graph is None or len(keys) != 1 or keys[0] not in graph.edges:
            return ""
        lost = parted_by(graph, keys[0])
        return f" Removing it disconnects {counted(lost, 'viewpoint')} from the others." if lost else ""

    def _on_filter(self) -> None:
        self.model.severities = frozenset(s for s, box in self.boxes.items() if box.isChecked())
        self.model.text, self.model.with_ignored = self.text.text().strip(), self.ignored.isChecked()
        self.renew()

    def _on_row(self) -> None:
        finding = self.current
        if finding is not None:
            self._document.editing.select(selection_of(finding))
        self._enable()

    def _on_double_click(self) -> None:
        finding = self.current
        if finding is not None:
            self.activated.emit(selection_of(finding))

    def _enable(self, _: str = "") -> None:
        finding, graph, editing = self.current, self._document.graph, self._document.editing
        fixes = () if finding is None else finding.fixes
        self.sentence.setText("" if finding is None else f"{finding.message}{self._parting(fixes)}")
        self.sentence.setVisible(finding is not None)
        ignored = finding is not None and graph is not None and bool(finding.ignored_by(graph.ignored))
        self.fix.setEnabled(bool(fixes) and editing.writable)
        self.fix.setText(caption(f"Fix: {fixes[0].text}") if fixes else "Fix")
        nothing = "Select a finding" if finding is None else "There is no automatic fix; look at the place"
        self.fix.setToolTip(tip(fixes[0].text if fixes else nothing))
        menu = QMenu(self.fix)
        for fix in fixes:
            menu.addAction(caption(fix.text), partial(self._apply, fix))
        old = self.fix.menu()
        self.fix.setMenu(menu if len(fixes) > 1 else None)  # type: ignore[arg-type]
        if old is not None:
            old.deleteLater()
        self.reason.setEnabled(finding is not None and not ignored and editing.writable)
        self.ignore_button.setText("Show again" if ignored else "Ignore")
        self.ignore_button.setEnabled(
            finding is not None and editing.writable and (ignored or bool(self.reason.text().strip()))
        )
        self.kind_button.setEnabled(self.ignore_button.isEnabled() and not ignored)
        kind = "" if finding is None else f" of the kind “{finding.kind}”"
        self.kind_button.setToolTip(tip(f"Ignore every finding{kind} in this graph, with the entered reason"))
        self.ignore_button.setToolTip(
            "Show it among the findings again"
            if ignored
            else "Enter the reason on the left; the finding stays ignored in this project"
        )
