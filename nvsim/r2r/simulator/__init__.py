"""Matterport3DSimulator in Python: its states, its actions and its pictures. `matterport` is its interface."""
