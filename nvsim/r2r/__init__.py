"""Room-to-Room (R2R) scans, tasks, features, agents, metrics, and the simulator that runs agents on them."""
