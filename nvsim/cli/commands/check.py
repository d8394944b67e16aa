"""What is wrong with a capture, before any work starts: every finding with its place, severity and consequence."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from nvsim.cli.capture_argument import CapturePath
from nvsim.cli.show import as_json


@dataclass(frozen=True)
class Arguments:
    capture: CapturePath
    scale: float | None = None
    """Metres per unit of the capture, when it does not know."""
    camera_height: float | None = None
    """Metres of the cameras above the floor."""
    leave_out: str = ""
    """Names of frames that are not looked at, with commas between them."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    from nvsim.capture.check import check
    from nvsim.capture.findings import shown

    report = check(arguments.capture, arguments.scale, arguments.camera_height, arguments.leave_out)
    findings = [dataclasses.asdict(f) for f in report.findings]
    if arguments.json:
        print(as_json({"refused": report.refused, "findings": findings}))
    else:
        # Lines, not a table: a place that is cut short cannot be found.
        for f in findings:
            print(f"{f['severity']}: {shown(f['where'], 1000)}: {f['message']} ({f['consequence']})")
    if not arguments.json:
        print("The capture cannot be used as it is." if report.refused else "The capture can be used.")
    return 2 if report.refused else 0
