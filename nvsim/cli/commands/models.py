"""List the networks that are installed, where they lie, who made them and under which licence, and what others would
improve."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli.show import as_json


@dataclass(frozen=True)
class Arguments:
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    from nvsim.networks.catalogue import catalogue

    found = catalogue()
    if arguments.json:
        print(as_json(found.as_dict()))
        return 0
    print(f"Models lie in {found.folder}")
    for row in found.models:
        print(f"\n{row.name}: {row.title}\n  gives {row.role}, improves {row.improves}")
        for line in (row.made_by and f"made by {row.made_by}", row.licence and f"licence: {row.licence}"):
            if line:
                print(f"  {line}")
        print(f"  {row.megabytes:,.0f} MB: {', '.join(row.files)}")
    for problem in found.problems:
        print(f"\nwarning: {problem}")
    if found.lacking:
        print("\nNot installed (fetch the files yourself, then `nvsim models add FILE…`):")
    for lack in found.lacking:
        print(f"\n{lack.role}, which improves {lack.improves}:")
        for known in lack.known:
            print(f"  {', '.join(known.names)} ({known.form}; {known.licence})\n    {known.source}")
    return 0
