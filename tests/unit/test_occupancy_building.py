"""The map of a built-in building's scan against its true one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from nvsim.building import BuildingConfig
from nvsim.building.generation import scan
from nvsim.building.scene import Scene, make_scene, textures_of
from nvsim.building.truth import occupancy
from nvsim.capture.types import Alignment, Capture, Frame
from nvsim.geometry.lens import Lens
from nvsim.occupancy.types import compare_maps
from nvsim.project.occupancy_maps import build_occupancy
from nvsim.project.occupancy_sources import find_rays


def capture_of(scene: Scene) -> Capture:
    """Its walk and its scan, which does not say from where each point was seen; no images."""
    frames = []
    for i in range(len(scene.walk)):
        camera = scene.camera(i)
        k = camera.intrinsics
        lens = Lens("PINHOLE", k.width, k.height, (k.fx, k.fy, k.cx, k.cy))
        frames.append(Frame(f"{i:05d}.jpg", Path(f"{i:05d}.jpg"), lens, camera.camera_to_world))
    cloud = scan(scene, textures_of(scene), np.random.default_rng(1))
    return Capture(Path("building"), "nerfstudio", tuple(frames), cloud, Alignment.identity())


@pytest.mark.parametrize("seed", [2, 5])
def test_nothing_that_stands_in_the_building_is_found_free(seed: int) -> None:
    scene = make_scene(BuildingConfig(seed=seed, size="small", people=False))
    capture = capture_of(scene)
    built = build_occupancy(capture, None, find_rays(capture, None))
    figures = compare_maps(built.occupancy, occupancy(scene))
    assert figures["occupied_found_free"] < 0.002
    assert figures["free_found_free"] > 0.86 and figures["free_found_occupied"] < 0.04
    assert figures["beside_m2"] < 0.1
    assert built.unseen < 0.15 * len(capture.cloud.points)  # type: ignore[union-attr]
