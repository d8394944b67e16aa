"""A wrong command line is one sentence with the option and the fix, for every command and kind of mistake."""

from __future__ import annotations

import json

import pytest

from nvsim.cli.arguments import parse
from nvsim.cli.command_table import COMMANDS
from nvsim.cli.main import main
from nvsim.cli.mistakes import OptionError, mistake_in
from nvsim.cli.options import Option, command_of, options


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("train", "--project is missing; write `nvsim train --project PATH [options]`."),
        ("import", "CAPTURE and --project are missing; write `nvsim import CAPTURE --project PATH [options]`."),
        ("train a.nvsim", "a.nvsim is not expected here; write --project a.nvsim."),
        ("train --project a --stepz 5", "There is no option --stepz; did you mean --steps?"),
        ("run a --project b --train.preset nvsim", "There is no option --train.preset; did you mean --preset?"),
        (
            "run a --project b --steps 5",
            "There is no option --steps; did you mean --depth.steps or --train.steps or --train.scanless.steps?",
        ),
        (
            "map --project a --gaussian-cap 4",
            "There is no option --gaussian-cap, which belongs to `nvsim train`; `nvsim map --help-all` lists the "
            "options.",
        ),
        (
            "export dataset --project a --stub",
            "There is no option --stub, because it is the default; --no-stub turns it off.",
        ),
        ("map --project a -x", "There is no option -x; `nvsim map --help-all` lists the options."),
        ("train --project a --steps", "--steps needs a value, for example 2000."),
        ("train --project a --steps --json", "--steps needs a value, for example 2000."),
        (
            "train --project a --steps many",
            "many is not a whole number; give --steps a whole number, for example 2000.",
        ),
        (
            "train --project a --steps=",
            "An empty value is not a whole number; give --steps a whole number, for example 2000.",
        ),
        ("train --project a --loss.ssim 1_0", "1_0 is not a number; give --loss.ssim a number, for example 0.2."),
        ("train --project a --steps 5 6", "--steps takes 1 value, and 6 is one more; remove it."),
        ("models add a --name b c", "--name takes 1 value, and c is one more; remove it."),
        (
            "export tasks --unseen a -- b",
            "b is not expected here; `nvsim export tasks --help` shows how to write the command.",
        ),
        ("map --project a --json=yes", "--json takes no value; write --json alone, or leave it out."),
        ("panorama --project a --at 1 -2", "--at needs 3 values, not 2."),
        ("export dataset --project a --for duett", "--for cannot be duett; did you mean duet?"),
        ("demo --storeys 3", "--storeys cannot be 3; choose one of 1, 2."),
        (
            "r2r agent fastest --scans a --out b",
            "AGENT cannot be fastest; choose one of shortest, random, random-paper, recurrent, mapgpt.",
        ),
        (
            "r2r python train.py --lr 5",
            "There is no option --lr; write a program after two hyphens: `nvsim r2r python -- train.py --lr 5`.",
        ),
        ("run --project a -- b c", "c is not expected here; `nvsim run --help` shows how to write the command."),
    ],
)
def test_a_mistake_is_one_sentence(words: str, sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    verb = max((verb for verb in COMMANDS if words.startswith(verb)), key=len)
    assert main(words.split()) == 2
    assert capsys.readouterr().err == f"nvsim {verb}: {sentence}\n"


@pytest.mark.parametrize(
    ("words", "fix"),
    [
        ("trian --project a", "did you mean `nvsim train`?"),
        ("grph", "did you mean `nvsim graph`?"),
        ("graph chek a.nvsim", "did you mean `nvsim graph check`?"),
        ("clean a.nvsim", "did you mean `nvsim splat clean`?"),
        ("nonsense", "`nvsim --help` lists the commands."),
    ],
)
def test_an_unknown_command_is_one_sentence_with_similar_names(
    words: str, fix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == 2
    err = capsys.readouterr().err
    assert err.startswith("nvsim: There is no command `nvsim ") and err.endswith(f"`; {fix}\n")


def test_a_mistake_is_an_event_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "--project", "a", "--json", "--stepz", "5"]) == 2
    out, err = capsys.readouterr()
    event = {"event": "failed", "stage": "train", "message": "There is no option --stepz; did you mean --steps?"}
    assert json.loads(out) == {**event, "code": 2} and err.count("\n") == 1


def found_in(verb: str) -> list[Option]:
    command = command_of(verb)
    return options(command, command.defaults([]) if hasattr(command, "defaults") else None)


@pytest.mark.parametrize("verb", sorted(COMMANDS))
def test_every_number_and_choice_names_its_option_if_the_value_is_wrong(verb: str) -> None:
    for option in found_in(verb):
        if option.flag and option.hint in (int, float):
            assert f"give {option.flag} a " in mistake_in(verb, found_in(verb), [option.flag, "word"], "")
        if option.flag and "Literal" in str(option.hint):
            assert f"{option.flag} cannot be #; choose " in mistake_in(verb, found_in(verb), [option.flag, "#"], "")


@pytest.mark.parametrize("verb", sorted(COMMANDS))
def test_the_parser_refuses_an_unknown_option_of_every_command_with_a_sentence(verb: str) -> None:
    with pytest.raises(OptionError, match="^There is no option --unknown-option; "):
        parse(command_of(verb), ["--unknown-option"], verb)
