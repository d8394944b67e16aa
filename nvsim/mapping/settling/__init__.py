"""Settling: one usable graph from the lattices of the search."""
