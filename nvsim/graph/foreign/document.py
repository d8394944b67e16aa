"""A connectivity file as text: its entries member by member, with the text between them, so that unedited parts are
written as they were read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.foreign.flags import FlagStyle
from nvsim.graph.types import Viewpoint

FLAGS = ("visible", "unobstructed")
KNOWN = ("image_id", "pose", "included", *FLAGS, "height")


@dataclass(frozen=True)
class Member:
    """One member of an entry, as text.

    lead   "{" or "," with the white space after it
    name   the key in quotes, the colon, and the white space around it
    key    the key
    value  its text; for a list of flags in one style, that style: the flags are in the document's matrix
    """

    lead: str
    name: str
    key: str
    value: str | FlagStyle


@dataclass(frozen=True)
class Entry:
    """One viewpoint of the file. `closing` is the text after the last value; `faults` are its problems as (kind, end of
    a sentence)."""

    viewpoint: Viewpoint
    members: tuple[Member, ...]
    closing: str
    faults: tuple[tuple[str, str], ...] = ()

    def text(self, key: str) -> str | FlagStyle | None:
        """Return the value of a member; None if there is none."""
        return next((m.value for m in self.members if m.key == key), None)

    def put(self, key: str, value: str | FlagStyle) -> Entry:
        """Return the entry with another value of a member. A missing member is added at the end."""
        if any(m.key == key for m in self.members):
            members = tuple(replace(m, value=value) if m.key == key else m for m in self.members)
            return replace(self, members=members)
        last = self.members[-1]
        lead = last.lead if "," in last.lead else "," + last.lead[1:]
        name = f'"{key}"' + last.name[last.name.rindex('"') + 1 :]
        return replace(self, members=(*self.members, Member(lead, name, key, value)))


@dataclass(frozen=True, eq=False)
class Document:
    """A connectivity file of n entries.

    opening, closing   text before the first entry and after the last
    between            (n - 1) texts between two entries
    flags              "visible" and "unobstructed" -> (n, n) bool, row i of entry i
    """

    entries: tuple[Entry, ...] = ()
    opening: str = "["
    closing: str = "]"
    between: tuple[str, ...] = ()
    flags: Mapping[str, NDArray[np.bool_]] = field(
        default_factory=lambda: {key: np.zeros((0, 0), np.bool_) for key in FLAGS}
    )

    @cached_property
    def tells_sight(self) -> bool:
        """Whether the visibility lists contain more than edges."""
        return bool((self.flags["visible"] & ~self.flags["unobstructed"]).any())

    def pieces(self) -> Iterator[str]:
        """Yield the text of the file in pieces."""
        yield self.opening
        for i, entry in enumerate(self.entries):
            if i:
                yield self.between[i - 1]
            for member in entry.members:
                value = member.value
                if isinstance(value, FlagStyle):
                    value = value.write(self.flags[member.key][i])
                yield f"{member.lead}{member.name}{value}"
            yield entry.closing
        yield self.closing
