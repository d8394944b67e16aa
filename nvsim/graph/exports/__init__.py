"""Exports of graphs for other programs (GraphML, GeoJSON, images), and the findings that prevent an export for R2R
agents."""

from nvsim.graph.exports.formats import (
    Anchor,
    check_exportable,
    findings_that_break_agents,
    incomplete_export,
    write_geojson,
    write_graphml,
)
from nvsim.graph.exports.picture import Groups, Key, draw

__all__ = [
    "Anchor",
    "check_exportable",
    "Groups",
    "Key",
    "findings_that_break_agents",
    "draw",
    "incomplete_export",
    "write_geojson",
    "write_graphml",
]
