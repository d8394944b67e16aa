"""What the benchmarks share: timing, memory, commands, and output.

A benchmark declares its arguments as a dataclass and reads them with `tyro.cli(Arguments, description=__doc__)`.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from typing import IO, Any


def report(figures: Mapping[str, Any], as_json: bool = False) -> None:
    """Prints the figures as one line of JSON, after a line for each of them unless `as_json`."""
    if not as_json:
        width = max(map(len, figures), default=0)
        for name, value in figures.items():
            print(f"{name:{width}} {value}")
    print(json.dumps(figures), flush=True)


def times(work: Callable[[int], object], count: int, clock: Callable[[], float] = time.perf_counter) -> list[float]:
    """Milliseconds of each call work(0), work(1), … of `count` calls."""
    found = []
    for i in range(count):
        begin = clock()
        work(i)
        found.append(1e3 * (clock() - begin))
    return found


def best(work: Callable[[], object], count: int, clock: Callable[[], float] = time.perf_counter) -> float:
    """Seconds of the fastest of `count` calls."""
    return min(times(lambda _: work(), count, clock)) / 1e3


def peak_gib() -> float:
    """Peak resident memory of this process, GiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def nvsim(*words: str) -> str:
    """The standard output of a command of NVSim. Raises CalledProcessError if it fails."""
    command = [sys.executable, "-m", "nvsim.cli.main", *words]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def evaluated(what: str, *words: str) -> dict[str, Any]:
    """The figures of `nvsim evaluate`. Raises CalledProcessError if the command fails, and ValueError or IndexError if
    it prints no figures."""
    found: dict[str, Any] = json.loads(nvsim("evaluate", what, *words, "--json").splitlines()[-1])
    return found


def json_lines(stream: IO[str]) -> Iterator[dict[str, Any]]:
    """The JSON objects of a process, one in each line. Other lines are skipped, also one that a kill cut off."""
    for line in stream:
        if line.startswith("{") and line.endswith("}\n"):
            yield json.loads(line)
