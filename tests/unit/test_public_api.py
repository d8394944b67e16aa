"""The public interface of nvsim: its names, its page, and the cost of its import."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
import types
from importlib import resources
from pathlib import Path

import pytest

import nvsim

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "resources" / "docs" / "api.md"
HEAVY = ("numpy", "torch", "cv2", "numba", "scipy")


def test_the_page_has_one_line_for_each_public_name() -> None:
    assert sorted(re.findall(r"^\| `(\w+)", PAGE.read_text(), re.MULTILINE)) == sorted(nvsim.__all__)


@pytest.mark.parametrize("name", nvsim.__all__)
def test_a_public_name_is_a_class_or_function_with_a_docstring(name: str) -> None:
    value = getattr(nvsim, name)
    assert isinstance(value, type | types.FunctionType)
    assert value.__doc__


def test_every_method_of_a_public_class_has_a_docstring() -> None:
    classes = {value for name in nvsim.__all__ if isinstance(value := getattr(nvsim, name), type)}
    missing = [
        f"{found.__name__}.{name}"
        for found in classes
        for name, member in vars(found).items()
        if not name.startswith("_") and isinstance(member, types.FunctionType | property | classmethod | staticmethod)
        if not inspect.getdoc(member)
    ]
    assert len(classes) > 10 and missing == []


def test_the_lines_of_the_page_name_the_module_of_each_name() -> None:
    rows = re.findall(r"^\| `(\w+).*\| `([\w.]+)` \|$", PAGE.read_text(), re.MULTILINE)
    assert {name: getattr(nvsim, name).__module__ for name, _ in rows} == dict(rows)


def test_the_arguments_on_the_page_are_those_of_the_functions() -> None:
    signatures = re.findall(r"^\| `(\w+)\(([^`]*)\)`", PAGE.read_text(), re.MULTILINE)
    assert len(signatures) > 20
    for name, arguments in signatures:
        named = [argument.split("=")[0] for argument in arguments.split(", ") if argument != "..."]
        assert set(named) <= set(inspect.signature(getattr(nvsim, name)).parameters), name


def test_type_checkers_see_the_values_that_are_imported() -> None:
    tree = ast.parse(Path(nvsim.__file__).read_text())
    block = next(n for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING")
    seen: dict[str, str] = {}
    for node in block.body:
        if isinstance(node, ast.ImportFrom):
            seen |= {alias.asname or alias.name: f"{node.module}:{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Assign):
            seen[ast.unparse(node.targets[0])] = f"nvsim.project.project:{ast.unparse(node.value)}"
    assert seen == nvsim._PLACES
    assert set(seen) == set(nvsim.__all__)


def test_no_public_name_hides_a_package() -> None:
    """Importing nvsim.render, for example, replaces the attribute `render` of nvsim."""
    assert not {path.stem for path in (ROOT / "nvsim").iterdir()} & set(nvsim.__all__)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'open_projekt'"):
        nvsim.open_projekt  # noqa: B018
    assert set(nvsim.__all__) < set(dir(nvsim))


def test_import_of_nvsim_loads_no_large_library_and_is_fast() -> None:
    program = (
        "import sys, time; before = time.process_time(); import nvsim; took = time.process_time() - before; "
        f"print(took, *[m for m in sys.modules if m.split('.')[0] in {HEAVY} or m.startswith('nvsim.')])"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=True)
    took, *loaded = result.stdout.split()
    assert sorted(loaded) == ["nvsim.kernel_folder", "nvsim.kernel_threads"]
    assert float(took) < 0.1


def test_the_package_is_marked_as_typed() -> None:
    assert (resources.files("nvsim") / "py.typed").is_file()
    assert 'nvsim = ["py.typed"]' in (ROOT / "pyproject.toml").read_text()
