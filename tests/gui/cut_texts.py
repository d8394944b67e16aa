"""Finds texts in the window that have less room than they need."""

from __future__ import annotations

from collections.abc import Iterator

from PySide6.QtCore import QRect, Qt
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractScrollArea,
    QComboBox,
    QHeaderView,
    QLabel,
    QStyle,
    QStyleOptionComboBox,
    QStyleOptionTab,
    QTabBar,
    QWidget,
)


def shown_part(widget: QWidget, box: QRect) -> QRect:
    """The part of `box` of a widget that its parents do not cut off. Parts that a scroll bar can show are not cut."""
    box = QRect(box)
    while (parent := widget.parentWidget()) is not None and not widget.isWindow():
        box.translate(widget.pos())
        area = parent.parentWidget()
        if isinstance(area, QAbstractScrollArea) and area.viewport() is parent:
            fixed = area.horizontalScrollBarPolicy() == Qt.ScrollBarPolicy.ScrollBarAlwaysOff
            return box & QRect(0, box.y(), parent.width(), box.height()) if fixed else box
        box &= parent.rect()
        widget = parent
    return box


def cut_texts(root: QWidget) -> Iterator[str]:
    """The visible texts of a widget that have less room than they need."""
    for widget in [root, *root.findChildren(QWidget)]:
        if not widget.isVisible():
            continue
        name = type(widget).__name__
        if isinstance(widget, QHeaderView) and widget.orientation() == Qt.Orientation.Horizontal:
            for column in range(widget.count()):
                text = str(widget.model().headerData(column, Qt.Orientation.Horizontal) or "")
                room = widget.sectionSize(column)
                if not widget.isSectionHidden(column) and widget.fontMetrics().horizontalAdvance(text) + 6 > room:
                    yield f"column {text!r}: {room} pixels"
        elif isinstance(widget, QTabBar):
            for tab in range(widget.count()):
                option = QStyleOptionTab()
                widget.initStyleOption(option, tab)
                inner = widget.style().subElementRect(QStyle.SubElement.SE_TabBarTabText, option, widget)
                text = widget.tabText(tab).replace("&", "")
                is_cut = not widget.rect().contains(widget.tabRect(tab).center())
                is_cut |= widget.fontMetrics().horizontalAdvance(text) > inner.width() + 2
                if widget.isTabVisible(tab) and is_cut:
                    yield f"tab {text!r}: {inner.width()} pixels"
        elif isinstance(widget, QLabel) and widget.text():
            wide, box = widget.width() if widget.wordWrap() else widget.sizeHint().width(), widget.rect()
            high = widget.heightForWidth(wide) if widget.wordWrap() else widget.sizeHint().height()
            box = shown_part(widget, box)
            if box.width() < wide or box.height() < high:
                yield f"{name} {widget.text()[:60]!r}: {box.width()} x {box.height()} of {wide} x {high} pixels"
        elif isinstance(widget, QComboBox) and widget.currentText():
            option = QStyleOptionComboBox()
            widget.initStyleOption(option)
            parts = QStyle.ComplexControl.CC_ComboBox, option, QStyle.SubControl.SC_ComboBoxEditField, widget
            box = shown_part(widget, widget.style().subControlRect(*parts))
            if box.width() < widget.fontMetrics().horizontalAdvance(widget.currentText()):
                yield f"{name} {widget.currentText()!r}: {box.width()} pixels"
        elif isinstance(widget, QAbstractButton) and widget.text():
            wide, box = widget.minimumSizeHint().width(), shown_part(widget, widget.rect())
            if box.width() < wide:
                yield f"{name} {widget.text()!r}: {box.width()} of {wide} pixels"
