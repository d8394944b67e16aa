"""Exports of graphs for other programs (GraphML, GeoJSON, images), and the findings that prevent an export for R2R
agents."""

from nvsim.graph.exports.geojson import Anchor, write_geojson
from nvsim.graph.exports.graphml import write_graphml
from nvsim.graph.exports.picture import Groups, Key, draw
from nvsim.graph.exports.refusal import choking, left_out, refuse

__all__ = [
    "Anchor",
    "Groups",
    "Key",
    "choking",
    "draw",
    "left_out",
    "refuse",
    "write_geojson",
    "write_graphml",
]
