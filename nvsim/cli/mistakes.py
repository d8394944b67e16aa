"""Find the mistake in a command line that the parser refuses, and explain it in one sentence: the problem, the option,
and the fix."""

from __future__ import annotations

import difflib
import itertools
import re
import shlex
import types
import typing
from collections.abc import Iterator, Sequence
from typing import Any, Literal

from nvsim.cli.command_table import COMMANDS
from nvsim.cli.options import Option, options_of
from nvsim.errors import InputError

_NUMBER = re.compile(r"[-+]?\.?\d")
_TYPES = {int: "a whole number", float: "a number"}


class OptionError(InputError):
    """A word of the command line is wrong. The message names options as the user must write them."""


def unknown_command(verb: str) -> str:
    """The sentence about `nvsim VERB`, which is no command."""
    groups = [name.split()[0] for name in COMMANDS]  # `nvsim GROUP` lists the commands of a group
    known = {name: [name] for name in (*COMMANDS, *groups)}
    for name in COMMANDS:
        last = name.split()[-1]
        if known.get(last) != [last]:
            known.setdefault(last, []).append(name)
    near = [name for word in difflib.get_close_matches(verb, known, 3, 0.8) for name in known[word]]
    if near:
        listed = " or ".join(f"`nvsim {name}`" for name in dict.fromkeys(near[:3]))
        return f"There is no command `nvsim {verb}`; did you mean {listed}?"
    return f"There is no command `nvsim {verb}`; `nvsim --help` lists the commands."


def mistake_in(verb: str, found: Sequence[Option], argv: Sequence[str], usage: str) -> str:
    """The sentence about the first mistake in the arguments `argv` of `nvsim VERB`; "" if there is none. `found` are
    its options, and `usage` is the command with its required arguments."""
    flags = {option.flag: option for option in found if option.flag}
    places = [option for option in found if not option.flag]
    words, seen_hyphens, given = list(argv), False, set()
    last, values = None, list[str]()  # the option before the current word, and its values
    while words:
        word = words.pop(0)
        if word == "--" and not seen_hyphens:
            seen_hyphens, last, values = True, None, []
        elif seen_hyphens or _is_value(word):
            if not places:
                needed = [o for o in found if o.required and o.flag and not _is_given(o.flag, argv)]
                return _stray(verb, word, last, [*values, word, *itertools.takewhile(_is_value, words)], needed)
            option, last, values = places[0], None, []
            given.add(option.path)
            if not _is_list(option):
                places.pop(0)
            if sentence := _wrong_value(option, word):
                return sentence
        else:
            name, sign, value = word.partition("=")
            name = name.replace("_", "-")
            if name not in flags:
                return _unknown(verb, name, found, argv)
            if places and places[0].path in given:  # an option ends a list
                places.pop(0)
            last, values = flags[name], [value] if sign else []
            given.add(last.path)
            while words and len(values) < _most_values(last) and _can_be_value(words[0], last):
                values.append(words.pop(0))
            if sentence := _wrong_values(last, values):
                return sentence
    missing = [o for o in found if o.required and o.path not in given and not (not o.flag and _is_list(o))]
    if not missing:
        return ""
    names = [o.flag or _name(o) for o in missing]
    listed = " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
    return f"{listed} {'is' if len(names) == 1 else 'are'} missing; write `{usage}`."


def _is_given(flag: str, argv: Sequence[str]) -> bool:
    return any(word.partition("=")[0] == flag for word in argv)


def _unknown(verb: str, name: str, found: Sequence[Option], argv: Sequence[str]) -> str:
    """The sentence about an option that the command does not have."""
    flags = [option.flag for option in found if option.flag]
    if any("after `--`" in option.help for option in found):
        program = shlex.join(itertools.dropwhile(lambda word: word.startswith("-"), argv))
        return f"There is no option {name}; write a program after two hyphens: `nvsim {verb} -- {program}`."
    head, dot, last = name[2:].rpartition(".")
    opposite = f"--{head}{dot}no-{last}"
    if opposite in flags:
        return f"There is no option {name}, because it is the default; {opposite} turns it off."
    near = [flag for flag in flags if flag[2:].rpartition(".")[2] == last]
    near += [flag for flag in difflib.get_close_matches(name, flags, 3, 0.8) if flag not in near]
    if near:
        return f"There is no option {name}; did you mean {' or '.join(near[:3])}?"
    other = next((other for other in COMMANDS if name in options_of(other)), "")
    belongs = f", which belongs to `nvsim {other}`" if other else ""
    return f"There is no option {name}{belongs}; `nvsim {verb} --help-all` lists the options."


