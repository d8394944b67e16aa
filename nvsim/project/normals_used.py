"""Tells which normals network a map was measured with, because evidence of one network is not valid for another."""

from __future__ import annotations

from dataclasses import replace

from nvsim.errors import InputError
from nvsim.graph.types import Evidence, NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.families import NETWORK_NORMAL
from nvsim.perception.normals_network import installed_normals, normals_model
from nvsim.project import ledger
from nvsim.project.project import Project

KEY = "network"
"""Key of the network in the summary of the map stage."""


def check_normals(config: MappingConfig) -> None:
    """Raises InputError if the criteria need a normals network and none is installed, the file is not such a network,
    or it cannot process the views."""
    if NETWORK_NORMAL in config.criteria:
        network = installed_normals(config.normals_model)
        if config.views == "panorama" and network.takes_rays:
            raise InputError(
                f"{config.normals_model or 'The normals network'} needs the rays of a camera and cannot process "
                "panoramas; leave --views panorama out, or name another --normals-model."
            )


def network_of(config: MappingConfig) -> str:
    """Digest of the installed network and its description; "" if the criteria need none or none is installed. Raises
    InputError if it cannot be read."""
    model = normals_model(config.normals_model) if NETWORK_NORMAL in config.criteria else None
    if model is None:
        return ""
    return model.digest()


def last_network(project: Project) -> str:
    """Digest of the network of the evidence in the project's map; "" if the evidence is not from a network."""
    last = ledger.record(project, "map")
    return "" if last is None else str(last.summary.get(KEY, ""))


def of_this_network(graph: NavGraph | None, project: Project, config: MappingConfig) -> NavGraph | None:
    """`graph` without the evidence of a network that differs from the installed one."""
    asked = network_of(config)
    if graph is None or not asked or asked == last_network(project):
        return graph
    return replace(graph, evidence={key: _unseen(evidence) for key, evidence in graph.evidence.items()})


def _unseen(evidence: Evidence) -> Evidence:
    second = evidence.second and replace(evidence.second, network_up=None)
    return replace(evidence, network_up=None, second=second)
