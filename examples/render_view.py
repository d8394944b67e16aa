"""Open a project and render one view: python examples/render_view.py house.nvsim

Writes view.png into the current folder.
"""

import math
import sys
from pathlib import Path

import numpy as np
from PIL import Image

import nvsim

path = Path(sys.argv[1])
with nvsim.open_project(path) as project:
    graph = project.need_graph()
    scene = project.scene()
if scene is None:
    sys.exit(f"{path} has no trained models; run `nvsim train --project {path}` first.")

# The camera is at the first viewpoint of the graph. Heading 0 is +y, and a positive heading turns right.
viewpoint = next(iter(graph.viewpoints.values()))
lens = nvsim.Intrinsics.from_fov(width=640, height=480, horizontal_fov=math.radians(80))
camera = nvsim.Camera(lens, nvsim.camera_pose(np.array(viewpoint.position), heading=0.0))

# Each submap has its own models. The submap nearest to the camera renders the view.
submap, view = nvsim.render_scene(scene, camera)
assert view.rgb is not None  # (480, 640, 3) float32, about 0 to 1
Image.fromarray((255 * view.rgb.clip(0, 1)).astype(np.uint8)).save("view.png")
print(f"Submap {submap} rendered the view from viewpoint {viewpoint.id} into view.png.")
