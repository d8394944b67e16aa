"""Graph files for other programs: GraphML and GeoJSON, and the finding that prevents an export for R2R programs.

GraphML: http://graphml.graphdrawing.org/ and https://www.w3.org/TR/xml/#charsets

GeoJSON (RFC 7946) requires longitude and latitude. Without an anchor on the earth, the coordinates are local meters,
and the file says so.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.graph.findings import BLOCKS_EXPORT, Context, Finding, check_graph
from nvsim.graph.types import NavGraph

_ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def without_control_characters(text: str) -> str:
    """Return `text` with control characters and lone surrogates replaced by U+FFFD."""
    return _ILLEGAL.sub("\ufffd", text)


def write_graphml(graph: NavGraph, path: Path) -> Path:
    """Write an undirected graph. Nodes: x, y, z, height (meters), included, reviewed, submap, origin, and photographed
    if it was measured. Edges: length (meters), weight (equal to length, for programs that expect it), origin, reviewed.
    Returns `path`.

    Raises InputError if an id is not valid in XML or writing fails.
    """
    import networkx as nx

    found = nx.Graph(scan=without_control_characters(graph.scan), units="metres", up="z")
    for v in graph.viewpoints.values():
        if not v.id.isprintable():
            raise InputError(f"The viewpoint id {v.id!r} is not valid in a GraphML file; rename it.")
        x, y, z = map(float, v.position)
        found.add_node(v.id, x=x, y=y, z=z, height=float(v.height), included=v.included, reviewed=v.reviewed,
                       submap=v.submap, origin=without_control_characters(v.origin))  # fmt: skip
        if v.photographed is not None:
            found.nodes[v.id]["photographed"] = float(v.photographed)
    for (a, b), e in graph.edges.items():
        length = math.dist(graph.viewpoints[a].position, graph.viewpoints[b].position)
        found.add_edge(
            a, b, length=length, weight=length, origin=without_control_characters(e.origin), reviewed=e.reviewed
        )
    with atomic.replacement_file(path) as temporary:
        nx.write_graphml_xml(found, temporary, encoding="utf-8", prettyprint=len(found) < 10_000)
    return path


_A, _E2 = 6378137.0, 6.69437999014e-3  # WGS 84: equatorial radius in meters, first eccentricity squared
_LOCAL = "Coordinates are local meters (x, y, z up), not longitude and latitude."


@dataclass(frozen=True)
class GeoAnchor:
    """The position on the earth of the origin of the graph's frame: degrees, WGS 84. `altitude` is in meters. `bearing`
    is the direction of the frame's +y axis in degrees clockwise from north. Raises InputError if a value is out of
    range."""

    latitude: float
    longitude: float
    altitude: float = 0.0
    bearing: float = 0.0

    def __post_init__(self) -> None:
        values = (self.latitude, self.longitude, self.altitude, self.bearing)
        if not all(map(math.isfinite, values)) or abs(self.latitude) >= 90 or abs(self.longitude) > 180:
            raise InputError(
                f"The anchor is not valid: latitude {self.latitude}, longitude {self.longitude}; give degrees, "
                "-90 to 90 and -180 to 180."
            )

    def place(self, x: float, y: float, z: float) -> list[float]:
        """Return longitude and latitude (degrees) and height (meters) of a point on the tangent plane of the ellipsoid.
        The error is some centimeters at a distance of one kilometer."""
        turn = math.radians(self.bearing)
        east = x * math.cos(turn) + y * math.sin(turn)
        north = y * math.cos(turn) - x * math.sin(turn)
        latitude = math.radians(self.latitude)
        w = 1.0 - _E2 * math.sin(latitude) ** 2
        meridian, prime = _A * (1.0 - _E2) / w**1.5, _A / math.sqrt(w)
        lon = self.longitude + math.degrees(east / (prime * math.cos(latitude)))
        return [round(lon, 9), round(self.latitude + math.degrees(north / meridian), 9), round(self.altitude + z, 4)]


def write_geojson(graph: NavGraph, path: Path, anchor: GeoAnchor | None = None) -> Path:
    """Write a FeatureCollection and return `path`. Raises InputError if writing fails."""

    def coordinates(id: str) -> list[float]:
        x, y, z = map(float, graph.viewpoints[id].position)
        return [x, y, z] if anchor is None else anchor.place(x, y, z)

    note = _LOCAL if anchor is None else "Longitude, latitude and height, WGS 84."
    features: list[dict[str, Any]] = []
    for v in graph.viewpoints.values():
        properties = {"kind": "viewpoint", "height": v.height, "included": v.included, "origin": v.origin,
                      "reviewed": v.reviewed, "note": note}  # fmt: skip
        if v.photographed is not None:
            properties["photographed"] = v.photographed
        features.append(_feature(v.id, {"type": "Point", "coordinates": coordinates(v.id)}, properties))
    for (a, b), e in graph.edges.items():
        length = math.dist(graph.viewpoints[a].position, graph.viewpoints[b].position)
        properties = {"kind": "edge", "from": a, "to": b, "length": round(length, 4), "origin": e.origin,
                      "reviewed": e.reviewed, "note": note}  # fmt: skip
        features.append(
            _feature(f"{a} {b}", {"type": "LineString", "coordinates": [coordinates(a), coordinates(b)]}, properties)
        )
    collection = {"type": "FeatureCollection", "scan": graph.scan, "note": note, "features": features}
    atomic.write_text(path, json.dumps(collection, separators=(",", ":")) + "\n")
    return path


def _feature(id: str, geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "id": id, "geometry": geometry, "properties": properties}


class RefusedExport(InputError):
    """A refused export. The message contains the fix; `reason` is the message without it."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason}; fix this, or write the files anyway with --force.")
        self.reason = reason


def findings_that_break_agents(graph: NavGraph, context: Context | None = None) -> list[Finding]:
    """Return the findings that break programs for R2R files, except those that a user ignores for a reason."""
    found = check_graph(graph, context or Context())
    return [f for f in found if f.kind in BLOCKS_EXPORT and f.severity == "error" and f.key not in graph.ignored]


def check_exportable(graph: NavGraph, context: Context | None = None) -> None:
    """Check a graph before an export. Raises Refusal with the first finding that breaks agents, and their number."""
    found = findings_that_break_agents(graph, context)
    if found:
        more = f" (and {len(found) - 1} more that `nvsim graph check` lists)" if len(found) > 1 else ""
        raise RefusedExport(f"{found[0].message.rstrip('.')}{more}")


def incomplete_export(failures: Mapping[str, InputError], count: int) -> InputError:
    """Return one error for the scans that could not be written, by name. `count` is the number of all scans."""
    reasons = [
        f"{scan}: {error.reason if isinstance(error, RefusedExport) else str(error).rstrip('.')}"
        for scan, error in failures.items()
    ]
    sentence = f"{len(failures)} of {count} scans were not written ({'; '.join(reasons)}); fix this"
    if any(isinstance(error, RefusedExport) for error in failures.values()):
        sentence += ", or write them anyway with --force"
    return InputError(f"{sentence}.")
