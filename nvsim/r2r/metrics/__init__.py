"""How well a trajectory follows a task, in the metrics of R2R's evaluation, and the files that trajectories come in."""
