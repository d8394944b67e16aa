"""The folder for the PYTHONPATH of programs that import MatterSim: they get NVSim's simulator under that name."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from nvsim.errors import InputError

_ASK = (
    "import importlib.util, json; f = importlib.util.find_spec; m = f('MatterSim'); "
    "print(json.dumps([m.origin if m else None, f('nvsim') is not None, [n for n in ('numpy', 'cv2') if not f(n)]]))"
)


def shim_folder() -> Path:
    """Returns the folder for PYTHONPATH."""
    return Path(__file__).parent


def environment_with_shim(command: Sequence[str], replace: bool = False) -> dict[str, str]:
    """Returns the environment variables for `command`.

    Raises InputError if its Python has another MatterSim (unless `replace` is true), has no nvsim, or lacks a package
    that the simulator needs.
    """
    found = dict(os.environ)
    interpreter = command[0] if Path(command[0]).name.startswith("python") else sys.executable
    ours = str(shim_folder())
    try:
        asked = subprocess.run([interpreter, "-c", _ASK], capture_output=True, text=True, env=found, check=False)
        installed, has_nvsim, lacking = json.loads(asked.stdout)
    except (OSError, ValueError) as error:
        raise InputError(f"{interpreter} cannot be run as Python; name the interpreter of the agent.") from error
    if not has_nvsim:
        raise InputError(f"{interpreter} has no nvsim; install NVSim for it, or run the agent with {sys.executable}.")
    if lacking:
        raise InputError(
            f"{interpreter} lacks {' and '.join(lacking)}, which NVSim's simulator needs; install NVSim for it, or run "
            f"the agent with {sys.executable}."
        )
    if installed is not None and Path(installed).parent != Path(ours) and not replace:
        raise InputError(f"{interpreter} already has a MatterSim, {installed}; give --replace to use NVSim's instead.")
    given = found.get("PYTHONPATH")
    # An empty entry is the current folder, from which several agents import their own packages.
    before = [] if not given else [path for path in given.split(os.pathsep) if path != ours]
    return found | {"PYTHONPATH": os.pathsep.join([ours, *before])}
