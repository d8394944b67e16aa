"""Agents that need no model, and how any agent is run through the episodes of tasks. Knows no image."""
