"""Score a trajectory with the metrics of R2R: python examples/score_trajectory.py house.nvsim"""

import sys
from pathlib import Path

import nvsim

graph = nvsim.load_graph(Path(sys.argv[1]))
start, goal = next(iter(graph.edges))

# A task is a reference path with instructions. Each instruction is an episode with the id PATH_ID_NUMBER.
task = nvsim.Task(path_id=17, scan=graph.scan, path=(start, goal), heading=0.0, instructions=("Go to the next room.",))

# The agent goes to the goal and then back. Each pose is (viewpoint id, heading, elevation), angles in radians.
trajectories = {"17_0": [(start, 0.0, 0.0), (goal, 0.0, 0.0), (start, 3.14, 0.0)]}

# Trajectory files of the R2R leaderboard: nvsim.read_trajectories(path), and nvsim.read_tasks(path) for the tasks.
distances = {graph.scan: nvsim.Distances(graph)}
nvsim.check_trajectories(trajectories, [task], distances, "this example")
scores = nvsim.score_trajectories([task], trajectories, distances)

print(f"trajectory length       {scores.pl[0]:.2f} m")
print(f"navigation error        {scores.ne[0]:.2f} m")
print(f"success, oracle success {scores.success[0]:.0f}, {scores.oracle_success[0]:.0f}")
print(f"SPL                     {scores.spl[0]:.2f}")
print(f"nDTW, sDTW              {scores.ndtw[0]:.2f}, {scores.sdtw[0]:.2f}")
