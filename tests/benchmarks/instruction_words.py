"""Print the statistics of the instructions in folders of tasks, beside those of R2R.

python -m tests.benchmarks.instruction_words TASKS [TASKS ...]
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from nvsim.cli.terminal import table
from nvsim.files.opening import read_json
from nvsim.r2r.instructions.statistics import statistics_of, table_of
from nvsim.r2r.reviewing import read_folder
from nvsim.r2r.tasks.exporting import RECORD


@dataclass(frozen=True)
class Arguments:
    tasks: tyro.conf.Positional[tuple[Path, ...]]


def main() -> None:
    for folder in tyro.cli(Arguments, description=__doc__).tasks:
        texts = [text for entry in read_folder(folder).entries for text in entry.task.instructions]
        said = read_json(folder / RECORD, "a tasks record", "name a folder of tasks")["instructions"]
        followed = said["found_again"] / said["paths"] if said.get("paths") else None
        table((folder.name, "value", "R2R"), table_of(statistics_of(texts), followed), said.get("register", ""))


if __name__ == "__main__":
    main()
