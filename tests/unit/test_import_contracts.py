"""The contract that keeps Qt out names every module that says so of itself."""

import ast
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

import networkx

ROOT = Path(__file__).parents[2]
CLAIM = "knows no qt"


def test_every_module_that_says_it_knows_no_qt_is_held_to_it() -> None:
    claims = set()
    for path in (ROOT / "app").rglob("*.py"):
        docstring = ast.get_docstring(ast.parse(path.read_text())) or ""
        if CLAIM in " ".join(docstring.lower().split()):
            claims.add(".".join(path.relative_to(ROOT).with_suffix("").parts))
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    held = next(set(c["source_modules"]) for c in contracts if c["name"].startswith("What says that it knows no Qt"))
    assert claims == held


def test_no_modules_import_each_other_in_a_circle() -> None:
    """Imports inside functions count as well; those for types alone do not."""
    files = {_name(path): path for room in ("nvsim", "app") for path in (ROOT / room).rglob("*.py")}
    graph = networkx.DiGraph()
    for name, path in files.items():
        for imported in _imports(ast.parse(path.read_text()), files):
            if imported in files and imported != name:
                graph.add_edge(name, imported)
    assert graph.has_edge("nvsim.capture.read", "nvsim.capture.formats")
    assert [sorted(c) for c in networkx.strongly_connected_components(graph) if len(c) > 1] == []


def _name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def _imports(node: ast.AST, modules: Mapping[str, Path]) -> Iterator[str]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            continue
        if isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        elif isinstance(child, ast.ImportFrom) and child.module:
            for alias in child.names:
                whole = f"{child.module}.{alias.name}"
                yield whole if whole in modules else child.module
        yield from _imports(child, modules)
