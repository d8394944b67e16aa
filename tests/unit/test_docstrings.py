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


SHAPE = re.compile(r"\(\s*[\w.+*/ -]+(?:,\s*[\w.+*/ -]*)+\)|\bscalar\b|\b\w+ x \w+\b|shape")
ARRAYS = {"NDArray", "ndarray", "Tensor"}
Sources = dict[str, tuple[str, ast.Module, list[ast.AST]]]
"""The text, the syntax tree, and all nodes of every module of the library and the window, by its name."""


def read_sources() -> Sources:
    found = {}
    for folder in (LIBRARY, LIBRARY.parent / "app" / "nvsim_app"):
        for path in sorted(folder.rglob("*.py")):
            text = path.read_text()
            tree = ast.parse(text)
            name = ".".join(path.relative_to(folder.parent).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = (text, tree, list(ast.walk(tree)))
    return found


def words_in(node: ast.AST | None) -> set[str]:
    """The names in an annotation, also in a quoted one."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return set(re.findall(r"\w+", node.value))
    inner = ast.walk(node) if node is not None else ()
    return {n.id if isinstance(n, ast.Name) else n.attr for n in inner if isinstance(n, ast.Name | ast.Attribute)}


def names_of_arrays(sources: Sources) -> dict[str, set[str]]:
    """For each module, the names of array types in it: those of numpy and torch, and aliases such as Float32."""
    names = {module: set(ARRAYS) for module in sources}
    for _ in range(3):  # an alias can be imported from a module that imports it
        for module, (_, tree, nodes) in sources.items():
            for node in nodes:
                if isinstance(node, ast.ImportFrom) and node.module in names:
                    names[module] |= {a.asname or a.name for a in node.names if a.name in names[node.module]}
            for node in tree.body:
                value = node.value if isinstance(node, ast.Assign) and isinstance(node.value, ast.Subscript) else None
                if value is not None and words_in(value.value) & names[module]:
                    assert isinstance(node, ast.Assign)
                    names[module] |= {t.id for t in node.targets if isinstance(t, ast.Name)}
    return names


def comments_of(text: str, node: ast.FunctionDef) -> str:
    """The comments beside the arguments of a kernel."""
    lines = text.split("\n")[node.lineno - 1 : node.body[0].lineno - 1]
    return " ".join(line.partition("  # ")[2] for line in lines)


def makers_of_errors(sources: Sources) -> dict[str, str]:
    """Functions that return an InputError or EditError, so that `raise damaged(path)` raises one."""
    found = {}
    for _, _, nodes in sources.values():
        for node in nodes:
            returned = node.returns if isinstance(node, ast.FunctionDef) else None
            if isinstance(returned, ast.Name) and returned.id in {"InputError", "EditError"}:
                assert isinstance(node, ast.FunctionDef)
                found[node.name] = returned.id
    return found


def public_functions(module: ast.Module) -> Iterator[tuple[ast.FunctionDef, str]]:
    """Public functions and methods with their docstrings. A method without one has that of its base class."""
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
    sources = read_sources()
    arrays, makers = names_of_arrays(sources), makers_of_errors(sources)
    for module, (text, tree, _) in sources.items():
        for node, words in public_functions(tree):
            given = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
            types = [a.annotation for a in given] + [node.returns]
            if any(words_in(t) & arrays[module] for t in types) and not SHAPE.search(words + comments_of(text, node)):
                missing.append(f"{module}:{node.lineno} {node.name}: shapes")
            thrown = [r.exc.func for r in ast.walk(node) if isinstance(r, ast.Raise) and isinstance(r.exc, ast.Call)]
            names = {ast.unparse(e).rpartition(".")[2] for e in thrown}
            errors = {makers.get(name, name) for name in names} & {"InputError", "EditError"}
            missing += [f"{module}:{node.lineno} {node.name}: {e}" for e in sorted(errors) if e not in words]
    assert missing == []
