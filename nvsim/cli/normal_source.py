"""Choose the normals that the map builder tests: the option of `nvsim map` and `nvsim run`, and the paper's preset."""

from __future__ import annotations

from dataclasses import replace

from nvsim.events import Listener, Log
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.families import NETWORK_NORMAL, NormalSource, with_normals
from nvsim.perception.normals_network import normals_model

FALLS_BACK = (
    "No network of surface normals is installed. The map uses the Gaussians' normals, which contain 1 - alpha, "
    "instead of the paper's network."
)


def papers() -> MappingConfig:
    """The paper's map configuration, with normals of a network if one is installed."""
    config = MappingConfig.paper()
    return config if normals_model() is None else asked(config, "network")


def asked(config: MappingConfig, source: NormalSource) -> MappingConfig:
    """`config` with the normals that the option names among its criteria."""
    return replace(config, criteria=with_normals(config.criteria, source))


def say_if_it_falls_back(config: MappingConfig, source: NormalSource, listen: Listener) -> None:
    """Reports that the paper's map is built without the network, unless the user chose this."""
    falls = "normal" in config.criteria and NETWORK_NORMAL not in config.criteria
    if falls and source == "criteria" and normals_model() is None:
        listen(Log(FALLS_BACK, "map"))
