"""The page of the Python interface: the names of api.md, with their docstrings (mkdocstrings)."""

from __future__ import annotations

import re
from pathlib import Path

import nvsim

PAGE = Path(__file__).resolve().parents[2] / "resources" / "docs" / "api.md"
MEMBERS = {
    "Project": "graph need_graph set_graph capture need_capture submaps need_submaps scan scene occupancy close",
    "NavGraph": "adjacency neighbors",
    "History": "perform undo redo",
    "Intrinsics": "from_fov",
    "MappingConfig": "paper",
}
"""Methods to describe. Of other classes, the docstring of the class is enough."""


def python_page() -> str:
    """The page in Markdown: the sections of api.md, and below them each name with its docstring."""
    lines = [
        "# Docstrings of the Python interface",
        "",
        "[The Python interface](../api.md) lists these names with one line each and has examples.",
        "",
    ]
    for line in PAGE.read_text().splitlines():
        if line.startswith("## "):
            lines += [line, ""]
        row = re.match(r"\| `(\w+)", line)
        if row:
            name = row[1]
            value = getattr(nvsim, name)
            members = ", ".join(MEMBERS.get(name, "").split())
            lines += [f"::: {value.__module__}.{value.__qualname__}", "    options:"]
            lines += [f"      heading: nvsim.{name}", f"      toc_label: {name}"]
            lines += [f"      members: [{members}]" if members else "      members: false", ""]
    return "\n".join(lines)
