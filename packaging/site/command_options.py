"""The commands and options that pages quote, compared with those of the command line.

The options come from the dataclasses of the commands, so a page that quotes an option is checked against the code.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from nvsim.cli.arguments import invocation, option_help
from nvsim.cli.command_table import COMMANDS
from nvsim.cli.options import command_of, options, options_of

ROOT = Path(__file__).resolve().parents[2]
OPTION = re.compile(r"(?<![\w-])--[a-z][\w.-]*")
FENCE = re.compile(r"^( *)```[^\n]*\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"`([^`\n]+(?:\n[^`\n]+)?)`")
FOREIGN = frozenset({"--dist", "--num-cpus", "--dependency", "--no-x"})
"""Options of pytest, Ray, and Slurm that the pages quote, and the name of any flag."""
GROUPS = frozenset(verb.split()[0] for verb in COMMANDS) | {"help"}
ENDS = {"|", "||", "&&", ";", ">", "&"}


@cache
def options_of_scripts() -> frozenset[str]:
    """The options of the programs in packaging and tests/benchmarks, which pages quote too: the names in quotation
    marks, and the fields of the dataclasses that become options."""
    names = set(re.findall(r'"(--[a-z][\w-]*)"', (ROOT / "nvsim/cli/main.py").read_text()))
    for file in [*ROOT.glob("packaging/*.py"), *ROOT.glob("tests/benchmarks/**/*.py")]:
        text = file.read_text()
        names.update(re.findall(r'"(--[a-z][\w-]*)"', text))
        if "tyro" in text:
            names.update("--" + name.replace("_", "-") for name in re.findall(r"^    (\w+): ", text, re.MULTILINE))
            negated = re.findall(r"^    (\w+): bool = True", text, re.MULTILINE)
            names.update("--no-" + name.replace("_", "-") for name in negated)
    return frozenset(names)


@cache
def all_options() -> frozenset[str]:
    return frozenset().union(*(options_of(verb) for verb in COMMANDS), options_of_scripts(), FOREIGN)


def words_of(line: str) -> list[str]:
    """The words of a line of a shell, without its comment and without the commands after a pipe."""
    try:
        lexer = shlex.shlex(line, posix=True, punctuation_chars="|&;>")
        lexer.whitespace_split = True
        words = list(lexer)
    except ValueError:  # a quotation that the line does not end
        words = line.split()
    ends = [i for i, word in enumerate(words) if word in ENDS]
    return words[: ends[0]] if ends else words


def verb_of(words: list[str]) -> str | None:
    """The command of `words`, which begin with nvsim; None if they name a group, as in `nvsim graph`."""
    for count in (2, 1):
        if (verb := " ".join(words[1 : 1 + count])) in COMMANDS:
            return verb
    return None


def command_lines(markdown: str) -> Iterator[str]:
    """The lines of code blocks that call nvsim."""
    for block in FENCE.finditer(markdown):
        for line in re.sub(r"\\\n\s*", " ", block[2]).splitlines():
            if line.strip().startswith("nvsim "):
                yield line.strip()


def _quoted(markdown: str) -> Iterator[str]:
    yield from command_lines(markdown)
    for code in CODE.finditer(FENCE.sub("", markdown)):
        yield " ".join(code[1].split())


def wrong_options(markdown: str) -> list[str]:
    """One sentence for each quoted command or option that does not exist."""
    found = []
    for text in _quoted(markdown):
        if text.startswith("pip "):
            continue
        known, where = all_options(), "no command"
        if text.startswith("nvsim "):
            words = words_of(text)
            if "--" in words:
                words = words[: words.index("--")]
            verb = verb_of(words)
            if verb is not None:
                known, where = options_of(verb), f"`nvsim {verb}` does not"
            elif re.fullmatch(r"[a-z][a-z0-9-]*", name := "".join(words[1:2])) and name not in GROUPS:
                found.append(f"there is no command `nvsim {name}`")
                continue
            text = " ".join(words)
        for name in OPTION.findall(text):
            if name.rstrip(".").replace("_", "-") not in {option.replace("_", "-") for option in known}:
                found.append(f"`{name}` in `{text}`: {where} {'has' if where == 'no command' else 'have'} this option")
    return found


def options_page() -> str:
    """A page with all options of all commands."""
    lines = [
        "# Options of all commands",
        "",
        "This page is generated from the dataclasses that define the options. `nvsim COMMAND --help` prints the same "
        "text. [The command line](../commands.md) explains how the commands work together.",
        "",
    ]
    for verb in COMMANDS:
        found = options(command_of(verb))
        purpose = (command_of(verb).__doc__ or COMMANDS[verb][1]).split("\n\n")[0]
        lines += [f"## nvsim {verb}", "", " ".join(purpose.split()).replace("<", "&lt;"), ""]
        if found:
            rows = [f"| `{_cell(invocation(o))}` | {_cell(option_help(o)).replace('<', '&lt;')} |" for o in found]
            lines += ["| argument | meaning |", "|---|---|", *rows, ""]
    return "\n".join(lines)


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
