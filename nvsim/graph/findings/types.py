"""A finding: a problem, its severity, the affected elements, and the edits that could fix it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from nvsim.graph.types import EdgeKey

Severity = Literal["error", "warning", "notice"]
"""error: agents fail or collide. warning: probably wrong. notice: worth a look."""
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
BLOCKS_EXPORT = frozenset({"scan", "id", "empty", "isolated", "one_way", "length"})
"""Kinds that break the programs which read the files. An export with such a finding is refused."""


@dataclass(frozen=True)
class Fix:
    """An edit that could fix a finding.

    text        label of the button
    operation   name in the table of operations
    arguments   its arguments, JSON values
    """

    text: str
    operation: str
    arguments: Mapping[str, Any] = field(hash=False)


@dataclass(frozen=True)
class Finding:
    """A problem of a graph.

    kind        "scan", "empty", "id", "isolated", "island", "duplicate", "detour", "obstacle", "floor", "panorama",
                "photographed", "occupied", "evidence", "glass", "long", "short", "steep"; for a foreign file also
                "moved", "one_way", "self" and "length"
    severity    one of SEVERITIES
    message     one sentence
    viewpoints  affected ids
    edges       affected keys
    fixes       edits that could fix it, the likeliest first
    """

    kind: str
    severity: Severity
    message: str
    viewpoints: tuple[str, ...] = ()
    edges: tuple[EdgeKey, ...] = ()
    fixes: tuple[Fix, ...] = ()

    @property
    def key(self) -> str:
        """A key that stays equal while the finding exists. Ignored findings are stored by this key."""
        names = self.viewpoints[:1] if self.kind == "island" else self.viewpoints
        return "/".join((self.kind, *names))

    @property
    def kind_key(self) -> str:
        """The key that ignores all findings of this kind in a graph."""
        return f"{self.kind}/*"

    def ignored_by(self, ignored: Mapping[str, str]) -> str | None:
        """Return the key in `ignored` that ignores this finding or its kind; None if there is none."""
        return next((key for key in (self.key, self.kind_key) if key in ignored), None)
