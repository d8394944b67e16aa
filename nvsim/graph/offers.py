"""How an editor offers an operation on the selection: texts, required selection, and form fields. This module does not
depend on a window; the editor builds menus, keys and forms from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import EdgeKey


@dataclass(frozen=True)
class SelectedElements:
    """The selection: ids in the order of the graph, so that a recorded edit repeats exactly, and keys of edges."""

    viewpoints: Sequence[str]
    edges: Sequence[EdgeKey]


@dataclass(frozen=True)
class SelectionNeeds:
    """How many elements must be selected, and of which kind. `most` None means any number."""

    of: Literal["viewpoints", "edges", "things"]
    least: int = 1
    most: int | None = None

    def reason(self, viewpoints: int, edges: int) -> str | None:
        """Return why the number of selected viewpoints and edges does not fit; None if it fits."""
        if self.of == "things":
            return None if viewpoints or edges else "nothing in the graph is selected"
        count = viewpoints if self.of == "viewpoints" else edges
        if count >= self.least and (self.most is None or count <= self.most):
            return None
        if self.most == self.least:
            wanted = str(self.least)
        else:
            wanted = f"at least {self.least}" if self.most is None else f"{self.least} to {self.most}"
        noun = self.of.removesuffix("s") if self.least == 1 and self.most in (1, None) else self.of
        return f"{wanted} selected {noun} needed, there {'is' if count == 1 else 'are'} {count or 'none'}"


@dataclass(frozen=True)
class NumberField:
    """A number field of a form. `unit` is shown after the number; `decimals` 0 makes it an integer."""

    name: str
    title: str
    default: float
    low: float
    high: float
    unit: str = " m"
    decimals: int = 2
    tip: str = ""


@dataclass(frozen=True)
class ChoiceField:
    """A form field with a few answers: JSON value -> label."""

    name: str
    title: str
    answers: dict[Any, str]
    tip: str = ""


def _ids(chosen: SelectedElements) -> dict[str, Any]:
    return {"ids": list(chosen.viewpoints)}


@dataclass(frozen=True)
class MenuEntry:
    """A menu entry for an operation.

    id         unique id of the command
    text       label of the entry: "&" before its access key, "…" at its end if a form opens first
    tip        tooltip of one line
    section    section of the menu, between separators
    needs      the required selection
    shortcut   keys
    values     arguments with fixed values
    arguments  selection -> the other arguments
    asks       fields of the form that opens first
    about      text above these fields
    selects    selection -> selection after the edit; None selects new viewpoints, or else keeps the selection
    """

    id: str
    text: str
    tip: str
    section: int
    needs: SelectionNeeds
    shortcut: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)
    arguments: Callable[[SelectedElements], dict[str, Any]] = _ids
    asks: tuple[NumberField | ChoiceField, ...] = ()
    about: str = ""
    selects: Callable[[SelectedElements], GraphSelection] | None = None

    @property
    def title(self) -> str:
        """The text without "&" and "…"."""
        return self.text.replace("&", "").removesuffix("…")


def selection_arguments(chosen: SelectedElements) -> dict[str, Any]:
    """Return the arguments of an operation that takes both viewpoints and edges."""
    return {"viewpoints": list(chosen.viewpoints), "edges": [list(key) for key in sorted(chosen.edges)]}
