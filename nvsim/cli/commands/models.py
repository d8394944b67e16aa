"""List the installed networks with folder, author and license, and other networks that would improve results."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli.show import as_json
from nvsim.cli.terminal import say


@dataclass(frozen=True)
class Arguments:
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    from nvsim.networks.catalogue import catalogue

    found = catalogue()
    if arguments.json:
        say(as_json(found.as_dict()))
        return 0
    say(f"Models are in {found.folder}")
    for row in found.models:
        say("", f"{row.name}: {row.title}", f"  gives {row.role}, improves {row.improves}")
        for line in (row.made_by and f"made by {row.made_by}", row.licence and f"license: {row.licence}"):
            if line:
                say(f"  {line}")
        say(f"  {row.megabytes:,.0f} MB: {', '.join(row.files)}")
    for problem in found.problems:
        say("", f"warning: {problem}")
    if found.lacking:
        say("", "Not installed (download the files yourself, then run `nvsim models add FILE…`):")
    for lack in found.lacking:
        say("", f"{lack.role}, which improves {lack.improves}:")
        for known in lack.known:
            say(f"  {', '.join(known.names)} ({known.form}; {known.licence})", f"    {known.source}")
    return 0
