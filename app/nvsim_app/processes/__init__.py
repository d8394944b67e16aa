"""Side processes and threads: work that must not block the window. The only folder that starts processes."""
