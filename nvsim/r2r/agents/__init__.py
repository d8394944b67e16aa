"""Agents that need no network, and the loop that runs any agent through the episodes of tasks. Reads no images."""
