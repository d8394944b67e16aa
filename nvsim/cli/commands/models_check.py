"""Hold installed models against their descriptions: files, checksums, tensors, and what they answer of a test image.
Exits with 1 where one is not what its description says."""

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
    """Which models; all when none is named."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
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
            say(f"{name}: {result.problem or f'{result.says}, {1000 * result.seconds:.0f} ms an image'}")
    broken = [] if arguments.names else problems
    if arguments.json:
        say(as_json({"models": found, "problems": broken}))
    else:
        for problem in broken:
            say(f"warning: {problem}")
        if not found and not broken:
            say("No model is installed; `nvsim models` says which ones NVSim knows.")
    return 1 if broken or any(row["problem"] for row in found.values()) else 0
