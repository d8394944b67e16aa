"""Matterport3DSimulator's Python module for exported scans. Importing it also restores `base64.decodestring`, which
readers of R2R's feature files use and Python 3.9 removed."""

import base64

from MatterSim.r2r.simulator.cross_bilateral import cbf
from MatterSim.r2r.simulator.scan import NavGraph
from MatterSim.r2r.simulator.simulator import Simulator
from MatterSim.r2r.simulator.state import SimState, ViewPoint

__all__ = ["NavGraph", "SimState", "Simulator", "ViewPoint", "cbf"]

if not hasattr(base64, "decodestring"):
    base64.decodestring = base64.decodebytes
