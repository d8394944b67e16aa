"""Print the folder in which the module MatterSim is NVSim's simulator. Add it to PYTHONPATH of an agent's program."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli.show import as_json
from nvsim.cli.terminal import say


@dataclass(frozen=True)
class Arguments:
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    from nvsim.r2r.simulator.shim import shim_folder

    folder = str(shim_folder())
    say(as_json({"path": folder}) if arguments.json else folder)
    return 0
