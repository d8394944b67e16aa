"""The page of the Python interface: the names that a notebook imports, with their docstrings (mkdocstrings)."""

from __future__ import annotations

from itertools import groupby

# section, name, members to show: none shows the docstring alone
SHOWN: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    (
        "Projects",
        "nvsim.project.project.Project",
        ("open", "create_or_open", "close", "need_capture", "need_submaps", "need_graph", "scan", "scene", "occupancy"),
    ),
    ("Projects", "nvsim.project.pipeline.run", ()),
    ("Projects", "nvsim.project.config.CaptureConfig", ()),
    ("Projects", "nvsim.project.config.RunConfig", ()),
    ("Projects", "nvsim.building.BuildingConfig", ()),
    ("Projects", "nvsim.building.generate", ()),
    ("Graphs", "nvsim.graph.types.NavGraph", ("adjacency", "neighbours")),
    ("Graphs", "nvsim.graph.types.Viewpoint", ()),
    ("Graphs", "nvsim.graph.types.Edge", ()),
    ("Graphs", "nvsim.graph.types.edge", ()),
    ("Graphs", "nvsim.graph.connectivity.read_connectivity", ()),
    ("Graphs", "nvsim.graph.connectivity.write_connectivity", ()),
    ("Graphs", "nvsim.graph.expression.by_expression", ()),
    ("Graphs", "nvsim.graph.difference.difference", ()),
    ("Graphs", "nvsim.graph.compare.compare", ()),
    ("Edits of graphs", "nvsim.graph.edits.edges.add_edges", ()),
    ("Edits of graphs", "nvsim.graph.edits.edges.remove_edges", ()),
    ("Edits of graphs", "nvsim.graph.edits.edges.connect_visible", ()),
    ("Edits of graphs", "nvsim.graph.edits.viewpoints.add_viewpoint", ()),
    ("Edits of graphs", "nvsim.graph.edits.viewpoints.remove_viewpoints", ()),
    ("Edits of graphs", "nvsim.graph.edits.viewpoints.set_included", ()),
    ("Edits of graphs", "nvsim.graph.edits.moving.move_viewpoints", ()),
    ("Edits of graphs", "nvsim.graph.edits.viewpoints.merge_viewpoints", ()),
    ("Edits of graphs", "nvsim.graph.edits.viewpoints.split_edge", ()),
    ("Views", "nvsim.splats.scene.SceneModel", ("nearest", "model_at")),
    ("Views", "nvsim.render.scene.render_scene", ()),
    ("Views", "nvsim.render.panorama.render_cube", ()),
    ("Views", "nvsim.render.panorama.render_equirectangular", ()),
    ("Views", "nvsim.render.autograd.rasterize", ()),
    ("Figures", "nvsim.evaluation.graph.evaluate_graph", ()),
)


def python_page() -> str:
    """The page in Markdown. The simulator has its own page."""
    lines = [
        "# Python",
        "",
        "The names that a notebook imports. Their text comes from the docstrings. [The simulator](../simulator.md) and "
        "[editing without a window](../editing.md#without-a-window) have examples.",
        "",
    ]
    for section, rows in groupby(SHOWN, key=lambda row: row[0]):
        lines += [f"## {section}", ""]
        for _, name, members in rows:
            shown = "[" + ", ".join(members) + "]" if members else "false"
            lines += [f"::: {name}", "    options:", f"      members: {shown}", ""]
    return "\n".join(lines)
