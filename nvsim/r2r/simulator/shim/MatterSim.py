"""NVSim's simulator under the name that agents import."""

from nvsim.r2r.simulator import SimState, Simulator, ViewPoint, cbf

__all__ = ["SimState", "Simulator", "ViewPoint", "cbf"]
