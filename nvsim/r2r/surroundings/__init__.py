"""Detects the surroundings of the viewpoints of an exported scan in its images: objects, doorways, corridors, floors.

Independent of paths and instructions.
"""
