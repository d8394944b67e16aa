"""One type scale: three sizes and two weights, in every workspace and dialog."""

from __future__ import annotations

from PySide6.QtWidgets import QApplication, QDialog, QWidget

from nvsim_app.look.theme import points
from nvsim_app.state.document import Document
from nvsim_app.wiring.window import MainWindow
from nvsim_app.wiring.workspace_layouts import WORKSPACE_LAYOUTS

DIALOGS = ("preferences", "help", "new_project", "models", "job_train", "export_graph", "export_tasks", "about")


def fonts_of(root: QWidget) -> set[tuple[float, int]]:
    """Points and weight of the fonts of the visible widgets."""
    shown = [w for w in (root, *root.findChildren(QWidget)) if w.isVisible()]
    return {(w.fontInfo().pointSizeF(), w.font().weight().value) for w in shown}


def test_every_visible_widget_uses_one_of_three_sizes_and_two_weights(window: MainWindow, document: Document) -> None:
    found: dict[str, set[tuple[float, int]]] = {}
    for layout in WORKSPACE_LAYOUTS:
        window.actions_table[f"workspace_{layout.id}"].trigger()
        document.select(viewpoint=document.graph_arrays.ids[0])
        for dock in window.docks.values():
            dock.raise_()
            QApplication.processEvents()
            found[f"{layout.id}: {dock.windowTitle()}"] = fonts_of(window)
    for name in DIALOGS:
        window.actions_table[name].trigger()
        QApplication.processEvents()
    for dialog in window.findChildren(QDialog):
        found[dialog.windowTitle()] = fonts_of(dialog)
        dialog.close()
    sizes, weights = {points("small"), points("text"), points("large")}, {400, 700}
    strange = {name: fonts for name, all in found.items()
               if (fonts := {f for f in all if f[0] not in sizes or f[1] not in weights})}  # fmt: skip
    assert not strange and len(found) > 20
