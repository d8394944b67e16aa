"""The contract that keeps Qt out names every module that says so of itself."""

import ast
import tomllib
from pathlib import Path

import grimp
import networkx

ROOT = Path(__file__).parents[2]
CLAIM = "does not use qt"


def test_every_module_that_does_not_use_qt_is_held_to_it() -> None:
    claims = set()
    for path in (ROOT / "app").rglob("*.py"):
        text = path.read_text()
        if CLAIM not in _flat(text):
            continue  # to read a file is a thousand times cheaper than to parse it
        if CLAIM in _flat(ast.get_docstring(ast.parse(text)) or ""):
            claims.add(".".join(path.relative_to(ROOT / "app").with_suffix("").parts))
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    held = next(set(c["source_modules"]) for c in contracts if c["name"].startswith("Modules that do not use Qt"))
    assert claims == held


def test_no_modules_import_each_other_in_a_circle() -> None:
    """Imports inside functions count as well; those for types alone do not."""
    # What lint-imports looks at, too: a tenth of the time that parsing every file here takes.
    found = grimp.build_graph("nvsim", "app", exclude_type_checking_imports=True, cache_dir=None)
    imports = ((name, other) for name in found.modules for other in found.find_modules_directly_imported_by(name))
    graph = networkx.DiGraph(imports)
    assert graph.has_edge("nvsim.capture.read", "nvsim.capture.formats")
    assert graph.has_edge("nvsim.graph.sight", "nvsim.occupancy.paths")  # inside a function
    assert not graph.has_edge("nvsim_app.wiring.part", "nvsim_app.wiring.window")  # for types alone
    assert [sorted(c) for c in networkx.strongly_connected_components(graph) if len(c) > 1] == []


def _flat(text: str) -> str:
    return " ".join(text.lower().split())
