"""NVSim's simulator under the name that agents import. Importing it also restores `base64.decodestring`, which Python
removed and Recurrent-VLN-BERT calls to read its features."""

import base64
import sys

try:
    from nvsim.r2r.simulator import SimState, Simulator, ViewPoint, cbf
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"{sys.executable} lacks the package {error.name}, which NVSim's simulator needs; install NVSim for it.",
        name=error.name,
    ) from None

if not hasattr(base64, "decodestring"):
    base64.decodestring = base64.decodebytes  # type: ignore[attr-defined]

__all__ = ["SimState", "Simulator", "ViewPoint", "cbf"]
