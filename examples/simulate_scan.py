"""Export a project as a scan and load it with the simulator: python examples/simulate_scan.py house.nvsim

Writes the scan into the folder `scans`. It has the file layout of Matterport3D, so other simulators can load it too.
"""

import math
import sys
from pathlib import Path

import nvsim

folder = Path("scans")
with nvsim.open_project(Path(sys.argv[1])) as project:
    # Small images for a quick test; by default, a face of a skybox has 512 x 512 pixels.
    settings = nvsim.ScanSettings(size=128, plans=False)
    (scan,) = nvsim.export_scan(project, folder, settings=settings)

# The methods are those of Matterport3DSimulator.
sim = nvsim.Simulator()
sim.setNavGraphPath(folder / "connectivity")
sim.setDatasetPath(folder)
sim.setCameraResolution(320, 240)
sim.setCameraVFOV(math.radians(60))
sim.setRestrictedNavigation(False)  # all neighbors are navigable, also those behind the camera
sim.newRandomEpisode(scan.scan)

for _ in range(3):
    state = sim.getState()  # state.rgb is (240, 320, 3) uint8: blue, green, red
    print(f"Step {state.step}: viewpoint {state.location.viewpointId}, image {state.rgb.shape}")
    # Location 0 is the current viewpoint, and location 1 is the neighbor nearest to the image center.
    nearest = min(1, len(state.navigableLocations) - 1)
    sim.makeAction(nearest, math.radians(30), 0.0)
sim.close()
