"""The help of every command: short by default, complete on request, with examples that parse."""

from __future__ import annotations

import ast
import re
import shlex
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
import tyro

from nvsim.cli import options as option_table
from nvsim.cli.arguments import parse
from nvsim.cli.command_table import COMMANDS
from nvsim.cli.commands.run import summary
from nvsim.cli.help_table import COMMON, EXAMPLES, LIMIT, WITHOUT
from nvsim.cli.main import main
from nvsim.cli.options import command_of, options, options_of
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.project.project import Project

VERBS = sorted(COMMANDS)
HELP = {"--help", "--help-all"}


def help_of(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 0
    return capsys.readouterr().out


def shown(text: str) -> set[str]:
    return set(re.findall(r"^  (?:-h, )?(--[a-z][a-z0-9.-]*)", text, re.MULTILINE))


def flags_by_tyro(verb: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """The options in the help that tyro itself writes."""
    monkeypatch.setenv("COLUMNS", "120")
    command = command_of(verb)
    default = {"default": command.defaults([])} if hasattr(command, "defaults") else {}
    with pytest.raises(SystemExit):
        tyro.cli(command, args=["--help"], config=(tyro.conf.FlagCreatePairsOff,), **default)
    return set(re.findall(r"^[│| ] (?:-h, )?(--[a-z][a-z0-9.-]*)", capsys.readouterr().out, re.MULTILINE))


@pytest.mark.parametrize("verb", VERBS)
def test_help_shows_at_most_25_options_and_ends_with_an_example_that_parses(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = help_of(capsys, *verb.split(), "--help")
    assert (15 if verb == "run" else 0) <= len(shown(text) - HELP) <= LIMIT
    head, _, examples = text.rpartition("\nExample")
    assert head.startswith(f"usage: nvsim {verb}")
    lines = [line.strip() for line in examples.splitlines()[1:]]
    assert tuple(lines) == EXAMPLES[verb]
    for line in lines:
        words = shlex.split(line)[1:]
        assert words[: len(verb.split())] == verb.split()
        parse(command_of(verb), words[len(verb.split()) :], verb)


@pytest.mark.parametrize("verb", VERBS)
def test_help_all_contains_every_option_that_the_parser_accepts(
    verb: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    complete = shown(help_of(capsys, *verb.split(), "--help-all"))
    assert complete - {"--help-all"} == flags_by_tyro(verb, capsys, monkeypatch)


@pytest.mark.parametrize("verb", VERBS)
def test_short_commands_show_all_options(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    every = options_of(verb) - HELP
    if len(every) > LIMIT:
        assert verb in COMMON
    else:
        assert verb not in COMMON and shown(help_of(capsys, *verb.split(), "-h")) - HELP == every


@pytest.mark.parametrize(
    ("verb", "words", "path", "value"),
    [
        ("run", ["CAPTURE", "--project", "p", "--train.loss.ssim", "0.3"], "config.train.loss.ssim", 0.3),
        ("run", ["CAPTURE", "--project", "p", "--map.no-settle"], "config.map.settle", False),
        ("map", ["--project", "p", "--panorama-width", "512"], "config.panorama_width", 512),
        ("r2r train", ["--weight-decay", "0.5"], "learning.weight_decay", 0.5),
        ("export tasks", ["--fewest-edges", "3"], "options.bounds.fewest_edges", 3),
    ],
)
def test_an_option_that_help_hides_still_parses(
    verb: str, words: list[str], path: str, value: object, capsys: pytest.CaptureFixture[str]
) -> None:
    flag = next(word for word in reversed(words) if word.startswith("--"))
    assert flag not in shown(help_of(capsys, *verb.split(), "--help"))
    found = parse(command_of(verb), words, verb)
    for name in path.split("."):
        found = getattr(found, name)
    assert found == value


def test_every_no_option_says_what_it_does() -> None:
    found = {o.owner for verb in VERBS for o in options(command_of(verb)) if o.flag and o.default is True}
    assert found == set(WITHOUT)


def test_every_option_and_argument_has_help() -> None:
    missing = {o.owner for verb in VERBS for o in options(command_of(verb)) if not o.help}
    assert not missing


def test_help_shows_the_defaults_of_the_named_preset(capsys: pytest.CaptureFixture[str]) -> None:
    ours, paper = (help_of(capsys, "map", "--project", "p", "--preset", name, "--help") for name in ("nvsim", "paper"))
    rows = [re.findall(r"^  (--(?:no-)?both-ways)", text, re.MULTILINE) for text in (ours, paper)]
    assert rows == [["--no-both-ways"], ["--both-ways"]]


def test_help_of_a_program_after_two_hyphens_belongs_to_the_program() -> None:
    arguments = parse(command_of("r2r python"), ["--", "python", "train.py", "--help"], "r2r python")
    assert arguments.program == ("python", "train.py", "--help")


def row(count: int) -> NavGraph:
    ids = [f"v{i}" for i in range(count)]
    viewpoints = {id: Viewpoint(id, (2.0 * i, 0.0, 1.5)) for i, id in enumerate(ids)}
    return NavGraph("row", viewpoints, {(a, b): edge(a, b) for a, b in zip(ids[:-2], ids[1:-1])})


FIGURES = {
    "nodes": 4,
    "edges": 2,
    "node_validity": 1.0,
    "node_validity_low": 0.51,
    "node_validity_high": 1.0,
    "edge_validity": 0.5,
    "edge_validity_low": 0.0945,
    "edge_validity_high": 0.9055,
    "coverage": 0.25,
    "reachable_m2": 48.0,
}


def test_summary_reports_validity_with_its_interval_and_next_steps(tmp_path: Path) -> None:
    with Project.create_or_open(tmp_path / "my house.nvsim") as project:
        project.set_graph(row(4))
        project.set_result("graph", FIGURES)
        text = "\n".join(summary(project))
    assert re.search(r"Viewpoints +4\n +Edges +2\n", text)
    assert "no: 2 separate parts, the largest with 3 viewpoints" in text
    assert "50.0 % (95 % interval: 9.5 % to 90.5 %)" in text or "50.0 % (95 % interval: 9.4 % to 90.5 %)" in text
    assert "25.0 % of 48 m²" in text and "edge_validity" not in text
    assert f"nvsim app --project '{tmp_path}/my house.nvsim'" in text


def test_summary_does_not_report_the_validity_of_an_older_graph(tmp_path: Path) -> None:
    with Project.create_or_open(tmp_path / "house.nvsim") as project:
        project.set_graph(row(5))
        project.set_result("graph", FIGURES)
        text = "\n".join(summary(project))
    assert "not measured" in text and "nvsim evaluate graph" in text and "interval" not in text


def test_names_separated_by_spaces_get_a_hint_on_commas(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", "capture", "--project", "a.nvsim", "--leave-out", "A", "B"]) == 2
    assert "--leave-out takes 1 value, and B is one more; separate several by commas: A,B." in capsys.readouterr().err


def test_sources_are_parsed_by_one_thread_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python 3.11 can fail to parse in two threads at the same time."""
    parse_source, at_once, most = ast.parse, [0], [0]

    def counted(*source: Any, **more: Any) -> Any:
        at_once[0] += 1
        most[0] = max(most[0], at_once[0])
        time.sleep(0.05)
        at_once[0] -= 1
        return parse_source(*source, **more)

    monkeypatch.setattr(ast, "parse", counted)
    classes = [command_of(verb) for verb in ("train", "map", "poses", "demo")]
    known = [option_table.field_docs(cls) for cls in classes]
    option_table.field_docs.cache_clear()
    option_table._parsed_class_bodies.cache_clear()
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(option_table.field_docs, classes)) == known
    assert most == [1]
