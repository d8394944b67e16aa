"""The README.md in the folder of an agent: its files, and the commands that run and score the agent."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim import __version__

if TYPE_CHECKING:
    from nvsim.dataset.agent_files import Agent


def readme(agent: Agent, folder: Path, evaluated: tuple[Path, Path], val: str, count: int) -> str:
    """The text of README.md in `folder`.

    evaluated  the folder of the scans, and the task file of the split that the commands evaluate
    val        name of that split, with `count` instructions
    """

    def filled(line: str) -> str:
        return line.replace("{val}", val).replace("{count}", str(count))

    commands = [filled(line) for line in (agent.submits, *agent.run) if line]
    has_out = any("$OUT" in line for line in (*commands, agent.results))
    notes = list(agent.notes)
    if agent.submits:
        notes.append("The agent also opens a split `test` when it writes trajectories. The copy replaces it.")
    lines = [
        f"# Files for {agent.title}",
        "",
        f"Made by NVSim {__version__} with `nvsim export dataset`. Large files are hard links to files of the dataset.",
        "",
        *(f"- `{pattern}`" for pattern in agent.files),
        "",
        *_split_names(agent),
        f"Run the agent with these commands. CHECKOUT is the absolute path of the folder of {agent.title}"
        + (", and OUT that of a folder for its results:" if has_out else ":"),
        "",
        "```bash",
        "CHECKOUT=... OUT=..." if has_out else "CHECKOUT=...",
        f"FOLDER={shlex.quote(str(folder.absolute()))}",
        *commands,
        "```",
        "",
        f"What ran without changes to the code of the agent: {agent.ran}.",
        "",
        *(f"- {note}" for note in notes),
        "",
    ]
    if agent.results:
        scans, tasks = (shlex.quote(str(path.absolute())) for path in evaluated)
        score = f"nvsim evaluate r2r --scans {scans} --tasks {tasks} --submission {filled(agent.results)}"
        lines += ["Score the trajectories of the agent with the metrics of R2R:", "", "```bash", score, "```", ""]
    text = "\n".join(lines)
    return text.replace("{split}", "SPLIT").replace("{steps}", "SPLIT").replace("{scan}", "SCAN")


def _split_names(agent: Agent) -> list[str]:
    """The lines that explain SPLIT, if the name of a file contains a split."""
    patterns = " ".join(agent.files)
    if "{split}" in patterns:
        return ["SPLIT is train, val_train_seen (paths of train), val_seen, or val_unseen.", ""]
    return ["SPLIT is train, val_seen, or val_unseen.", ""] if "{steps}" in patterns else []
