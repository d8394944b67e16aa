"""The contract that keeps Qt out names every module that says so of itself."""

import ast
import tomllib
from pathlib import Path

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
