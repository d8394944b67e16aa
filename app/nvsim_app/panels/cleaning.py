"""The panel of the mode that cleans a splat: candidates by reason, the selection, and the buttons."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QColor, QIcon, QPixmap
from PySide6.QtWidgets import QCheckBox, QPushButton, QRadioButton, QWidget

from nvsim.scene_import.cleaning import REASONS, Reason
from nvsim_app.drawing.marked_model import COLORS, Mark
from nvsim_app.look.boxes import STRETCH, vbox
from nvsim_app.look.labels import Label, WrappingRow
from nvsim_app.look.widgets import NumberBox, named, push_button
from nvsim_app.state.cleaning import FARTHEST, SplatCleaning

NOTHING = "Edit > Clean splat shows which Gaussians of a splat can be removed."
SEARCHING = "Looking for floaters and for Gaussians outside the building…"
_REASONS: dict[Reason, tuple[str, str]] = {
    "floater": ("Floaters and fog", "Gaussians that most views of the free space see through, also faint glass"),
    "outside": ("Outside", "Gaussians more than 3 m from the floor of the building, seen from above"),
}
_SWATCH = 12  # pixels


class CleanPanel(QWidget):
    """Shows a SplatCleaning and edits it.

    lassoChosen(bool)  the shape of the outline was chosen: lasso or box
    reachChosen(float) the greatest distance of selected Gaussians from the camera, meters
    hideChosen(bool)   whether to hide the Gaussians that will be removed
    applyWanted(), cancelWanted()
    """

    lassoChosen = Signal(bool)
    reachChosen = Signal(float)
    hideChosen = Signal(bool)
    applyWanted = Signal()
    cancelWanted = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._cleaning: SplatCleaning | None = None
        self.words = Label(NOTHING, self, wordWrap=True)
        self.reasons: dict[Reason, QCheckBox] = {reason: self._reason_box(reason) for reason in REASONS}
        self.hide_box = named(QCheckBox("Hide what will be removed", self), tip="Show the splat as it will be")
        self.hide_box.toggled.connect(self.hideChosen)
        self.box = named(QRadioButton("Box", self), tip="A drag selects the Gaussians in a box (B)")
        self.lasso = named(QRadioButton("Lasso", self), tip="A drag selects the Gaussians inside a freehand line (K)")
        self.box.setChecked(True)
        self.lasso.toggled.connect(self.lassoChosen)
        self.reach = NumberBox("Greatest distance", 0.1, FARTHEST, FARTHEST, 1, 0.5, " m", self)
        self.reach.setPrefix("up to ")
        named(self.reach, tip="A drag selects no Gaussians farther than this from the camera, such as a wall behind")
        self.reach.valueChanged.connect(self.reachChosen)
        self.remove = self._button("Remove", "remove_selected", "Remove the selected Gaussians (Del)")
        self.keep = self._button("Keep", "keep_selected", "Keep the selected Gaussians (Shift+Del)")
        self.keep_all = self._button("Keep all", "keep_all", "Remove no Gaussians; then Apply restores all")
        self.apply = push_button("Apply", self, self.applyWanted, "Store what is removed; you can change it later")
        self.cancel = push_button("Cancel", self, self.cancelWanted, "Leave without changes (Esc)")
        rows = (
            WrappingRow(self.box, self.lasso, self.reach),
            WrappingRow(self.remove, self.keep, self.keep_all),
            WrappingRow(self.apply, self.cancel),
        )
        vbox(self.words, *self.reasons.values(), self.hide_box, *rows, STRETCH,
             on=self, margins=8, spacing=8)  # fmt: skip
        self.refresh()

    def _reason_box(self, reason: Reason) -> QCheckBox:
        box = named(QCheckBox(self), tip=f"{_REASONS[reason][1]}. Checked: they are removed")
        box.setIcon(QIcon(_swatch(reason)))
        box.setIconSize(QSize(_SWATCH, _SWATCH))
        box.clicked.connect(lambda on: self._set_reason(reason, on))
        return box

    def _set_reason(self, reason: Reason, on: bool) -> None:
        if self._cleaning is not None:
            self._cleaning.set_reason(reason, on)

    def _button(self, text: str, method: str, tip: str) -> QPushButton:
        return push_button(text, self, lambda: getattr(self._cleaning, method)(), tip)

    def show_cleaning(self, cleaning: SplatCleaning | None, words: str = "") -> None:
        """Shows this cleaning from now on; without one, `words`."""
        self._cleaning = cleaning
        if cleaning is not None:
            cleaning.changed.connect(self.refresh)
        self.refresh(words or NOTHING)

    def show_shape(self, lasso: bool) -> None:
        """Shows whether a drag draws a lasso or a box."""
        (self.lasso if lasso else self.box).setChecked(True)

    def refresh(self, words: str = "") -> None:
        """Shows the current numbers."""
        cleaning = self._cleaning
        for reason, box in self.reasons.items():
            part, total = (0, 0) if cleaning is None else cleaning.count(reason)
            box.setText(f"{_REASONS[reason][0]} ({part:,} of {total:,})")
            box.setTristate(0 < part < total)
            state = Qt.CheckState.PartiallyChecked if 0 < part < total else Qt.CheckState.Checked
            box.setCheckState(state if part else Qt.CheckState.Unchecked)
            box.setEnabled(total > 0)
        chosen = 0 if cleaning is None else int(cleaning.selected.sum())
        if cleaning is not None:
            part, total = int(cleaning.removed.sum()), len(cleaning.removed)
            words = f"{part:,} of {total:,} Gaussians will be removed. {chosen:,} are selected."
        self.words.setText(words)
        for button, usable in (
            (self.remove, chosen > 0),
            (self.keep, chosen > 0),
            (self.keep_all, cleaning is not None and bool(cleaning.removed.any())),
            (self.apply, cleaning is not None and cleaning.edited),
            (self.cancel, words != NOTHING),
        ):
            button.setEnabled(usable)
        for widget in (self.hide_box, self.box, self.lasso, self.reach):
            widget.setEnabled(cleaning is not None)


def _swatch(mark: Mark) -> QPixmap:
    pixmap = QPixmap(_SWATCH, _SWATCH)
    pixmap.fill(QColor(COLORS[mark]))
    return pixmap
