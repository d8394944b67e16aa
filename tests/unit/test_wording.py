"""The window names its own labels, not commands and options of the command line."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from nvsim_app.look.plain_text import escape_html, in_window, tooltip_text

APP = Path(__file__).parents[2] / "app" / "nvsim_app"
PRINTED = ("__main__.py", "look/plain_text.py", "start/main.py")
"""Files with text for a terminal, and the rules of the wording."""
COMMAND = re.compile(r"`nvsim |\bnvsim [a-z]+ |(^|[\s(`])--[a-z]")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("The project has 3 frames -- enough.", "The project has 3 frames -- enough."),
        ("p has no models yet; run `nvsim train --project` first.", "p has no models yet; run “Train” first."),
        ("run `nvsim floors --project p` again", "run “Find the floor” again"),
        ("floor masks (`nvsim floors --provider auto`)", "floor masks (“Find the floor” with “Provider: auto”)"),
        ("replaced, which `nvsim restore` can restore", "replaced, which “Earlier results” can restore"),
        ("name the --out of nvsim export tasks.", "name the “Output” of “Export tasks”."),
        ("--poses refined adjusts them", "“Poses: refined” adjusts them"),
        ("set --camera-height METERS or --scale.", "set “Camera height” or “Scale”."),
        ("give a ground truth with --truth DIR.", "give a ground truth with “Truth”."),
        ("--scanless.steps 1 keeps 3000", "“Steps: 1” keeps 3000"),
        ("or write them anyway with --force.", "or write them anyway by selecting that in the form."),
        ("2: the others have 3; --model 1 to 2 imports another piece",
         "2: the others have 3; the list of pieces imports another one"),
        ("film more slowly, or continue with one piece by --model 0 or --model 1.",
         "film more slowly, or choose one of the pieces."),
        ("build one with `nvsim occupancy build`.",
         "build one with the command “nvsim occupancy build” in a terminal."),
        ("/data/a--b/img--model.jpg", "/data/a--b/img--model.jpg"),
    ],
)  # fmt: skip
def test_commands_and_options_become_labels(text: str, words: str) -> None:
    assert in_window(text) == words


def test_tooltips_and_markup_are_reworded() -> None:
    assert tooltip_text("run `nvsim map` again") == "run “Build the map” again"
    assert escape_html("run `nvsim map` again") == "run “Build the map” again"


def test_the_source_of_the_window_has_no_command_line_words() -> None:
    found = [
        f"{path.relative_to(APP)}:{line}: {text}"
        for path in sorted(APP.rglob("*.py"))
        if str(path.relative_to(APP)) not in PRINTED
        for line, text in _sentences(path)
        if COMMAND.search(text)
    ]
    assert not found, "\n".join(found)


def _sentences(path: Path) -> Iterator[tuple[int, str]]:
    """Line and text of every string with words, except docstrings."""
    tree = ast.parse(path.read_text())
    documents = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        text = node.value if isinstance(node, ast.Constant) and id(node) not in documents else None
        if isinstance(text, str) and " " in text.strip():
            yield node.lineno, text
