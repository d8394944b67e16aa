"""Messages name options that exist for the command that prints them."""

from __future__ import annotations

import ast
import functools
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from nvsim.cli import console
from nvsim.cli.commands.stages import Map
from nvsim.cli.guard import run_guarded
from nvsim.cli.main import COMMANDS, main
from nvsim.cli.options import _OPTION, options_of, rename_options
from nvsim.errors import InputError
from nvsim.events import Done, Event, Log, Warning

ROOT = Path(__file__).parents[2]
OTHERS = {
    *("--head", "--generate"),  # of Ray and of openssl, in nvsim/cluster/executor_choice.py
    *("--version", "--tyro-"),  # of nvsim itself, and of the parser
    *("--bench", "--bench-edits", "--theme", "--screenshot", "--renderer"),  # of python -m nvsim_app
}


def literals(path: Path) -> Iterator[tuple[int, str]]:
    """Texts in the code, without docstrings."""
    nodes = list(ast.walk(ast.parse(path.read_text())))
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef
    bodies = [node.body for node in nodes if isinstance(node, kinds)]
    said = {id(step.value) for body in bodies for step in body if isinstance(step, ast.Expr)}
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in said:
            yield node.lineno, node.value


@functools.cache
def mentioned() -> list[tuple[str, str]]:
    """The places of all options in texts of the code, and the options."""
    found = {
        (f"{path.relative_to(ROOT)}:{line}", option)
        for package in ("nvsim", "app/nvsim_app")
        for path in (ROOT / package).rglob("*.py")
        if path.name != "agent_files.py"  # has command lines of agents
        for line, text in literals(path)
        for option in _OPTION.findall(text)
    }
    return sorted(found - {("", "")})


def test_every_option_in_a_message_is_one_of_some_command() -> None:
    known = {option for verb in COMMANDS for option in options_of(verb)} | OTHERS
    unknown = [place for place in mentioned() if place[1] not in known]
    assert len(mentioned()) > 100 and not unknown


@pytest.mark.parametrize("verb", sorted(COMMANDS))
def test_the_options_of_a_command_are_those_of_its_help(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([*verb.split(), "--help-all"])
    shown = re.findall(r"^  (?:-h, )?(--[a-z][a-z0-9.-]*)", capsys.readouterr().out, re.MULTILINE)
    assert set(shown) == options_of(verb)


@pytest.mark.parametrize("verb", sorted(COMMANDS))
def test_every_command_names_options_that_it_has_or_whose_command_it_says(verb: str) -> None:
    for option in sorted({option for _, option in mentioned()} - OTHERS):
        words = rename_options(verb, f"It makes no sense; give {option} 1.")
        for other, its in re.findall(r"`nvsim ([a-z0-9 -]+?) (--[a-z][a-z0-9.-]*)`", words):
            assert its in options_of(other)
        own = re.sub(r"`[^`]*`", "", words)
        assert set(_OPTION.findall(own)) <= options_of(verb), (option, words)


@pytest.mark.parametrize(
    ("verb", "said", "stage", "shown"),
    [
        ("run", "less (--scanless.steps 1).", "train", "less (--train.scanless.steps 1)."),
        ("demo", "give --margin", "map", "give --map.margin"),
        ("demo", "give --margin", "", "give --depth.margin or --map.margin"),  # of either stage
        ("run", "give --steps 5", "depth", "give --depth.steps 5"),
        (
            "poses",
            "continue by --model 0 or --model 1",
            "",
            "continue by `nvsim run --model 0` or `nvsim run --model 1`",
        ),
        ("run", "give --steps 5", "", "give --depth.steps or --train.steps 5"),  # not those of scanless
        ("train", "give --steps 5", "train", "give --steps 5"),
        ("train", "(--train.gaussian-cap)", "", "(--gaussian-cap)"),
        ("check", "--poses given keeps them", "", "`nvsim run --poses given` keeps them"),
        ("run", "`nvsim map --reapply` does it", "", "`nvsim map --reapply` does it"),
        ("run", "a--steps and ---steps are none", "", "a--steps and ---steps are none"),
        ("run", "no option at all", "", "no option at all"),
        ("run", "--what-nobody-has", "", "--what-nobody-has"),
    ],
)
def test_an_option_is_named_as_the_command_knows_it(verb: str, said: str, stage: str, shown: str) -> None:
    assert rename_options(verb, said, stage) == shown


def test_events_and_failures_pass_there(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    heard: list[Event] = []

    def work(_: object) -> int:
        with console.event_listener(False) as listen:
            listen(Log("4000 steps (--scanless.steps)", "train"))
            listen(Warning("wide (--margin)", "map"))
            listen(Done("depth", "see --steps"))
            raise InputError("too few --steps")

    monkeypatch.setattr(Map, "run", work)
    with console.redirect_events(heard.append):
        assert run_guarded("run", Map, ["--project", "x"]) == 2
    texts = [getattr(event, "text", "") or getattr(event, "summary", "") or event.message for event in heard]  # type: ignore[union-attr]
    assert texts[:3] == ["4000 steps (--train.scanless.steps)", "wide (--map.margin)", "see --depth.steps"]
    assert texts[3] == "too few --depth.steps"  # of the stage that was at work
    assert "too few --depth.steps" in capsys.readouterr().err


def test_what_train_says_of_captures_without_a_scan_names_what_run_knows() -> None:
    (line,) = (text for _, text in literals(ROOT / "nvsim/project/stages/trained.py") if "--scanless.steps" in text)
    assert "--train.scanless.steps 1" in rename_options("run", line, "train")
    assert "--scanless.steps 1" in rename_options("train", line, "train")
