"""Side processes: work that must not block the window. The only folder that starts processes."""
