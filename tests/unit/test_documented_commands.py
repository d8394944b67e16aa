"""The commands and options that pages quote exist: compared with the real parsers, without running a command."""

from __future__ import annotations

import importlib.util
import shlex
from pathlib import Path
from types import ModuleType

import pytest

from nvsim.cli.arguments import parse
from nvsim.cli.options import command_of
from nvsim.errors import InputError

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "resources" / "docs"
TUTORIALS = sorted((DOCS / "tutorials").glob("*.md"))
HOW_TO = sorted((DOCS / "how-to").glob("*.md"))
HELP = sorted((ROOT / "resources" / "nvsim_resources" / "help").glob("*.md"))
BENCHMARKS = sorted((DOCS / "benchmarks").glob("*.md"))
PAGES = [
    *(ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md"),
    *(*sorted(DOCS.glob("*.md")), *HOW_TO, *TUTORIALS, *BENCHMARKS, *HELP),
]


@pytest.fixture(scope="module")
def quoted() -> ModuleType:
    """The module of packaging/site that reads the commands of a page."""
    spec = importlib.util.spec_from_file_location("command_options", ROOT / "packaging" / "site" / "command_options.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_every_command_of_a_tutorial_parses(quoted: ModuleType, page: Path) -> None:
    lines = list(quoted.command_lines(page.read_text()))
    assert len(lines) > 4
    for line in lines:
        words = shlex.split(line, comments=True)
        if words == ["nvsim", "--version"]:
            continue
        verb = quoted.verb_of(words)
        assert verb is not None, line
        try:
            parse(command_of(verb), words[1 + len(verb.split()) :], verb)
        except (InputError, SystemExit) as error:
            pytest.fail(f"{page.name}: `{line}` does not parse: {error}")


@pytest.mark.parametrize(
    ("page", "limit"),
    [(ROOT / "README.md", 700), *((page, 300) for page in HOW_TO)],
    ids=lambda v: getattr(v, "stem", ""),
)
def test_a_page_is_short(page: Path, limit: int) -> None:
    assert len(page.read_text().split()) <= limit


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_quoted_option_exists(quoted: ModuleType, page: Path) -> None:
    assert quoted.wrong_options(page.read_text()) == []


@pytest.mark.parametrize(
    "text",
    [
        "```bash\nnvsim check capture --axis ros\n```",
        "Use `--no-such-option` to see more.",
        "`nvsim map --area 300` needs another command's option.",
        "`nvsim explode house.nvsim` is no command.",
        "```bash\nnvsim run walk.mp4 \\\n    --project house.nvsim --heigth 1.4\n```",
    ],
)
def test_an_invented_option_is_found(quoted: ModuleType, text: str) -> None:
    assert len(quoted.wrong_options(text)) == 1
