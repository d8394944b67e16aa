"""The whole job beside a TBB that some other program installed: it is left alone, and the process ends."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from nvsim.building import BuildingConfig, generate

_TELLING = """
import sys
from nvsim.cli.main import main

code = main(sys.argv[1:])
import numba

print("layer:", numba.threading_layer())
sys.exit(code)
"""


@pytest.fixture
def with_tbb() -> dict[str, str]:
    """An environment in which numba finds TBB: the one of the test extra, or the system's."""
    ours = Path(sys.prefix) / "lib"
    paths = [str(ours), os.environ.get("LD_LIBRARY_PATH", "")]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_THREADING")}
    environment["LD_LIBRARY_PATH"] = os.pathsep.join(path for path in paths if path)
    found = subprocess.run(
        [sys.executable, "-c", "import ctypes; ctypes.CDLL('libtbb.so.12')"], env=environment, check=False
    )
    if found.returncode != 0:
        if os.environ.get("CI") == "true":
            pytest.fail("TBB is missing; it is part of the test extra")
        pytest.skip("takes TBB, which the test extra brings")
    return environment


def layer_of(program: str, environment: dict[str, str]) -> str:
    result = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=120, check=True
    )
    return result.stdout.strip()


_KERNEL = """
import numpy as np
from numba import njit, prange

@njit(parallel=True)
def double(a):
    for i in prange(len(a)):
        a[i] *= 2
"""
_TELL = "\ndouble(np.ones(9))\nimport numba\nprint(numba.threading_layer())\n"


def test_numba_alone_takes_tbb_and_beside_nvsim_it_does_not(with_tbb: dict[str, str]) -> None:
    assert layer_of(_KERNEL + _TELL + "import os, sys; sys.stdout.flush(); os._exit(0)", with_tbb) == "tbb"
    assert layer_of("import nvsim" + _KERNEL + _TELL, with_tbb) == "omp"
    assert layer_of(_KERNEL + "import nvsim" + _TELL, with_tbb) == "omp"


@pytest.mark.timeout(900)
def test_the_whole_job_runs_on_openmp_and_ends(tmp_path: Path, with_tbb: dict[str, str]) -> None:
    generate(tmp_path, BuildingConfig(size="small", width=160, height=120, step=0.8, turn=30.0, people=False))
    job = ["run", str(tmp_path / "capture"), "--project", str(tmp_path / "rooms.nvsim"), "--train.steps", "40"]
    result = subprocess.run(
        [sys.executable, "-P", "-c", _TELLING, *job],
        env=with_tbb,
        capture_output=True,
        text=True,
        timeout=800,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[-1] == "layer: omp"
