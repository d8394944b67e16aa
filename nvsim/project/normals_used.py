"""Which network of normals a map was measured with: evidence of one is no answer of another."""

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
"""Of the map's summary."""


def check_normals(config: MappingConfig) -> None:
    """Raises InputError where the criteria ask for a network of normals and none is installed, it is none, or it cannot
    see the views."""
    if NETWORK_NORMAL in config.criteria:
        network = installed_normals(config.normals_model)
        if config.views == "panorama" and network.takes_rays:
            raise InputError(
                f"{config.normals_model or 'The network of normals'} takes the rays of a camera and cannot see "
                "panoramas; leave --views panorama out, or name another --normals-model."
            )


def network_of(config: MappingConfig) -> str:
    """What tells the installed network, with what is said beside it, from others; "" where none is asked or there is
    none. Raises InputError where it cannot be read."""
    model = normals_model(config.normals_model) if NETWORK_NORMAL in config.criteria else None
    if model is None:
        return ""
    return model.digest()


def last_network(project: Project) -> str:
    """As `network_of`, of what the evidence of the project's map holds; "" where it holds nothing of one."""
    last = ledger.record(project, "map")
    return "" if last is None else str(last.summary.get(KEY, ""))


def of_this_network(graph: NavGraph | None, project: Project, config: MappingConfig) -> NavGraph | None:
    """`graph` without what another network than the installed one has seen, as the last build of the map says."""
    asked = network_of(config)
    if graph is None or not asked or asked == last_network(project):
        return graph
    return replace(graph, evidence={key: _unseen(evidence) for key, evidence in graph.evidence.items()})


def _unseen(evidence: Evidence) -> Evidence:
    second = evidence.second and replace(evidence.second, network_up=None)
    return replace(evidence, network_up=None, second=second)
