"""The typed messages that a long computation sends: progress, metric, preview, log, warning, worker, done, failed.

A computation takes a `Listener` and calls it with each event. The command line draws the events, `--json` prints one
line per event, and the window reads those lines. This package does not depend on any listener.
"""

from nvsim.events.messages import (
    Done,
    Event,
    Failed,
    Listener,
    Log,
    Metric,
    Preview,
    Progress,
    Warning,
    Worker,
    from_data,
    from_json,
    silent,
    to_json,
)

__all__ = [
    "Done",
    "Event",
    "Failed",
    "Listener",
    "Log",
    "Metric",
    "Preview",
    "Progress",
    "Warning",
    "Worker",
    "from_data",
    "from_json",
    "silent",
    "to_json",
]
