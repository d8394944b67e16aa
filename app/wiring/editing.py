"""Editing the graph by commands: undo and redo, saving, and what can be done to the selection."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from PySide6.QtCore import QSettings

from app.actions import Action
from app.look.labels import Label
from app.look.plain_text import caption, tip
from app.panels.form import Choice, Form, Number
from app.state import edit_commands
from app.state.graph_reasons import can_redo, can_save, can_undo, edges, viewpoints, with_things
from app.wiring.part import Part, Workspace


def _edit(id: str, text: str, tip: str, section: int, shortcut: str = "", **more: object) -> Action:
    return Action(id, text, tip, "&Edit", section, shortcut, **more)  # type: ignore[arg-type]


class EditPart(Part):
    ACTIONS = (
        Action(
            "save",
            "&Save",
            "Write the graph to the project, or back to its file",
            "&File",
            1,
            "Ctrl+S",
            "save",
            toolbar=True,
            enabled=can_save,
        ),
        _edit("undo", "&Undo", "Take the last step back", 0, "Ctrl+Z", icon="undo", toolbar=True, enabled=can_undo),
        _edit(
            "redo", "&Redo", "Do what was taken back again", 0, "Ctrl+Shift+Z", icon="redo", toolbar=True,
            enabled=can_redo,
        ),
        _edit(
            "remove", "Re&move", "Take the selected viewpoints and edges out of the graph", 1, "Del", icon="remove",
            toolbar=True, enabled=with_things,
        ),
        _edit("exclude", "&Exclude", "Keep the viewpoints in the file but out of navigation", 1, "X",
              enabled=viewpoints(1)),
        _edit("include", "&Include", "Take the viewpoints into navigation again", 1, "Shift+X", enabled=viewpoints(1)),
        _edit("join", "&Join", "An edge between the two viewpoints", 2, "Ctrl+J", enabled=viewpoints(2, 2)),
        _edit("connect_visible", "&Connect visible…",
              "Join all of the viewpoints that see each other within a distance", 2, enabled=viewpoints(2)),
        _edit("split", "S&plit", "A viewpoint in the middle of the edge", 2, enabled=edges(1, 1)),
        _edit("merge", "Mer&ge", "The viewpoints become one, with the edges of all", 2, "Ctrl+M",
              enabled=viewpoints(2)),
        _edit("straighten", "Strai&ghten…", "Put a chain of viewpoints on the line between its ends", 3,
              enabled=viewpoints(3)),
        _edit("align", "&Align to the lattice…", "Put viewpoints where whole steps lead", 3, enabled=viewpoints(1)),
        _edit("copy_to_floor", "Cop&y to another floor…", "The same viewpoints and edges, higher or lower", 3,
              enabled=viewpoints(1)),
        _edit("set_height", "Set &height…", "How high the camera stands above the floor", 3, enabled=viewpoints(1)),
        _edit("reviewed", "Mark as re&viewed", "You looked at it and found it right", 4, "Y", enabled=with_things),
        _edit("unreviewed", "Mark as not reviewed", "It should be looked at again", 4, "Shift+Y", enabled=with_things),
        _edit("lock", "&Lock", "No edit changes or removes it until it is unlocked", 4, enabled=with_things),
        _edit("unlock", "U&nlock", "Edits may change it again", 4, enabled=with_things),
    )  # fmt: skip

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self._editing = workspace.document.editing
        self.form: Form | None = None
        self.looking = Label("read only", workspace.window)
        self.looking.hide()
        self._editing.stepsChanged.connect(self._name_steps)
        self._editing.failed.connect(workspace.notices.error)
        self._editing.told.connect(workspace.notices.info)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {
            "save": self._editing.save,
            "undo": self._editing.undo,
            "redo": self._editing.redo,
            "remove": partial(edit_commands.remove_selection, self._editing),
            "exclude": lambda: self._run("include", included=False),
            "include": lambda: self._run("include", included=True),
            "join": self._join,
            "connect_visible": self._connect_visible,
            "split": lambda: edit_commands.split_edge(self._editing, next(iter(self._editing.selection.edges)), 0.5),
            "merge": lambda: self._run("merge_viewpoints", middle=True),
            "straighten": self._straighten,
            "align": self._align,
            "copy_to_floor": self._copy,
            "set_height": self._set_height,
            "reviewed": lambda: self._mark("mark_reviewed", reviewed=True),
            "unreviewed": lambda: self._mark("mark_reviewed", reviewed=False),
            "lock": lambda: self._mark("lock", locked=True),
            "unlock": lambda: self._mark("lock", locked=False),
        }

    def _name_steps(self) -> None:
        """Undo and Redo say what they would take back or do again."""
        actions, history = self.workspace.window.actions_table, self._editing.history
        back, forth = (None, None) if history is None else (history.undo_text, history.redo_text)
        actions["undo"].setText(f"&Undo {caption(_lower(back))}".rstrip())
        actions["redo"].setText(f"&Redo {caption(_lower(forth))}".rstrip())
        self.workspace.window.setWindowModified(self._editing.dirty)
        self.looking.setToolTip(tip(self._editing.locked))
        self.looking.setVisible(bool(self._editing.locked))

    def restore(self, settings: QSettings) -> None:
        self.workspace.window.statusBar().addPermanentWidget(self.looking)
        self._name_steps()

    def store(self, settings: QSettings) -> None:
        """The window closes: what was edited must not depend on what becomes of the process."""
        self._editing.close()

    # Commands ----------------------------------------------------------------------------------------------------

    def _chosen(self) -> list[str]:
        """The selected viewpoints in the order of the graph, so that a recorded edit repeats exactly."""
        arrays = self.workspace.document.graph_arrays
        return sorted(self._editing.selection.viewpoints, key=lambda id: arrays.index.get(id, -1))

    def _run(self, name: str, **arguments: object) -> None:
        self._editing.run(name, {"ids": self._chosen(), **arguments})

    def _mark(self, name: str, **arguments: object) -> None:
        pairs = [list(key) for key in sorted(self._editing.selection.edges)]
        self._editing.run(name, {"viewpoints": self._chosen(), "edges": pairs, **arguments})

    def _join(self) -> None:
        a, b = self._chosen()
        edit_commands.add_edge(self._editing, a, b)

    def _ask(self, key: str, title: str, words: str, fields: tuple[Number | Choice, ...], name: str,
             ids: str = "ids") -> None:  # fmt: skip
        if self.form is not None:
            self.form.destroyed.disconnect(self._forget)  # it goes later, and must not take the next one's place
            self.form.close()
        workspace = self.workspace
        run = partial(self._run_on, name, ids)
        self.form = Form(key, title, words, fields, run, workspace.settings, workspace.window)
        self.form.destroyed.connect(self._forget)
        self.form.show()

    def _run_on(self, name: str, ids: str, values: dict[str, Any]) -> None:
        self._editing.run(name, {ids: self._chosen(), **values})

    def _forget(self) -> None:
        self.form = None

    def _connect_visible(self) -> None:
        self._ask(
            "connect_visible", "Connect visible",
            "Joins every two of the selected viewpoints that are near enough and see each other: on the map, or "
            "without one by the lists of the file.",
            (Number("distance", "At most apart", 3.0, 0.1, 50.0),
             Number("steep", "At most steep", 45.0, 1.0, 90.0, "°", 0, "Keeps floors apart")),
            "connect_visible", "viewpoints",
        )  # fmt: skip

    def _straighten(self) -> None:
        self._ask(
            "straighten", "Straighten", "Puts the chain of the selected viewpoints on the line between its ends.",
            (Choice("even", "Along the line", {False: "keep the distances as they are", True: "space evenly"}),),
            "straighten",
        )  # fmt: skip

    def _align(self) -> None:
        self._ask(
            "align", "Align to the lattice",
            "Moves the selected viewpoints to where whole steps in one of eight directions lead from what is aligned "
            "already.",
            (Number("spacing", "Step", 2.5, 0.1, 20.0),
             Number("offset", "Turned by", 7.5, -45.0, 45.0, "°", 1)),
            "align_to_lattice",
        )  # fmt: skip

    def _copy(self) -> None:
        self._ask(
            "copy_to_floor", "Copy to another floor", "Makes the selected viewpoints and the edges among them again.",
            (Number("dz", "Higher by", self._storey_height(), -100.0, 100.0),),
            "copy_by",
        )  # fmt: skip

    def _storey_height(self) -> float:
        """Metres from the storey of what is selected to the one above, or else to the one below."""
        document = self.workspace.document
        found, arrays = document.storeys.found, document.graph_arrays
        rows = arrays.viewpoint_rows(self._chosen())
        if len(found) < 2 or not len(rows):
            return 3.0
        here = min(range(len(found)), key=lambda i: abs(found[i].floor - float(np.median(arrays.feet[rows, 2]))))
        other = here + 1 if here + 1 < len(found) else here - 1
        return round(found[other].floor - found[here].floor, 2)

    def _set_height(self) -> None:
        self._ask(
            "set_height", "Set height", "Moves the cameras of the selected viewpoints up or down; their floor stays.",
            (Number("height", "Above the floor", edit_commands.eye_height(self._editing), 0.05, 10.0),),
            "set_height",
        )  # fmt: skip


def _lower(text: str | None) -> str:
    """Within a sentence."""
    return "" if not text else text[0].lower() + text[1:]
