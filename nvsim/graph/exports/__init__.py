"""Exports of graphs for other programs (GraphML, GeoJSON, images), and the findings that prevent an export for R2R
agents."""

from nvsim.graph.exports.formats import Anchor, choking, left_out, refuse, write_geojson, write_graphml
from nvsim.graph.exports.picture import Groups, Key, draw

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
