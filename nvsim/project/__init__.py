"""The project on disk: SQLite and files, stages, what is stale, jobs. Knows no window."""
