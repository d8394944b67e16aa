"""Public docstrings begin with a sentence, and state the shapes of arrays and the errors that users see."""

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


ARRAY = re.compile(r"NDArray|ndarray|Tensor")
SHAPE = re.compile(r"\(\s*[\w.+*/ -]+(?:,\s*[\w.+*/ -]*)+\)|\bscalar\b|\b\w+ x \w+\b|shape")


def public_functions(text: str) -> Iterator[tuple[ast.FunctionDef, str]]:
    """Public functions and methods with their docstrings. A method without one has that of its base class."""
    module = ast.parse(text)
    classes = [n for n in module.body if isinstance(n, ast.ClassDef) and not n.name.startswith("_")]
    for body, inherits in [(module.body, False), *((c.body, bool(c.bases)) for c in classes)]:
        for node in body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                own = ast.get_docstring(node) or ""
                overloaded = any(ast.unparse(d) == "overload" for d in node.decorator_list)
                if not overloaded and (own or not inherits):
                    yield node, own


def test_public_docstrings_state_the_shapes_of_arrays_and_the_errors_for_users() -> None:
    missing = []
    for path in sorted([*LIBRARY.rglob("*.py"), *(LIBRARY.parent / "app" / "nvsim_app").rglob("*.py")]):
        text = path.read_text()
        if not ARRAY.search(text) and "raise InputError" not in text and "raise EditError" not in text:
            continue
        for node, words in public_functions(text):
            types = [a.annotation for a in (*node.args.args, *node.args.kwonlyargs)] + [node.returns]
            if ARRAY.search(" ".join(ast.unparse(t) for t in types if t)) and not SHAPE.search(words):
                missing.append(f"{path.name}:{node.lineno} {node.name}: shapes")
            thrown = [r.exc for r in ast.walk(node) if isinstance(r, ast.Raise)]
            errors = {ast.unparse(e.func) for e in thrown if isinstance(e, ast.Call)} & {"InputError", "EditError"}
            missing += [f"{path.name}:{node.lineno} {node.name}: {e}" for e in errors if e not in words]
    assert missing == []
