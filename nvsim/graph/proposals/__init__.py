"""Proposals for a graph: edges where the way is free, viewpoints where no other sees the floor.

It only proposes; a user, or a script, takes what is right.
"""

from nvsim.graph.proposals.edges import EdgeProposal, propose_edges
from nvsim.graph.proposals.places import PlaceProposal, propose_viewpoints

__all__ = ["EdgeProposal", "PlaceProposal", "propose_edges", "propose_viewpoints"]
