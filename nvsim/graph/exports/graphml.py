"""GraphML, which networkx, Gephi, yEd and igraph read, and the characters that XML allows. Formats:
http://graphml.graphdrawing.org/ and https://www.w3.org/TR/xml/#charsets"""

from __future__ import annotations

import math
import re
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.graph.types import NavGraph

_ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def legal(text: str) -> str:
    """Return `text` with control characters and lone surrogates replaced by U+FFFD."""
    return _ILLEGAL.sub("\ufffd", text)


def write_graphml(graph: NavGraph, path: Path) -> Path:
    """Write an undirected graph. Nodes: x, y, z, height (meters), included, reviewed, submap, origin, and photographed
    if it was measured. Edges: length (meters), weight (equal to length, for programs that expect it), origin, reviewed.
    Returns `path`.

    Raises InputError if an id is not valid in XML or writing fails.
    """
    import networkx as nx

    found = nx.Graph(scan=legal(graph.scan), units="metres", up="z")
    for v in graph.viewpoints.values():
        if not v.id.isprintable():
            raise InputError(f"The viewpoint id {v.id!r} is not valid in a GraphML file; rename it.")
        x, y, z = map(float, v.position)
        found.add_node(v.id, x=x, y=y, z=z, height=float(v.height), included=v.included, reviewed=v.reviewed,
                       submap=v.submap, origin=legal(v.origin))  # fmt: skip
        if v.photographed is not None:
            found.nodes[v.id]["photographed"] = float(v.photographed)
    for (a, b), e in graph.edges.items():
        length = math.dist(graph.viewpoints[a].position, graph.viewpoints[b].position)
        found.add_edge(a, b, length=length, weight=length, origin=legal(e.origin), reviewed=e.reviewed)
    with atomic.replacing(path) as temporary:
        nx.write_graphml_xml(found, temporary, encoding="utf-8", prettyprint=len(found) < 10_000)
    return path
