"""Write the files of agents that run without a simulator, from the connectivity of exported scans: candidates with view
and angles, navigable neighbors and positions, as the JSON files of VLN-DUET, NavGPT, NavGPT-2 and SAME."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.cli.show import as_json
from nvsim.cli.terminal import say


@dataclass(frozen=True)
class Arguments:
    export: Positional[Path]
    """The folder of an export (which contains connectivity/), or a folder of connectivity files with scans.txt."""
    out: Path | None = None
    """The output folder. Default: `candidates` in the export."""
    scans: tuple[str, ...] = ()
    """Scans to include. Default: all that scans.txt lists."""
    json: bool = False
    """Print the written files as JSON."""


def run(arguments: Arguments) -> int:
    from nvsim.r2r.features.candidates import write_candidates
    from nvsim.r2r.features.exported_scan import read_exported_scans

    out = arguments.out or arguments.export / "candidates"
    written = write_candidates(read_exported_scans(arguments.export, arguments.scans), out)
    if written.unseen:
        scan, a, b = written.unseen[0]
        say(
            f"warning: {len(written.unseen)} edges are vertical, so no view shows them and no file contains them "
            f"(the first in {scan} from {a} to {b}); move one end sideways with `nvsim graph edit`.",
            error=True,
        )
    if arguments.json:
        say(
            as_json(
                {
                    "written": [str(path) for path in written.paths],
                    "viewpoints": written.viewpoints,
                    "candidates": written.candidates,
                    "unseen": written.unseen,
                }
            )
        )
    else:
        say(*(f"Wrote {path}" for path in written.paths))
    return 0
