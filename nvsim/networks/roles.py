"""What a model of each role is good for, and what else a user may install, in words."""

from __future__ import annotations

from nvsim.networks.description import Role

ROLE_WORDS: dict[Role, str] = {
    "semantic": "floor by its looks",
    "normals": "surface normals",
    "prompted": "the region at points",
}
IMPROVES: dict[Role, str] = {
    "semantic": "floor masks: holes of a scan, and captures without one (`nvsim floors --provider auto`)",
    "normals": "the paper's normals of the map (`nvsim map --normal-source network`), and floor masks of the hybrid",
    "prompted": "points while masks are corrected, and the last step of the hybrid's floor masks",
}
SINGLE_FILES = {
    "lpips": "LPIPS among the figures of `nvsim evaluate views`",
    "features": "features of views as agents read them (`nvsim export features`)",
}
"""NAME.onnx or NAME.….onnx in the models folder that plays no role of perception."""
