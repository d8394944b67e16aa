"""The window has one type scale and one grid, in app/nvsim_app/look/theme.py."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

APP = Path(__file__).parents[2] / "app" / "nvsim_app"
TYPE = frozenset({"setPointSize", "setPointSizeF", "setPixelSize", "setBold", "setWeight"})
PLACES = frozenset({"setContentsMargins", "setSpacing", "setHorizontalSpacing", "setVerticalSpacing"})
GRID = frozenset({0, 4, 8, 16, 24})


def _calls(names: frozenset[str]) -> Iterator[tuple[str, ast.Call]]:
    for path in sorted(APP.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in names:
                yield f"{path.relative_to(APP)}:{node.lineno}", node


def test_only_the_type_scale_sets_sizes_and_weights() -> None:
    places = [place for place, _ in _calls(TYPE) if not place.startswith("look/theme.py")]
    assert not places
    texts = [str(p) for p in APP.rglob("*.py") if "font-size" in p.read_text(encoding="utf-8")]
    assert not texts


def test_margins_and_spacing_are_on_the_grid() -> None:
    off = [
        f"{place} {arg.value}"
        for place, call in _calls(PLACES)
        for arg in call.args
        if isinstance(arg, ast.Constant) and arg.value not in GRID
    ]
    assert not off
