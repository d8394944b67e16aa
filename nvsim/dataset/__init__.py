"""A building as a benchmark: its tasks with what is seen along them, and scan, features, tasks and baselines by one
command. Knows no command line."""
