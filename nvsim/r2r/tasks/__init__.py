"""Paths through scans with instructions: selects, spreads and splits them, and writes R2R files.

Independent of agents and images.
"""
