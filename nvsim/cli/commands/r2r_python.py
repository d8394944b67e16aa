"""Run a program, such as an agent's training, that finds NVSim's simulator where it imports MatterSim.

`nvsim r2r python -- python train.py --batch 8`: all after the two hyphens is the program's.
"""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli.arguments import Positional
from nvsim.errors import InputError


@dataclass(frozen=True)
class Arguments:
    program: Positional[tuple[str, ...]] = ()
    """The program and its arguments, after `--`."""
    replace: bool = False
    """Take the place of a MatterSim that is installed."""


def run(arguments: Arguments) -> int:
    import subprocess

    from nvsim.r2r.simulator.shim_path import environment_with_shim

    if not arguments.program:
        raise InputError("No program is given; write it after two hyphens: nvsim r2r python -- python train.py")
    environment = environment_with_shim(arguments.program, arguments.replace)
    try:
        return subprocess.run(arguments.program, env=environment, check=False).returncode
    except OSError as error:
        raise InputError(f"Cannot run {arguments.program[0]}: {error.strerror}; check its name.") from error
