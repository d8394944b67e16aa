"""The database of a project: the results of its stages, its cuts into submaps, and its graph as values."""
