"""How an operation is offered on what is selected: its words, when it can be done and why not, what it asks for first.
Knows no window; an editor builds menus, keys and forms from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import EdgeKey


@dataclass(frozen=True)
class Chosen:
    """What is selected: ids in the order of the graph, so that a recorded edit repeats exactly, and keys of edges."""

    viewpoints: Sequence[str]
    edges: Sequence[EdgeKey]


@dataclass(frozen=True)
class Needs:
    """How many of what must be selected; `most` None is any number."""

    of: Literal["viewpoints", "edges", "things"]
    least: int = 1
    most: int | None = None

    def reason(self, viewpoints: int, edges: int) -> str | None:
        """Why so many selected viewpoints and edges are not what is needed; None when they are."""
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
class Number:
    """One field of a form. `unit` stands behind the number; `decimals` 0 makes it a whole number."""

    name: str
    title: str
    default: float
    low: float
    high: float
    unit: str = " m"
    decimals: int = 2
    tip: str = ""


@dataclass(frozen=True)
class Choice:
    """One field of a form with a few answers: JSON value -> words."""

    name: str
    title: str
    answers: dict[Any, str]
    tip: str = ""


def _ids(chosen: Chosen) -> dict[str, Any]:
    return {"ids": list(chosen.viewpoints)}


@dataclass(frozen=True)
class Offer:
    """One entry of a menu.

    id         of the command, unique
    text       of the entry; "&" before its letter, "…" at its end where something is asked for first
    tip        one line about it
    section    of the menu, between separators
    needs      what must be selected
    values     arguments that are always the same
    arguments  what is selected -> the other arguments
    asks       fields of the form that comes first, under the words `about`
    selects    what was selected -> what is selected afterwards, where that is neither the same nor what was made
    """

    id: str
    text: str
    tip: str
    section: int
    needs: Needs
    shortcut: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)
    arguments: Callable[[Chosen], dict[str, Any]] = _ids
    asks: tuple[Number | Choice, ...] = ()
    about: str = ""
    selects: Callable[[Chosen], GraphSelection] | None = None

    @property
    def title(self) -> str:
        """The text without its marks."""
        return self.text.replace("&", "").removesuffix("…")


def marked(chosen: Chosen) -> dict[str, Any]:
    """The arguments of an operation that takes viewpoints and edges alike."""
    return {"viewpoints": list(chosen.viewpoints), "edges": [list(key) for key in sorted(chosen.edges)]}
