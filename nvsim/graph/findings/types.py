"""A finding: what is wrong, how bad it is, what it concerns, and the edits that would mend it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from nvsim.graph.types import EdgeKey

Severity = Literal["error", "warning", "notice"]
"""error: agents fail, or walk into something. warning: probably wrong. notice: worth a look."""
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
BLOCKS_EXPORT = frozenset({"scan", "id", "empty", "isolated", "one_way", "length"})
"""Kinds that break the programs which read the files, so that an export is refused."""


@dataclass(frozen=True)
class Fix:
    """text        what a button says
    operation   name in the table of operations
    arguments   its arguments, JSON values
    """

    text: str
    operation: str
    arguments: Mapping[str, Any] = field(hash=False)


@dataclass(frozen=True)
class Finding:
    """kind        "scan", "empty", "id", "isolated", "island", "duplicate", "detour", "obstacle", "floor",
                "panorama", "occupied", "evidence", "glass", "long", "short", "steep"; of a foreign file
                "moved", "one_way", "self" and "length"
    severity    one of SEVERITIES
    message     one sentence
    viewpoints  ids concerned
    edges       keys concerned
    fixes       edits that would mend it, the likeliest first
    """

    kind: str
    severity: Severity
    message: str
    viewpoints: tuple[str, ...] = ()
    edges: tuple[EdgeKey, ...] = ()
    fixes: tuple[Fix, ...] = ()

    @property
    def key(self) -> str:
        """A key that stays the same while the finding does, by which ignored findings are remembered."""
        names = self.viewpoints[:1] if self.kind == "island" else self.viewpoints
        return "/".join((self.kind, *names))

    @property
    def kind_key(self) -> str:
        """The key by which all findings of its kind are ignored in a graph."""
        return f"{self.kind}/*"

    def ignored_by(self, ignored: Mapping[str, str]) -> str | None:
        """The key among those of a graph's `ignored` by which it, or its kind, is let be; None where it is not."""
        return next((key for key in (self.key, self.kind_key) if key in ignored), None)
