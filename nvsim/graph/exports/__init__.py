"""Exports of graphs for other programs (GraphML, GeoJSON, images), and the findings that prevent an export for R2R
agents."""

from nvsim.graph.exports.formats import (
    GeoAnchor,
    check_exportable,
    findings_that_break_agents,
    incomplete_export,
    write_geojson,
    write_graphml,
)
from nvsim.graph.exports.picture import ColorGroups, LegendRow, draw

__all__ = [
    "GeoAnchor",
    "check_exportable",
    "ColorGroups",
    "LegendRow",
    "findings_that_break_agents",
    "draw",
    "incomplete_export",
    "write_geojson",
    "write_graphml",
]
