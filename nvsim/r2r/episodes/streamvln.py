"""Episodes as StreamVLN's trajectories: `annotations.json`, an array of {id, video, instructions, actions}.

Format: InternRobotics' StreamVLN trajectory data. actions[i] is the action that leads to frame i, and -1 for the first
frame; 1 is 0.25 m forward, 2 and 3 are 15 degrees left and right. The loader adds a stop after the last action. `video`
is the folder that contains the frames as rgb/000.jpg and so on.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from nvsim.files import atomic
from nvsim.r2r.episodes.episode import Episode

_BEGIN = -1


def write_streamvln(episodes: Mapping[str, Sequence[Episode]], folder: Path) -> list[Path]:
    """Writes `SPLIT/annotations.json` for every split and returns the paths. Raises InputError if writing fails."""
    written = []
    for name, split in episodes.items():
        lines = ",\n".join(json.dumps(_item(episode)) for episode in split)
        written.append(folder / name / "annotations.json")
        atomic.write_text(written[-1], f"[\n{lines}\n]\n" if lines else "[]\n")
    return written


def _item(episode: Episode) -> dict[str, Any]:
    task = episode.task
    return {
        "id": task.path_id,
        "video": f"images/{task.scan}_r2r_{task.path_id:06d}",
        "instructions": list(task.instructions),
        "actions": [_BEGIN, *episode.walk.actions[:-1]],
    }
