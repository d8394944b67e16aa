"""Proposals for a graph: edges along free paths, and viewpoints for floor that no viewpoint sees.

The graph is not changed; a user or a script accepts proposals.
"""

from nvsim.graph.proposals.edges import EdgeProposal, propose_edges
from nvsim.graph.proposals.places import PlaceProposal, propose_viewpoints

__all__ = ["EdgeProposal", "PlaceProposal", "propose_edges", "propose_viewpoints"]
