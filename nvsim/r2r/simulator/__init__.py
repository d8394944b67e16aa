"""Matterport3DSimulator's interface in Python, with images from skybox strips or from the trained models of a project.

Does not import Qt, and imports torch only when a project is opened.
"""

from nvsim.r2r.simulator.cross_bilateral import cbf
from nvsim.r2r.simulator.scan import NavGraph
from nvsim.r2r.simulator.simulator import Simulator
from nvsim.r2r.simulator.state import SimState, ViewPoint

__all__ = ["NavGraph", "SimState", "Simulator", "ViewPoint", "cbf"]
