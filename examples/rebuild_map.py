"""Build the navigation graph again with other thresholds: python examples/rebuild_map.py house.nvsim

The project keeps the previous graph. `nvsim restore --project house.nvsim map` restores it.
"""

import sys
from dataclasses import replace
from pathlib import Path

import nvsim

# Only one process at a time may write to a project.
with nvsim.open_project(Path(sys.argv[1]), writable=True) as project:
    before = project.need_graph()

    # The thresholds of the current graph, with a narrower robot and a stricter limit on obstacles.
    config = replace(nvsim.mapping_config(project), robot_radius=0.2, tau_alpha=0.9)

    # `reapply` decides the stored evidence again and renders only corridors that newly open.
    # Without it, the search starts from the beginning.
    nvsim.build_graph(project, config, reapply=True)
    after = project.need_graph()

print(f"Before: {len(before.viewpoints)} viewpoints and {len(before.edges)} edges.")
print(f"After: {len(after.viewpoints)} viewpoints and {len(after.edges)} edges.")
for kind, count in nvsim.compare_graphs(before, after).counts().items():
    if count:
        print(f"{kind}: {count}")
