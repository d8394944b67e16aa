"""The findings about the graph by kind, updated after every edit. Users can zoom to a finding, fix it or all of its
kind with one click, or ignore it permanently with a reason."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from PySide6.QtCore import QAbstractItemModel, QModelIndex, QPersistentModelIndex, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QCheckBox, QLineEdit, QMenu, QScrollArea, QToolButton, QTreeView, QWidget

from nvsim.graph.findings import SEVERITIES, Finding, Fix
from nvsim.graph.paths import count_cut_off
from nvsim.graph.selection import GraphSelection
from nvsim.plain_text import count_text
from nvsim_app.layers.labels import short_ids
from nvsim_app.look import colors
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.labels import Label, WrappedRows, WrappingRow
from nvsim_app.look.plain_text import SENTENCE, caption, plain, tooltip_text
from nvsim_app.look.widgets import named, push_button, tool_button
from nvsim_app.panels.deferred_refresh import DeferredRefresh
from nvsim_app.state.document import Document

_Index = QModelIndex | QPersistentModelIndex
_ROOT = QModelIndex()
_INKS = {"error": "blocked", "warning": "warning", "notice": "quiet"}
_RANK = {severity: rank for rank, severity in enumerate(SEVERITIES)}
_TITLES = {
    "scan": "The name of the scan", "empty": "No included viewpoint", "id": "Identifiers that cannot be saved",
    "isolated": "Viewpoints without an edge", "island": "Groups that cannot be reached",
    "duplicate": "Viewpoints at almost one position", "detour": "Detours", "obstacle": "Viewpoints in obstacles",
    "floor": "Viewpoints off the floor", "panorama": "Viewpoints without a panorama",
    "photographed": "Viewpoints with few photographs", "moved": "Viewpoints away from their images",
    "occupied": "Edges through obstacles", "evidence": "Edges that contradict the evidence",
    "glass": "Edges that may cross glass", "long": "Long edges", "short": "Short edges", "steep": "Steep edges",
    "one_way": "One-way edges", "self": "Entries that list themselves", "length": "Entries of a wrong length",
}  # fmt: skip
"""Kind of findings -> heading of its group."""
_FEW = 100  # findings of a group that is expanded at first
SETTLE = 60  # milliseconds


def selection_of(finding: Finding) -> GraphSelection:
    """The edges of a finding, or its viewpoints if it has no edges."""
    return GraphSelection(frozenset() if finding.edges else frozenset(finding.viewpoints), frozenset(finding.edges))


@dataclass
class FindingGroup:
    """The findings of one kind and severity."""

    kind: str
    severity: str
    findings: list[Finding]

    @property
    def title(self) -> str:
        return _TITLES.get(self.kind, self.kind)


class FindingModel(QAbstractItemModel):
    """The findings that pass the filter, grouped by kind, most severe first.

    The internal id of an index is 0 for a group, and otherwise the row of its group plus 1.
    """

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self.groups: list[FindingGroup] = []
        self.severities = frozenset(SEVERITIES)
        self.text = ""
        self.with_ignored = False

    @property
    def rows(self) -> list[Finding]:
        """The findings in the order in which they are shown."""
        return [finding for group in self.groups for finding in group.findings]

    def renew(self) -> None:
        self.beginResetModel()
        editing = self._document.editing
        ignored = {} if editing.graph is None else editing.graph.ignored
        wanted = self.text.casefold()
        found: dict[tuple[int, str], FindingGroup] = {}
        for f in editing.findings.values():
            if (
                f.severity in self.severities
                and (self.with_ignored or not ignored or not f.ignored_by(ignored))
                and (not wanted or wanted in f"{f.message} {f.kind} {_TITLES.get(f.kind, '')}".casefold())
            ):
                group = found.setdefault((_RANK[f.severity], f.kind), FindingGroup(f.kind, f.severity, []))
                group.findings.append(f)
        self.groups = [found[key] for key in sorted(found)]
        self.endResetModel()

    def index_of(self, key: str) -> QModelIndex:
        """The index of the finding with this key; an invalid one if it is not shown."""
        for row, group in enumerate(self.groups):
            for place, finding in enumerate(group.findings):
                if finding.key == key:
                    return self.createIndex(place, 0, row + 1)
        return QModelIndex()

    def group_at(self, index: _Index) -> FindingGroup | None:
        """The group of an index; None for the root."""
        if not index.isValid():
            return None
        row = index.row() if index.internalId() == 0 else index.internalId() - 1
        return self.groups[row] if row < len(self.groups) else None

    def finding_at(self, index: _Index) -> Finding | None:
        """The finding of an index; None for the root and for a group."""
        group = self.group_at(index)
        inside = group is not None and index.internalId() > 0 and index.row() < len(group.findings)
        return group.findings[index.row()] if group is not None and inside else None

    def index(self, row: int, column: int, parent: _Index = _ROOT) -> QModelIndex:
        if column != 0 or not 0 <= row < self.rowCount(parent):
            return QModelIndex()
        return self.createIndex(row, 0, parent.row() + 1 if parent.isValid() else 0)

    def parent(self, index: _Index) -> QModelIndex:  # type: ignore[override]
        id = index.internalId() if index.isValid() else 0
        return self.createIndex(id - 1, 0, 0) if id else QModelIndex()

    def rowCount(self, parent: _Index = _ROOT) -> int:
        if not parent.isValid():
            return len(self.groups)
        return len(self.groups[parent.row()].findings) if parent.internalId() == 0 else 0

    def columnCount(self, parent: _Index = _ROOT) -> int:
        return 1

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        group, finding = self.group_at(index), self.finding_at(index)
        if group is None:
            return None
        if finding is None:
            if role == Qt.ItemDataRole.ForegroundRole:
                return QColor(colors.text(_INKS[group.severity]))
            return f"{group.title} ({len(group.findings):,})" if role == Qt.ItemDataRole.DisplayRole else None
        graph = self._document.graph
        by = None if graph is None else finding.ignored_by(graph.ignored)
        reason = None if graph is None or by is None else graph.ignored[by]
        if role == Qt.ItemDataRole.ForegroundRole:
            return None if reason is None else QColor(colors.text("quiet"))
        if role == Qt.ItemDataRole.ToolTipRole:
            fixes = "\n".join(f"Fix: {fix.text}" for fix in finding.fixes)
            ignored = "" if reason is None else f"\nIgnored: {reason}"
            return tooltip_text(f"{short_ids(graph, finding.message)}{ignored}\n{fixes}".strip())
        return plain(short_ids(graph, finding.message), SENTENCE) if role == Qt.ItemDataRole.DisplayRole else None


class ValidationPanel(QWidget):
    """The list of findings. activated(GraphSelection): a finding was double-clicked."""

    activated = Signal(object)

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self.model = FindingModel(document, self)
        self.text = QLineEdit(self, placeholderText="Filter by words or ids", clearButtonEnabled=True)
        self.text.setAccessibleName("Filter by words or ids")
        self.text.textChanged.connect(self._on_filter)
        self.boxes = {severity: QCheckBox(self) for severity in SEVERITIES}
        self.ignored = named(QCheckBox("ignored", self), tip="Show ignored findings too, with the reason")
        for box in self.boxes.values():
            box.setChecked(True)
            box.toggled.connect(self._on_filter)
        self.ignored.toggled.connect(self._on_filter)
        top = WrappingRow(*self.boxes.values(), self.ignored)
        self.tree = named(QTreeView(self, headerHidden=True, wordWrap=True, indentation=12), "Findings")
        self.tree.setModel(self.model)
        self.tree.setFrameShape(QTreeView.Shape.NoFrame)
        self.tree.setItemDelegate(WrappedRows(self.tree))
        self.tree.header().sectionResized.connect(self.tree.scheduleDelayedItemsLayout)
        self.tree.collapsed.connect(lambda index: self._on_expanded(index, False))
        self.tree.expanded.connect(lambda index: self._on_expanded(index, True))
        self._expanded: dict[str, bool] = {}  # kind -> whether the user expanded or collapsed it
        self.sentence = Label(self, wordWrap=True, selectable=True)
        self.sentence.hide()
        self.tree.selectionModel().currentChanged.connect(self._on_row)
        self.tree.doubleClicked.connect(self._on_double_click)
        self.fix = tool_button(
            "Fix",
            self,
            self.apply_first_fix,
            toolButtonStyle=Qt.ToolButtonStyle.ToolButtonTextOnly,
            popupMode=QToolButton.ToolButtonPopupMode.MenuButtonPopup,
        )
        self.reason = named(QLineEdit(self, placeholderText="Reason to ignore it"), "Reason to ignore it")
        self.reason.textChanged.connect(self._enable)
        self.reason.returnPressed.connect(self.ignore)
        self.ignore_button = push_button("Ignore", self, self.ignore)
        self.kind_button = push_button("Ignore kind", self, self.ignore_kind)
        bottom = hbox((self.reason, 1), self.ignore_button, self.kind_button)
        self.clean = Label("No problems found.", self, alignment=Qt.AlignmentFlag.AlignCenter, quiet=True)
        lists = ((self.tree, 1), (self.clean, 1))  # one of them is shown
        vbox(top, self.text, *lists, self.sentence, self.fix, bottom, on=self, margins=4, spacing=4)
        self._soon = DeferredRefresh(self, self.renew, SETTLE)
        document.editing.findingsChanged.connect(self._on_findings)
        document.projectLeft.connect(self.text.clear)
        document.contentsChanged.connect(lambda parts: self._on_findings() if "reading" in parts else None)
        self.renew()

    @property
    def _complete(self) -> bool:
        """Whether the findings of the graph are known; not while a file is read that may have a graph."""
        reading = self._document.contents.reading and self._document.graph is None
        return self._document.editing.checking.complete and not reading

    @property
    def pending(self) -> bool:
        """Whether the list does not show all findings of the graph yet."""
        return self._soon.is_outdated or not self._complete

    def _on_findings(self) -> None:
        """Updates the list soon. Until then, a list of another graph, or one out of sight, shows no findings."""
        if not (self._complete and self._soon.in_sight):
            self._show_checking()
        self._soon.mark()

    def _show_checking(self) -> None:
        for severity, box in self.boxes.items():
            box.setText(f"{severity}s")
        self.tree.hide()
        self.clean.setText("Checking…")
        self.clean.show()

    def _on_expanded(self, index: QModelIndex, expanded: bool) -> None:
        group = self.model.group_at(index)
        if group is not None:
            self._expanded[group.kind] = expanded

    @property
    def current(self) -> Finding | None:
        """The selected finding; None if a group or nothing is selected."""
        return self.model.finding_at(self.tree.currentIndex())

    @property
    def group(self) -> FindingGroup | None:
        """The selected group, or the group of the selected finding."""
        return self.model.group_at(self.tree.currentIndex())

    def choose(self, finding: Finding) -> None:
        """Selects a finding."""
        self.tree.setCurrentIndex(self.model.index_of(finding.key))

    def renew(self) -> None:
        """Updates the list."""
        kept, kind = self.current, self.group
        found = list(self._document.editing.findings.values())
        ignored = {} if self._document.graph is None else self._document.graph.ignored
        counts = Counter(f.severity for f in found if not ignored or not f.ignored_by(ignored))
        complete = self._complete
        self.model.renew()
        if complete:
            for severity, box in self.boxes.items():
                box.setText(count_text(counts[severity], severity))
            self.tree.setVisible(bool(self.model.groups))
            self.clean.setVisible(not self.model.groups)
            self.clean.setText(self.reason_for_no_findings)
        else:
            self._show_checking()
        at = QModelIndex() if kept is None else self.model.index_of(kept.key)
        with QSignalBlocker(self.tree):
            for row, group in enumerate(self.model.groups):
                index = self.model.index(row, 0)
                self.tree.setExpanded(index, self._expanded.get(group.kind, len(group.findings) <= _FEW))
                if kept is None and kind is not None and (kind.kind, kind.severity) == (group.kind, group.severity):
                    at = index
        if at.isValid():
            with QSignalBlocker(self.tree.selectionModel()):
                self.tree.setCurrentIndex(at)
        self._enable()

    @property
    def reason_for_no_findings(self) -> str:
        """Why the list is empty."""
        if not self._complete:
            return "Checking…"
        found = self._document.editing.findings.values()
        return "No finding matches the filter." if found else "No problems found."

    def step(self) -> Finding | None:
        """Selects the next finding, or the first after the last one. Returns it; None if the list is empty."""
        self.renew()
        found, current = self.model.rows, self.current
        if not found:
            return None
        keys = [finding.key for finding in found]
        self.choose(found[0 if current is None else (keys.index(current.key) + 1) % len(found)])
        self._scroll_to_fix()
        return self.current

    def _scroll_to_fix(self) -> None:
        """Scrolls a panel that is too low for all of its parts, so that the fix of the selected finding is visible."""
        area: QWidget | None = self.parentWidget()
        while area is not None and not isinstance(area, QScrollArea):
            area = area.parentWidget()
        if area is not None:
            area.ensureWidgetVisible(self.fix)

    def apply_first_fix(self) -> None:
        """Fixes the selected finding, or all findings of the selected group."""
        finding = self.current
        if finding is None:
            self.fix_all(0)
        elif finding.fixes:
            self._apply(finding.fixes[0])

    def fix_all(self, number: int) -> None:
        """Applies the fix with this number to all findings of the selected kind, as one step. Fixes that become
        impossible on the way are skipped."""
        group = self.group
        fixes = [] if group is None else _fixes(group, number)
        if group is not None and fixes:
            text = f"Fix {count_text(len(fixes), 'finding')}: {fixes[0].text[0].lower()}{fixes[0].text[1:]}"
            operations = [(fix.operation, fix.arguments) for fix in fixes]
            self._document.editing.run_all(operations, text, skips=True)

    def ignore(self) -> None:
        """Ignores the current finding permanently. If it is already ignored, shows it again."""
        finding, graph = self.current, self._document.graph
        if finding is None or graph is None:
            return
        by = finding.ignored_by(graph.ignored)
        if by is not None:
            self._document.editing.show_ignored_again(by)
        elif self.reason.text().strip():
            self._document.editing.ignore(finding.key, self.reason.text().strip())
            self.reason.clear()

    def ignore_kind(self) -> None:
        """Ignores every finding of the current one's kind in this graph, with the entered reason."""
        group, reason = self.group, self.reason.text().strip()
        if group is not None and reason:
            self._document.editing.ignore(group.findings[0].kind_key, reason)
            self.reason.clear()

    def _apply(self, fix: Fix) -> None:
        self._document.editing.run(fix.operation, fix.arguments)

    def _removal_effect(self, fixes: tuple[Fix, ...]) -> str:
        """The effect of removing the edge, as a sentence that follows the finding."""
        graph = self._document.graph
        pairs: list[list[str]] = next((fix.arguments["pairs"] for fix in fixes if fix.operation == "remove_edges"), [])
        keys = [(str(a), str(b)) for a, b in pairs]
        if graph is None or len(keys) != 1 or keys[0] not in graph.edges:
            return ""
        lost = count_cut_off(graph, keys[0])
        return f" Removing it disconnects {count_text(lost, 'viewpoint')} from the others." if lost else ""

    def _on_filter(self) -> None:
        self.model.severities = frozenset(s for s, box in self.boxes.items() if box.isChecked())
        self.model.text, self.model.with_ignored = self.text.text().strip(), self.ignored.isChecked()
        self.renew()

    def _on_row(self, _: object = None) -> None:
        """Selects what the selected finding, or all findings of the selected group, are about."""
        finding, group = self.current, self.group
        if group is not None:
            chosen = [selection_of(each) for each in ([finding] if finding is not None else group.findings)]
            viewpoints, edges = (each.viewpoints for each in chosen), (each.edges for each in chosen)
            self._document.editing.select(GraphSelection(frozenset().union(*viewpoints), frozenset().union(*edges)))
        self._enable()

    def _on_double_click(self) -> None:
        finding = self.current
        if finding is not None:
            self.activated.emit(selection_of(finding))

    def _enable(self, _: str = "") -> None:
        finding, graph, editing = self.current, self._document.graph, self._document.editing
        fixes = () if finding is None else finding.fixes
        group = self.group
        effect = self._removal_effect(fixes).strip()
        self.sentence.setText(effect)
        self.sentence.setVisible(bool(effect))
        ignored = finding is not None and graph is not None and bool(finding.ignored_by(graph.ignored))
        alike = [] if group is None else [_fixes(group, number) for number in range(len(group.findings[0].fixes))]
        texts = [(f"Fix all {len(each):,}: {each[0].text}", number) for number, each in enumerate(alike) if each]
        words = f"Fix: {fixes[0].text}" if fixes else texts[0][0] if texts and finding is None else "Fix"
        self.fix.setEnabled(words != "Fix" and editing.writable)
        self.fix.setText(caption(words))
        nothing = "Select a finding" if group is None else "There is no automatic fix; look at the place"
        self.fix.setToolTip(tooltip_text(nothing if words == "Fix" else words))
        self._fill_fixes([
            *((fix.text, partial(self._apply, fix)) for fix in fixes),
            *((text, partial(self.fix_all, number)) for text, number in texts),
        ], len(fixes))  # fmt: skip
        self.reason.setEnabled(group is not None and not ignored and editing.writable)
        self.ignore_button.setText("Show again" if ignored else "Ignore")
        self.ignore_button.setEnabled(
            finding is not None and editing.writable and (ignored or bool(self.reason.text().strip()))
        )
        reason = bool(self.reason.text().strip())
        self.kind_button.setEnabled(group is not None and editing.writable and reason and not ignored)
        kind = "" if group is None else f" of the kind “{group.title}”"
        self.kind_button.setToolTip(tooltip_text(f"Ignore every finding{kind} in this graph, with the entered reason"))
        self.ignore_button.setToolTip(
            "Show it among the findings again"
            if ignored
            else "Enter the reason on the left; the finding stays ignored in this project"
        )

    def _fill_fixes(self, entries: list[tuple[str, Callable[[], None]]], own: int) -> None:
        """Gives the button of fixes a menu if there are several: first the `own` ones of the selected finding."""
        old = self.fix.menu()
        self.fix.setMenu(None)  # type: ignore[arg-type]
        if old is not None:
            old.deleteLater()
        if len(entries) < 2:
            return
        menu = QMenu(self.fix)
        for place, (text, apply) in enumerate(entries):
            if place == own:
                menu.addSeparator()
            menu.addAction(caption(text), apply)
        self.fix.setMenu(menu)


def _fixes(group: FindingGroup, number: int) -> list[Fix]:
    """The fixes with this number of all findings of a group, as far as they do the same."""
    first = group.findings[0].fixes
    if number >= len(first):
        return []
    found = [finding.fixes[number] for finding in group.findings if number < len(finding.fixes)]
    return [fix for fix in found if fix.operation == first[number].operation]
