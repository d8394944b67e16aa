"""Shared functions of the benchmarks: timing, memory, commands, and output.

A benchmark declares its arguments as a dataclass and reads them with `tyro.cli(Arguments, description=__doc__)`.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import IO, Any, TypeVar

Result = TypeVar("Result")
_NVSIM = (sys.executable, "-m", "nvsim.cli.main")
_EVERY = 0.5  # seconds between two memory measurements


def report(figures: Mapping[str, Any], as_json: bool = False) -> None:
    """Prints the figures as one line of JSON, after a line for each of them unless `as_json`."""
    if not as_json:
        width = max(map(len, figures), default=0)
        for name, value in figures.items():
            print(f"{name:{width}} {value}")
    print(json.dumps(figures), flush=True)


def report_columns(
    figures: Mapping[str, Mapping[str, Any]],
    names: Iterable[str],
    title: str,
    as_json: bool,
    text: Callable[[Mapping[str, Any], str], object] = lambda column, name: column.get(name, "-"),
) -> None:
    """Prints the figures of several runs as one line of JSON if `as_json`. Otherwise prints a table with a column for
    each run and a row for each of the `names`. `text` gives the text of a cell."""
    if as_json:
        report(figures, as_json=True)
        return
    from nvsim.cli import terminal

    rows = [(name, *(text(column, name) for column in figures.values())) for name in names]
    terminal.table(("figure", *figures), rows, title)


def timed(work: Callable[[], Result], clock: Callable[[], float] = time.perf_counter) -> tuple[Result, float]:
    """The result of a call, and its seconds."""
    begin = clock()
    return work(), clock() - begin


def times(work: Callable[[int], object], count: int, clock: Callable[[], float] = time.perf_counter) -> list[float]:
    """Milliseconds of each call work(0), work(1), … of `count` calls."""
    return [1e3 * timed(partial(work, i), clock)[1] for i in range(count)]


def best(work: Callable[[], object], count: int, clock: Callable[[], float] = time.perf_counter) -> float:
    """Seconds of the fastest of `count` calls."""
    return min(times(lambda _: work(), count, clock)) / 1e3


def peak_gib() -> float:
    """Peak resident memory of this process, GiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def nvsim(*words: str) -> str:
    """The standard output of a command of NVSim. Raises CalledProcessError if it fails."""
    return subprocess.run([*_NVSIM, *words], check=True, stdout=subprocess.PIPE, text=True).stdout


def cost(*words: str, output: IO[str] | int = subprocess.DEVNULL) -> dict[str, float]:
    """Runs a command of NVSim as `watched` does."""
    return watched([*_NVSIM, *words], output)


def watched(command: list[str], output: IO[str] | int = subprocess.DEVNULL) -> dict[str, float]:
    """Runs a command with its standard output in `output`. Returns its seconds, and the processor seconds and GiB of
    all its processes. Raises CalledProcessError if it fails."""
    import psutil

    started = time.perf_counter()
    running = subprocess.Popen(command, stdout=output)
    most, busy, ended = 0, {}, threading.Event()

    def look() -> None:
        nonlocal most
        while not ended.wait(_EVERY):
            try:
                ours = [psutil.Process(running.pid), *psutil.Process(running.pid).children(recursive=True)]
                most = max(most, sum(p.memory_full_info().pss for p in ours))
                busy.update({p.pid: sum(p.cpu_times()[:2]) for p in ours})
            except psutil.Error:
                continue

    watching = threading.Thread(target=look)
    watching.start()
    code = running.wait()
    ended.set()
    watching.join()
    if code:
        raise subprocess.CalledProcessError(code, command)
    seconds = round(time.perf_counter() - started, 1)
    return {"seconds": seconds, "processor": round(sum(busy.values()), 1), "gib": round(most / (1 << 30), 3)}


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
