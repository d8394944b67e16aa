"""Commands that edit the graph (undo and redo, saving, operations on the selection), the description of the last edit,
and automatic saving."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from PySide6.QtCore import QSettings, QTimer
from shiboken6 import isValid

from nvsim.graph import operation_table
from nvsim.graph.history import Step
from nvsim.graph.offers import MenuEntry, NumberField, SelectedElements, SelectionNeeds
from nvsim.graph.types import NavGraph
from nvsim_app.actions import Action
from nvsim_app.layers.labels import short_ids
from nvsim_app.look.labels import Label
from nvsim_app.look.plain_text import caption, plain, tooltip_text
from nvsim_app.look.text_undo import TextUndo
from nvsim_app.look.widgets import show_and_focus
from nvsim_app.panels.form import Form
from nvsim_app.state import edit_commands
from nvsim_app.state.reasons import can_redo, can_save, can_undo, with_selection
from nvsim_app.wiring.checking import CheckPart
from nvsim_app.wiring.part import Part, WindowContext


class EditPart(Part):
    """Runs the editing commands."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self._editing = context.document.editing
        self.form: Form | None = None
        self.looking = Label("read-only", context.window)
        self.looking.hide()
        self._editing.stepsChanged.connect(self._name_steps)
        self._editing.failed.connect(self._on_failed)  # methods do not keep the window, functions would
        self._editing.notified.connect(self._on_notified)

    def _on_failed(self, words: str) -> None:
        self.context.notices.error(words, about="save graph")

    def _on_notified(self, words: str) -> None:
        self.context.notices.info(words, about="save graph")

    def _name_steps(self) -> None:
        """Names the steps in Undo and Redo."""
        actions, history = self.context.window.actions_table, self._editing.history
        back, forth = (None, None) if history is None else (history.undo_text, history.redo_text)
        actions["undo"].setText(f"&Undo {caption(_lower(back))}".rstrip())
        actions["redo"].setText(f"&Redo {caption(_lower(forth))}".rstrip())
        for id, step, words in (("undo", back, "Undo"), ("redo", forth, "Redo")):
            tip_of_it = f"{words}: {short_ids(self._editing.graph, _lower(step))} ({actions[id].shortcut().toString()})"
            if step and actions[id].isEnabled():
                actions[id].setToolTip(tooltip_text(tip_of_it))
                actions[id].setStatusTip(plain(tip_of_it))
        self.context.window.setWindowModified(self._editing.dirty)
        self.context.window.show_title()
        self.looking.setToolTip(tooltip_text(self._editing.locked))
        self.looking.setVisible(bool(self._editing.locked))

    def restore(self, settings: QSettings) -> None:
        window, actions = self.context.window, self.context.window.actions_table
        self._text_undo = TextUndo(actions["undo"], actions["redo"], window)
        window.statusBar().addPermanentWidget(self.looking)
        self._name_steps()

    def store(self, settings: QSettings) -> None:
        """Closes the editing, so that edits do not depend on the end of the process."""
        self._editing.close()

    # Commands ----------------------------------------------------------------------------------------------------

    def _chosen(self) -> SelectedElements:
        arrays, chosen = self.context.document.graph_arrays, self._editing.selection
        return SelectedElements(
            sorted(chosen.viewpoints, key=lambda id: arrays.index.get(id, -1)), sorted(chosen.edges)
        )

    def _run_offered_operation(self, name: str, offer: MenuEntry) -> None:
        """Runs an offered operation on the selection, after its form if it has one."""
        if not offer.asks:
            self._run(name, offer, {})
            return
        if self.form is not None and isValid(self.form):
            self.form.close()
        starts: dict[str, Callable[[], float]] = {
            "dz": self._storey_height,
            "height": partial(edit_commands.eye_height, self._editing),
        }
        fields = tuple(
            replace(ask, default=starts[ask.name]()) if isinstance(ask, NumberField) and ask.name in starts else ask
            for ask in offer.asks
        )
        context = self.context
        run = partial(self._run, name, offer)
        self.form = Form(offer.id, offer.title, offer.about, fields, run, context.settings, context.window)
        show_and_focus(self.form)

    def _run(self, name: str, offer: MenuEntry, values: Mapping[str, Any]) -> None:
        chosen = self._chosen()
        after = None if offer.selects is None else offer.selects(chosen)
        self._editing.run(name, {**offer.arguments(chosen), **offer.values, **values}, selection=after)

    def _storey_height(self) -> float:
        """Meters from the storey of the selection to the storey above, or else to the storey below."""
        document = self.context.document
        found, arrays = document.storeys.found, document.graph_arrays
        rows = arrays.viewpoint_rows(list(self._chosen().viewpoints))
        if len(found) < 2 or not len(rows):
            return 3.0
        here = min(range(len(found)), key=lambda i: abs(found[i].floor - float(np.median(arrays.feet[rows, 2]))))
        other = here + 1 if here + 1 < len(found) else here - 1
        return round(found[other].floor - found[here].floor, 2)

    ACTIONS = (
        Action("&File", 1, "save", "&Save", "Write the graph to the project or to its file",
               lambda self: self._editing.save(), "Ctrl+S", can_save, icon="save", toolbar=True),
        Action("&Edit", 0, "undo", "&Undo", "Undo the last step", lambda self: self._editing.undo(), "Ctrl+Z", can_undo,
               icon="undo", toolbar=True),
        Action("&Edit", 0, "redo", "&Redo", "Redo the undone step", lambda self: self._editing.redo(), "Ctrl+Shift+Z",
               can_redo, icon="redo", toolbar=True),
        Action("&Edit", 1, "remove", "&Delete", "Delete the selected viewpoints and edges from the graph",
               lambda self: edit_commands.remove_selection(self._editing), "Del",
               with_selection(SelectionNeeds("things")), icon="remove", toolbar=True),
    )  # fmt: skip

    @classmethod
    def actions(cls) -> tuple[Action, ...]:
        """The commands of this part, and one command for every offer in the table of operations."""
        return cls.ACTIONS + tuple(
            Action("&Edit", o.section, o.id, o.text, o.tip,
                   lambda self, name=operation.name, o=o: self._run_offered_operation(name, o), o.shortcut,
                   with_selection(o.needs))
            for operation in operation_table.OPERATIONS.values()
            for o in operation.offers
        )  # fmt: skip


