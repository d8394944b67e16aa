"""A person's review of tasks: accepted, rejected and rewritten ones, and tasks that do not fit an edited graph."""
