"""Whose normals the map builder asks: the flag of `nvsim map` and `nvsim run`, and what the paper's preset takes."""

from __future__ import annotations

from dataclasses import replace

from nvsim.events import Listener, Log
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.families import NETWORK_NORMAL, NormalSource, with_normals
from nvsim.perception.normals_network import normals_model

FALLS_BACK = (
    "No network of surface normals is installed: the map reads the Gaussians' normals, which contain 1 - alpha, in "
    "place of the paper's."
)


def papers() -> MappingConfig:
    """The paper's map, by a network's normals where one is installed."""
    config = MappingConfig.paper()
    return config if normals_model() is None else asked(config, "network")


def asked(config: MappingConfig, source: NormalSource) -> MappingConfig:
    """`config` with the normals that the flag names among its criteria."""
    return replace(config, criteria=with_normals(config.criteria, source))


def say_if_it_falls_back(config: MappingConfig, source: NormalSource, listen: Listener) -> None:
    """Says of the paper's map that it goes without the network, where nobody asked for that."""
    falls = "normal" in config.criteria and NETWORK_NORMAL not in config.criteria
    if falls and source == "criteria" and normals_model() is None:
        listen(Log(FALLS_BACK, "map"))
