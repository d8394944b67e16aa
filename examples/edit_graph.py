"""Edit a navigation graph and write it for agents: python examples/edit_graph.py house.nvsim

Writes the edited graph as R2R connectivity into the folder `edited`. The project does not change.
"""

import sys
from pathlib import Path

import nvsim

graph = nvsim.load_graph(Path(sys.argv[1]))  # a project, or a file SCAN_connectivity.json
a, b = next(iter(graph.edges))

# An edit is a function from a graph to a new graph. The old graph does not change.
edited = nvsim.split_edge(graph, a, b)
(middle,) = edited.viewpoints.keys() - graph.viewpoints.keys()
x, y, z = edited.viewpoints[middle].position
edited = nvsim.move_viewpoint(edited, middle, (x + 0.1, y, z))

# Edits also have names, as in `nvsim graph edit`.
edited = nvsim.edit_graph(edited, "mark_reviewed", {"viewpoints": [middle]})

# An edit that the graph does not allow raises an error with the reason.
try:
    nvsim.remove_edge(edited, a, b)
except nvsim.EditError as error:
    print(f"Refused: {error}")

for deviation in nvsim.compare_graphs(graph, edited).deviations:
    print(deviation.words)
for finding in nvsim.check_graph(edited):
    print(f"{finding.severity}: {finding.message}")

# To save the edited graph in the project, call `project.set_graph(edited)` on a writable project.
print("Written:", nvsim.write_connectivity(edited, Path("edited")))
