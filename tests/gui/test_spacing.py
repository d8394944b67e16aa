"""Margins and spacing are multiples of half of the grid, in every panel and dialog."""

from __future__ import annotations

from PySide6.QtWidgets import QApplication, QBoxLayout, QDialog, QFormLayout, QGridLayout, QLayout, QStatusBar, QWidget

from nvsim_app.look.theme import HALF
from nvsim_app.wiring.window import MainWindow

DIALOGS = ("preferences", "help", "new_project", "models", "job_train", "export_graph", "export_tasks", "about")


def spacings(layout: QLayout) -> set[int]:
    """The spacings of a layout that separate two of its items, pixels."""
    if isinstance(layout, QGridLayout):
        across, down = layout.columnCount() > 1, layout.rowCount() > 1
        return {layout.horizontalSpacing() * across, layout.verticalSpacing() * down}
    if isinstance(layout, QFormLayout):
        return {layout.horizontalSpacing(), layout.verticalSpacing()}
    return {layout.spacing()} if layout.count() > 1 else set()


def off_grid(root: QWidget) -> list[str]:
    """Describes the layouts of a widget and its children that are not on the grid."""
    found = []
    for widget in (root, *root.findChildren(QWidget)):
        if isinstance(widget, QStatusBar) or widget.layout() is None:  # Qt makes the layout of a status bar again
            continue
        own = widget.layout()
        for layout in (own, *own.findChildren(QLayout)):
            if not isinstance(layout, QBoxLayout | QGridLayout | QFormLayout):
                continue
            margins = layout.contentsMargins() if layout is own else None
            values = {margins.left(), margins.top(), margins.right(), margins.bottom()} if margins else set()
            if any(value % HALF for value in values | spacings(layout)):
                chain, up = [], widget
                while up is not None and len(chain) < 4:
                    chain.append(type(up).__name__)
                    up = up.parentWidget()
                found.append(f"{' < '.join(chain)}: margins {sorted(values)}, spacing {sorted(spacings(layout))}")
    return found


def test_every_layout_is_on_the_grid(window: MainWindow) -> None:
    found = {}
    for name in DIALOGS:
        window.actions_table[name].trigger()
        QApplication.processEvents()
    for dialog in window.findChildren(QDialog):
        found[dialog.windowTitle()] = off_grid(dialog)
        dialog.close()
    found["window"] = off_grid(window)
    places = sorted({place for places in found.values() for place in places})
    assert not places, "\n".join(places)