def _stray(verb: str, word: str, last: Option | None, values: Sequence[str], needed: Sequence[Option]) -> str:
    """The sentence about a word that belongs to no argument. `last`: the option before it. `values`: the values of that
    option, the word, and the values after it. `needed`: options that the command needs and that are not given."""
    if last is not None and last.hint is not bool and not _is_list(last):
        most = _most_values(last)
        fix = f"separate several by commas: {','.join(values)}" if "separated by commas" in last.help else "remove it"
        return f"{last.flag} takes {most} value{'s' * (most > 1)}, and {word} is one more; {fix}."
    for option in needed:
        return f"{word} is not expected here; write {option.flag} {shlex.quote(word)}."
    return f"{word} is not expected here; `nvsim {verb} --help` shows how to write the command."


def _wrong_values(option: Option, values: Sequence[str]) -> str:
    """The sentence about the number of values of a flag, or about one of them, or ""."""
    if option.hint is bool:
        return f"{option.flag} takes no value; write {option.flag} alone, or leave it out." if values else ""
    most = _most_values(option)
    if len(values) < most and not _is_list(option):
        count = "a value" if most == 1 else f"{most} values, not {len(values)}"
        return f"{option.flag} needs {count}{_example(option)}."
    return next(filter(None, (_wrong_value(option, value) for value in values)), "")


def _wrong_value(option: Option, word: str) -> str:
    """The sentence about a value that the option does not take, or ""."""
    name, choices = option.flag or _name(option), _choices(option)
    kinds = [leaf for leaf in _leaves(option.hint) if not isinstance(leaf, str) and leaf is not type(None)]
    if word in choices or any(kind not in _TYPES or _reads(kind, word) for kind in kinds):
        return ""
    if kinds:
        return (
            f"{word or 'An empty value'} is not {_TYPES[kinds[-1]]}; give {name} {_TYPES[kinds[-1]]}{_example(option)}."
        )
    if near := difflib.get_close_matches(word, choices, 1, 0.7):
        return f"{name} cannot be {word}; did you mean {near[0]}?"
    return f"{name} cannot be {word}; choose one of {', '.join(choices)}."


def _reads(kind: type, word: str) -> bool:
    try:
        kind(word)
    except ValueError:
        return False
    return "_" not in word


def _name(option: Option) -> str:
    """The name of a positional argument in the help."""
    return option.path.rpartition(".")[2].upper()


def _example(option: Option) -> str:
    """The choices of an option, or its default as an example, behind a sentence; "" without either."""
    if choices := _choices(option):
        return f"; choose one of {', '.join(choices)}"
    return "" if option.default in (None, "", ()) else f", for example {option.default}"


def _leaves(hint: Any) -> Iterator[Any]:
    """The types of single values, and choices as text."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin is Literal:
        yield from (str(value) for value in inner if value != "")
    elif origin in (typing.Union, types.UnionType, tuple):
        for one in inner:
            if one is not Ellipsis:
                yield from _leaves(one)
    else:
        yield hint


def _choices(option: Option) -> list[str]:
    return [leaf for leaf in _leaves(option.hint) if isinstance(leaf, str)]


def _is_list(option: Option) -> bool:
    return _most_values(option) > 9


def _most_values(option: Option) -> int:
    """Number of words after the flag; very many for a list."""
    for part in (option.hint, *typing.get_args(option.hint)):
        if typing.get_origin(part) is tuple:
            inner = typing.get_args(part)
            return 1 << 30 if inner[-1] is Ellipsis else len(inner)
    return 1


def _is_value(word: str) -> bool:
    return not word.startswith("-") or word == "-" or bool(_NUMBER.match(word))


def _can_be_value(word: str, option: Option) -> bool:
    return option.hint is not bool and (_is_value(word) or word in _choices(option))
