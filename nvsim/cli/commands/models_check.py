"""Compare installed models with their descriptions: files, checksums, tensors, and their output for a test image. Exits
with code 1 if a model does not match its description."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from nvsim.cli.arguments import Positional
from nvsim.cli.show import as_json
from nvsim.cli.terminal import say
from nvsim.errors import InputError


@dataclass(frozen=True)
class Arguments:
    names: Positional[tuple[str, ...]] = ()
    """Models to check. Default: all."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    """Returns 1 if a model has a problem. Raises InputError if a named model is not installed."""
    from nvsim.networks.installed import bundled, installed
    from nvsim.perception.checking import check

    models, problems = installed()
    known = {model.name: model for model in (*models, *bundled())}
    for name in arguments.names:
        if name not in known:
            raise InputError(f"There is no model {name!r:.60} (installed: {', '.join(known) or 'none'}).")
    found: dict[str, Any] = {}
    for name in arguments.names or known:
        result = check(known[name])
        found[name] = asdict(result)
        if not arguments.json:
            say(f"{name}: {result.problem or f'{result.says}, {1000 * result.seconds:.0f} ms per image'}")
    broken = [] if arguments.names else problems
    if arguments.json:
        say(as_json({"models": found, "problems": broken}))
    else:
        for problem in broken:
            say(f"warning: {problem}")
        if not found and not broken:
            say("No model is installed; `nvsim models` lists the ones that NVSim knows.")
    return 1 if broken or any(row["problem"] for row in found.values()) else 0
