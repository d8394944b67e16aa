"""The package nvsim-mattersim works without nvsim, numba, and new syntax, and equals the simulator of the library."""

from __future__ import annotations

import ast
import json
import math
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nvsim.benchmarks.simulator import write_made_scan
from nvsim.r2r.simulator import Simulator
from nvsim.r2r.simulator import compiled_drawing as compiled
from nvsim.r2r.simulator import plain_drawing as plain
from nvsim.r2r.simulator.images import rays_of
from nvsim.r2r.simulator.scan import CANONICAL

PACKAGE = Path(__file__).parents[2] / "packaging" / "mattersim"
ALONE = """
import runpy, sys
for name in ("nvsim", "numba", "torch", "scipy"):
    sys.modules[name] = None  # an import fails
sys.path.insert(0, sys.argv[1])
"""
CHECK = ALONE + "runpy.run_path(sys.argv[2], run_name='__main__')"
WALK = f"""{ALONE}
import base64, json, math, MatterSim, numpy
assert base64.decodestring(b"QQ==") == b"A"
sim = MatterSim.Simulator()
sim.setNavGraphPath(sys.argv[2] + "/connectivity")
sim.setDatasetPath(sys.argv[2] + "/scans")
sim.setRenderingEnabled(True)
sim.setDiscretizedViewingAngles(True)
sim.setRestrictedNavigation(False)
sim.setBatchSize(2)
sim.setCameraResolution(96, 64)
sim.setCameraVFOV(math.radians(60))
sim.setElevationLimits(-0.9, 0.9)
sim.setPreloadingEnabled(True)
sim.setDepthEnabled(True)
sim.setCacheSize(10)
sim.setSeed(1)
sim.initialize()
sim.newRandomEpisode(["made", "made"])
steps = []
for number in range(12):
    if number:
        sim.makeAction([min(1, len(s.navigableLocations) - 1) for s in sim.getState()], [1, -1], [number % 2, 0])
    for s in sim.getState():
        names = "viewpointId ix x y z rel_heading rel_elevation rel_distance".split()
        places = [[getattr(p, name) for name in names] for p in [s.location, *s.navigableLocations]]
        images = [int(s.rgb.sum(dtype=numpy.int64)) / s.rgb.size, int(s.depth.sum(dtype=numpy.int64)) / s.depth.size]
        steps.append([[s.scanId, s.step, s.heading, s.elevation, s.viewIndex, places], images])
sim.close()
print(json.dumps(steps))
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the package as `pip install` writes it."""
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(PACKAGE / "src" / "MatterSim", folder / "MatterSim", ignore=shutil.ignore_patterns("__pycache__"))
    runpy.run_path(str(PACKAGE / "setup.py"))["copy_files"](folder / "MatterSim")
    return folder


def test_all_files_are_valid_in_python_3_8_and_import_only_numpy_and_opencv(package: Path) -> None:
    here = {path.relative_to(package).with_suffix("").as_posix().replace("/", ".") for path in package.rglob("*.py")}
    allowed = {"numpy", "cv2", *sys.stdlib_module_names}
    for path in package.rglob("*.py"):
        text = path.read_text()
        for node in ast.walk(ast.parse(text, str(path), feature_version=(3, 8))):
            assert not (isinstance(node, ast.Call) and ast.unparse(node).startswith("zip(") and node.keywords), path
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                optional = "project.scene_views", "simulator.live", "simulator.compiled_drawing"
                assert name in here or name.split(".")[0] in allowed or name.endswith(optional), (path, name)


def test_the_package_alone_gives_the_recorded_states_and_all_six_faces(package: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-c", CHECK, str(package), str(PACKAGE / "check.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_package_alone_gives_the_states_and_images_of_the_library(package: Path, tmp_path: Path) -> None:
    write_made_scan(tmp_path, count=12, side=64)
    command = [sys.executable, "-c", WALK, str(package), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    sim = Simulator()
    sim.setNavGraphPath(tmp_path / "connectivity")
    sim.setDatasetPath(tmp_path / "scans")
    sim.setDiscretizedViewingAngles(True)
    sim.setRestrictedNavigation(False)
    sim.setBatchSize(2)
    sim.setCameraResolution(96, 64)
    sim.setCameraVFOV(math.radians(60))
    sim.setDepthEnabled(True)
    sim.newRandomEpisode(["made", "made"])
    found: list[Any] = json.loads(done.stdout)
    for number in range(12):
        if number:
            nearest = [min(1, len(s.navigableLocations) - 1) for s in sim.getState()]
            sim.makeAction(nearest, [1, -1], [number % 2, 0])
        for state, (values, images) in zip(sim.getState(), found[2 * number : 2 * number + 2], strict=True):
            places = [
                [p.viewpointId, p.ix, p.x, p.y, p.z, p.rel_heading, p.rel_elevation, p.rel_distance]
                for p in [state.location, *state.navigableLocations]
            ]
            expected = [state.scanId, state.step, state.heading, state.elevation, state.viewIndex, places]
            assert values == json.loads(json.dumps(expected))
            assert images == pytest.approx([float(state.rgb.mean()), float(state.depth.mean())], rel=0.01)


@pytest.mark.parametrize(("heading", "elevation"), [(0.0, 0.0), (0.8, 0.3), (2.4, -1.2), (3.9, 1.4), (5.5, -0.5)])
def test_plain_drawing_equals_the_compiled_kernels(heading: float, elevation: float) -> None:
    random = np.random.default_rng(0)
    rays, plane = rays_of(CANONICAL, heading, elevation, 96, 64, math.radians(60))
    strip = random.integers(0, 256, (32, 192, 3)).astype(np.uint8)
    a, b = np.zeros((64, 96, 3), np.uint8), np.zeros((64, 96, 3), np.uint8)
    compiled.draw_colors(strip, rays, a)
    plain.draw_colors(strip, rays, b)
    assert np.abs(a.astype(int) - b).mean() < 2  # weights of 1/32, pixels are noise
    distances = random.integers(0, 60000, (32, 192)).astype(np.uint16)
    c, d = np.zeros((64, 96, 1), np.uint16), np.zeros((64, 96, 1), np.uint16)
    compiled.draw_depth(distances, rays, plane, c)
    plain.draw_depth(distances, rays, plane, d)
    assert (np.abs(c.astype(int) - d) > 1).mean() < 0.01  # except rays that meet a border of two pixels


def test_a_project_is_refused_without_nvsim(package: Path, tmp_path: Path) -> None:
    (tmp_path / "project.db").write_bytes(b"")
    program = "import sys; sys.path.insert(0, sys.argv[1]); import MatterSim\ns = MatterSim.Simulator()\n"
    program += "s.setDatasetPath(sys.argv[2])\ntry: s.initialize()\nexcept ValueError as error: print(error)"
    command = [sys.executable, "-c", program, str(package), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert "is a project; export its scan, or install NVSim" in done.stdout, done.stderr
