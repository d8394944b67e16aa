"""What an agent or a user would trip over in a graph, found for a whole graph or followed from edit to edit.

Knows no files and no pixels: what only others can say comes in through `Context`.
"""

from nvsim.graph.findings.check import check_graph
from nvsim.graph.findings.context import Context, Limits
from nvsim.graph.findings.types import BLOCKS_EXPORT, SEVERITIES, Finding, Fix
from nvsim.graph.findings.validator import Validator

__all__ = ["BLOCKS_EXPORT", "SEVERITIES", "Context", "Finding", "Fix", "Limits", "Validator", "check_graph"]
