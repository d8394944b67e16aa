"""Stores the graph in use in a separate file before another graph replaces it in the database."""

from __future__ import annotations

from nvsim.files.atomic import write_bytes
from nvsim.graph.store import encode_graph
from nvsim.project import results
from nvsim.project.project import Project


def graph_in_file(project: Project) -> dict[str, str]:
    """Writes the graph in use, with its edits, and returns the values for a kept result: {"graph": place}, or {} if
    there is no graph. Raises InputError if the disk reports an error."""
    graph = project.graph()
    if graph is None:
        return {}
    with project.transaction() as c:
        place = f"kept/graph.{results.new_number(c)}"
    write_bytes(project.root / place, encode_graph(graph))
    return {"graph": place}
