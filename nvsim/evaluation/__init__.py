"""The figures of views, floor masks and graphs, against a truth. Each is one function and one command."""
