"""The README of the ground truth of a building."""

from __future__ import annotations

import numpy as np

from nvsim.building.scene import CAMERA_HEIGHT, Scene
from nvsim.building.truth import HIGH, LOW, RESOLUTION
from nvsim.capture.types import Cloud

TRUTH_EVERY = 10  # frames


def readme(scene: Scene, cloud: Cloud, novel: int) -> str:
    """The text of README.txt for a scene with `novel` novel views."""
    moved = np.linalg.norm(np.diff(scene.path[:, :2], axis=0), axis=1).sum()
    c = scene.config
    floors = " and ".join(f"{s.floor:g}" for s in scene.storeys)
    rooms = sum(len(s.plan.rooms) for s in scene.storeys)
    area = sum(s.plan.extent.area for s in scene.storeys)
    options = "".join(f", {o}" for o in (c.style, f"{c.storeys} storeys") if o not in ("furnished", "1 storeys"))
    world = f"World: meters, z up, floor at z = {floors}; cameras level, {CAMERA_HEIGHT} m above the floor."
    return f"""Ground truth of a built-in building (seed {c.seed}, {c.size}{options}): for evaluation, never an input.

{rooms} rooms on {area:.0f} m2, {len(scene.walk)} frames on {moved:.0f} m,
{len(cloud.points)} points. {world}

floor/      every frame: pixels that show floor, including rugs and floor behind glass; people are not floor
transient/  every frame: pixels that show a person
depth/      every {TRUTH_EVERY}th frame: 16-bit, millimeters along the optical axis, of the surface behind glass; people
            are included
normals/    for the same frames: world normal toward the camera, RGB = (n + 1) * 127.5; gray on people
novel/      {novel} views from beside the trajectory, turned 35 to 145 degrees off it, without people and noise;
            holdout_frames.txt has their poses, novel_floor/ their true floor
{_maps(scene)}"""


def _maps(scene: Scene) -> str:
    solid = f"occupied are all solids between {LOW}"
    if len(scene.storeys) == 1:
        return f"""map.pgm     ROS map_server, {RESOLUTION} m: {solid} and {HIGH} m (including glass and the step,
map.yaml    without people), free is the floor connected with the trajectory, the rest is unknown
"""
    return f"""storey_N/   map.pgm and map.yaml of each storey, ROS map_server, {RESOLUTION} m: {solid}
            and {HIGH} m above its floor (including glass and the platforms, without people), free is the floor
            connected with the trajectory there, the rest is unknown
storeys.json  the height of each floor, meters, its map, and the outline of the treads of the stairs

The steps of the stairs are floor in the masks, treads and risers alike, because people walk over both. They are free
in both maps. On the stairs the cameras keep their height above the line through the middles of the treads. On the way
down they look down by 20 degrees.
"""
