"""Public docstrings of the library begin with a sentence: no riddle, no half of one."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

LIBRARY = Path(__file__).parents[2] / "nvsim"
RIDDLES = re.compile(
    r"\b(whatever|whoever|whichever|no matter)\b|^\W*(Nothing|Of [a-z ]+)\.", re.IGNORECASE | re.MULTILINE
)


def first_words(text: str) -> Iterator[tuple[int, str]]:
    """The line and the first paragraph of every public docstring."""
    waiting: list[ast.AST] = [ast.parse(text)]
    while waiting:
        node = waiting.pop()
        assert isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        yield getattr(node, "lineno", 1), " ".join((ast.get_docstring(node) or "").split("\n\n")[0].split())
        inner = (n for n in node.body if isinstance(n, ast.ClassDef | ast.FunctionDef))
        waiting += (n for n in inner if not n.name.startswith("_") or n.name == "__init__")


def test_no_public_docstring_begins_with_a_riddle() -> None:
    found = {}
    for path in LIBRARY.rglob("*.py"):
        text = path.read_text()
        for line, words in first_words(text) if RIDDLES.search(text) else ():
            if RIDDLES.search(words):
                found[f"{path.relative_to(LIBRARY)}:{line}"] = words
    assert found == {}
