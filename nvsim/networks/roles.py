"""The purpose of a model of each role, and of other installable models, as text for users."""

from __future__ import annotations

from nvsim.networks.description import Role

ROLE_WORDS: dict[Role, str] = {
    "semantic": "floor segmentation",
    "normals": "surface normals",
    "prompted": "segmentation at points",
}
IMPROVES: dict[Role, str] = {
    "semantic": "floor masks: holes of a scan, and captures without one (`nvsim floors --provider auto`)",
    "normals": "the paper's normals of the map (`nvsim map --normal-source network`), and hybrid floor masks",
    "prompted": "corrections of masks by points, and the last step of hybrid floor masks",
}
SINGLE_FILES = {
    "lpips": "LPIPS among the metrics of `nvsim evaluate views`",
    "features": "image features in the files that agents read (`nvsim export features`)",
}
"""Files NAME.onnx or NAME.….onnx in the models folder that have no role in perception."""
