"""Findings: problems of a graph for agents or users, computed for a whole graph or updated after each edit.

This package reads no files and no images. Information from other sources comes in through `Context`.
"""

from nvsim.graph.findings.check import Validator, check_graph
from nvsim.graph.findings.context import BLOCKS_EXPORT, SEVERITIES, Context, Finding, Fix, Limits

__all__ = ["BLOCKS_EXPORT", "SEVERITIES", "Context", "Finding", "Fix", "Limits", "Validator", "check_graph"]
