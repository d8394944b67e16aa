"""Run a program, such as an agent's training, so that its import of MatterSim gives NVSim's simulator.

`nvsim r2r python -- python train.py --batch 8`: everything after the two hyphens belongs to the program.
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
    """Use NVSim's simulator even if a MatterSim is installed."""


def run(arguments: Arguments) -> int:
    """Returns the program's exit code. Raises InputError if no program is given or it cannot be run."""
    import subprocess

    from nvsim.r2r.simulator.shim import environment_with_shim

    if not arguments.program:
        raise InputError("No program is given; write it after two hyphens: nvsim r2r python -- python train.py")
    environment = environment_with_shim(arguments.program, arguments.replace)
    try:
        return subprocess.run(arguments.program, env=environment, check=False).returncode
    except OSError as error:
        raise InputError(f"Cannot run {arguments.program[0]}: {error.strerror}; check its name.") from error
