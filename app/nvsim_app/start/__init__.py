"""Starts the window from the command line."""