def _lower(text: str | None) -> str:
    """The text with a lower-case first letter, for use within a sentence."""
    return "" if not text else text[0].lower() + text[1:]


SHOWN = 8000  # milliseconds until the status bar shows the hint of the mode again


class FeedbackPart(Part):
    """Describes edits only, because the views already show the selection."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self._steps: tuple[Step, ...] = ()
        self._index = 0
        self._last_message = ""
        self._over = QTimer(self, singleShot=True, interval=SHOWN)
        self._over.timeout.connect(self._hint)
        context.document.editing.stepsChanged.connect(self._on_steps)
        context.document.projectChanged.connect(self._record_history)
        context.document.editing.notified.connect(self._record_history)

    def _record_history(self, _: object = None) -> None:
        """Records the current history without reporting it."""
        history = self.context.document.editing.history
        self._steps, self._index = ((), 0) if history is None else (history.steps, history.index)

    def _on_steps(self) -> None:
        steps, index = self._steps, self._index
        self._record_history()
        if not self._steps or not steps or self._steps[0] is not steps[0]:
            return  # another graph
        words, graph = "", self.context.document.graph
        undoes, redoes = self._key("undo", "undoes"), self._key("redo", "redoes")
        if index < self._index and self._steps[index + 1 : self._index + 1] == steps[index + 1 : self._index + 1]:
            words = _describe_edits(graph, "Redone", self._steps[index + 1 : self._index + 1], undoes)
        elif index < self._index or (index == self._index and self._steps[index] is not steps[index]):
            words = _describe_edits(graph, "", self._steps[self._index : self._index + 1], undoes)
        elif index > self._index:
            words = _describe_edits(graph, "Undone", steps[self._index + 1 : index + 1], redoes)
        if words and not self.context.part(CheckPart).reviewing:
            self._last_message = words
            self.context.modes.said.emit(words)
            self._over.start()
        elif not words:
            self._hint()  # the key now undoes another step, such as a selection

    def _key(self, id: str, does: str) -> str:
        """For example "Ctrl+Z undoes"; "" if the command has no shortcut."""
        keys = self.context.window.actions_table.keys(id)
        return f" · {keys} {does}" if keys else ""

    def _hint(self) -> None:
        if self.context.window.statusBar().currentMessage() == plain(self._last_message):
            self.context.modes.said.emit(self.context.modes.current.hint)


def _describe_edits(graph: NavGraph | None, what: str, steps: tuple[Step, ...], key: str) -> str:
    """One sentence about the edits among these steps; "" if there are none."""
    edits = [short_ids(graph, step.text) for step in steps if step.edit]
    if not edits:
        return ""
    more = f" and {len(edits) - 1} more" if len(edits) > 1 else ""
    text = f"{what}: {edits[-1][0].lower()}{edits[-1][1:]}" if what else past_tense(edits[-1])
    return f"{text}{more}{key}"


_KEY = "autosave_minutes"


class AutosavePart(Part):
    """Writes the graph for other programs. Edits survive a crash without it, because the journal has them."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.timer = QTimer(self, singleShot=True)
        self.timer.timeout.connect(self._save)
        context.preferences.changed.connect(self._on_preference)
        context.document.editing.stepsChanged.connect(self._start_timer)

    def _on_preference(self, key: str) -> None:
        if key == _KEY:
            self.timer.stop()
            self._start_timer()

    def _start_timer(self) -> None:
        """Starts the timer at the first unsaved edit."""
        minutes = self.context.preferences.number(_KEY)
        if not minutes or can_save(self.context.document) is not None:
            self.timer.stop()
        elif not self.timer.isActive():
            self.timer.start(round(60_000 * minutes))

    def _save(self) -> None:
        if can_save(self.context.document) is None:
            self.context.document.editing.save()


_SAME = frozenset({"set", "split", "put", "cut"})
_IRREGULAR = {"take": "took", "draw": "drew", "make": "made", "undo": "undid", "bring": "brought", "go": "went"}


def past_tense(text: str) -> str:
    """Converts the first verb to the past tense: "Remove 3 viewpoints" becomes "Removed 3 viewpoints"."""
    verb, space, rest = text.partition(" ")
    return f"{_past_tense(verb)}{space}{rest}"


def _past_tense(verb: str) -> str:
    word = verb.lower()
    if word in _SAME or not word.isalpha():
        return verb
    if word in _IRREGULAR:
        made = _IRREGULAR[word]
    elif word.endswith("e"):
        made = f"{word}d"
    elif word.endswith("y") and word[-2] not in "aeiou":
        made = f"{word[:-1]}ied"
    else:
        made = f"{word}ed"
    return made.capitalize() if verb[0].isupper() else made
