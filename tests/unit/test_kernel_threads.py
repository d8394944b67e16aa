"""One module selects the library that runs the threads of the kernels."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest


def told(program: str, **environment: str) -> str:
    """The output of a new interpreter."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_THREADING")} | environment
    result = subprocess.run(
        [sys.executable, "-c", program], env=kept, capture_output=True, text=True, timeout=120, check=False
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


@pytest.mark.parametrize("first", ["nvsim", "numba", "nvsim.render.model", "nvsim_app"])
def test_openmp_comes_before_tbb_whatever_is_imported_first(first: str) -> None:
    program = f"import {first}, nvsim.geometry, numba; print(*numba.config.THREADING_LAYER_PRIORITY)"
    assert told(program) == "omp workqueue tbb"


def test_a_child_process_inherits_the_choice() -> None:
    child = "import numba; print(*numba.config.THREADING_LAYER_PRIORITY)"
    program = f"import nvsim, subprocess, sys; subprocess.run([sys.executable, '-c', {child!r}], check=True)"
    assert told(program) == "omp workqueue tbb"


def test_what_somebody_chose_in_the_environment_stays() -> None:
    program = "import nvsim, numba; print(*numba.config.THREADING_LAYER_PRIORITY)"
    assert told(program, NUMBA_THREADING_LAYER_PRIORITY="workqueue omp tbb") == "workqueue omp tbb"


_RENDERED_IN_THREADS = """
import hashlib
import numpy as np
from concurrent.futures import ThreadPoolExecutor
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.render.model import render_gaussians
from nvsim.benchmarks.random_room import random_room
import numba

camera = Camera(Intrinsics(64, 48, 55.0, 55.0, 32.0, 24.0), camera_pose(np.array([0.0, 0.0, 1.5]), 0.0))
room = random_room(500)
with ThreadPoolExecutor(4) as pool:
    images = list(pool.map(lambda _: render_gaussians(room, camera).rgb.tobytes(), range(12)))
assert len(set(images)) == 1
print(numba.threading_layer(), hashlib.sha256(images[0]).hexdigest())
"""


def test_where_there_is_no_openmp_several_threads_render_the_same_on_numbas_own_pool() -> None:
    layer, image = told(_RENDERED_IN_THREADS, NUMBA_THREADING_LAYER="workqueue").split()
    usual, same = told(_RENDERED_IN_THREADS).split()
    assert (layer, usual) == ("workqueue", "omp")
    assert image == same
