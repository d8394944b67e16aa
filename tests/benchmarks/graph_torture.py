"""Run random sequences of edits, selections, undo, redo, save, and reopen, and test the rules of the graph editor.

python tests/benchmarks/graph_torture.py [--steps 10000] [--json]

The rules are those of tests/unit/test_graph_machine.py. If a rule is broken, the benchmark ends with the shortest
sequence that breaks it and exit code 1.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import tyro
from harness import report
from hypothesis import HealthCheck, settings
from hypothesis.stateful import run_state_machine_as_test

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))
from test_graph_machine import EditorMachine

_LENGTH = 60  # steps of a sequence


@dataclass(frozen=True)
class Arguments:
    steps: int = 10_000
    json: bool = False


class Counted(EditorMachine):
    made = 0

    def teardown(self) -> None:
        type(self).made += self.count
        super().teardown()

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def check_invariants(self, *arguments: object, **options: object) -> None:
        self.count += 1
        super().check_invariants(*arguments, **options)


def main() -> None:
    options = tyro.cli(Arguments, description=__doc__)
    started = time.perf_counter()
    while Counted.made < options.steps:
        left = options.steps - Counted.made
        run_state_machine_as_test(
            Counted,
            settings=settings(
                max_examples=max(1, min(50, left // _LENGTH + 1)),
                stateful_step_count=_LENGTH,
                deadline=None,
                database=None,
                suppress_health_check=list(HealthCheck),
            ),
        )
    report({"steps": Counted.made, "broken": 0, "seconds": round(time.perf_counter() - started, 1)}, options.json)


if __name__ == "__main__":
    main()
