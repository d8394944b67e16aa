"""The typed messages a long computation sends: progress, metric, preview, log, warning, worker, done, failed.

A computation takes a `Listener` and calls it; the command line draws it, `--json` prints one line per event, the window
reads those lines. Knows nothing of who listens.
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
