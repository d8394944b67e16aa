"""The project on disk: database and files, stages, outdated results, and jobs. Independent of the window."""
