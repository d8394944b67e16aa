"""Kill an editing process with SIGKILL at random times, reopen its journal, and compare it with the reported states.

python tests/benchmarks/kill_editing.py [--kills 5] [--edits 200] [--viewpoints 400] [--seed 0] [--json]

The child makes random edits with undo and redo, at the speed of a busy person. After each edit it prints the number of
edits and the digest of the graph. The journal must open, and its graph must be a reported one, at most one second old.
The connectivity file that the child saves at intervals must always be complete. Exit code 1 otherwise.
"""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import tyro
from harness import json_lines, report

from nvsim.benchmarks.graph import random_graph
from nvsim.graph.connectivity import read_connectivity, write_connectivity
from nvsim.graph.edits import EditError
from nvsim.graph.history import History
from nvsim.graph.journal import Journal, sidecar
from nvsim.graph.journal_rows import fingerprint
from nvsim.graph.operations import perform_operation
from nvsim.graph.selection import selection
from nvsim.graph.types import NavGraph


@dataclass(frozen=True)
class Arguments:
    kills: int = 5
    edits: int = 200
    viewpoints: int = 400
    seed: int = 0
    json: bool = False
    child: Path | None = None
    """Edit the graph in this folder. The process that is killed is started with this option."""


def random_edit(history: History, rng: random.Random) -> bool:
    """Performs one random step: an edit, a selection, an undo, or a redo. Returns whether the step had an effect."""
    graph = history.graph
    ids = list(graph.viewpoints)
    some = rng.sample(ids, min(len(ids), rng.randint(1, 5)))
    kind = rng.randrange(14)
    if kind == 0:
        return history.undo()
    if kind == 1:
        return history.redo()
    if kind == 2 or not ids:
        history.select(selection(some))
        return True
    if kind == 3:
        return history.go_to(rng.randrange(len(history.steps)))
    name, arguments = _operation(graph, some, kind, rng)
    try:
        before = history.graph
        perform_operation(
            history, name, arguments, merge="drag" if name == "shift_viewpoints" and rng.random() < 0.5 else None
        )
    except EditError:
        return False
    return history.graph is not before


def _operation(graph: NavGraph, some: list[str], kind: int, rng: random.Random) -> tuple[str, dict[str, object]]:
    x, y, z = graph.viewpoints[some[0]].position
    keys = [(some[0], other) for other in graph.neighbors(some[0])]
    place = [x + rng.uniform(-2, 2), y + rng.uniform(-2, 2), z]
    if kind == 4:
        return "add_viewpoint", {"position": place, "height": rng.choice([1.2, 1.5])}
    if kind == 5 and keys:
        return "split_edge", {"edge": list(keys[0]), "share": rng.uniform(0.1, 0.9)}
    if kind == 6:
        return "remove_viewpoints", {"ids": some[:2]}
    if kind == 7:
        return "merge_viewpoints", {"ids": some, "middle": rng.random() < 0.5}
    if kind == 8 and keys:
        return "remove_edges", {"pairs": [list(key) for key in keys[:2]]}
    if kind == 9:
        return "add_edges", {"pairs": [[some[0], some[-1]]]}
    if kind == 10:
        return "lock", {"viewpoints": some[:1], "edges": [list(k) for k in keys[:1]], "locked": rng.random() < 0.3}
    if kind == 11:
        return "mark_reviewed", {"viewpoints": some, "edges": [list(k) for k in keys]}
    if kind == 12:
        return "include", {"ids": some, "included": rng.random() < 0.5}
    return "shift_viewpoints", {"ids": some, "by": [rng.uniform(-1, 1), rng.uniform(-1, 1), 0.0]}


def steps(history: History, edits: int, seed: int, save: Callable[[], None]) -> Iterator[tuple[int, float]]:
    """Makes random edits, determined by the seed. Yields the number of edits and the seconds to wait after each."""
    rng, made = random.Random(seed), 0
    while made < edits:
        made += random_edit(history, rng)
        rest = rng.uniform(0.0, 0.04)
        yield made, rest
        if made % 50 == 0:
            save()


def child(folder: Path, edits: int, seed: int) -> None:
    file = folder / "bench_connectivity.json"
    journal = Journal.open(sidecar(file), plain=True)
    history: History = journal.history(read_connectivity(file))

    def save() -> None:
        journal.flush()
        write_connectivity(history.graph, folder)
        history.mark_saved()

    made = 0
    # A child that dies before the first write of the journal leaves its initial graph.
    print(json.dumps({"made": 0, "at": time.time(), "graph": fingerprint(history.graph)}), flush=True)
    for made, rest in steps(history, edits, seed, save):
        print(json.dumps({"made": made, "at": time.time(), "graph": fingerprint(history.graph)}), flush=True)
        time.sleep(rest)
    journal.flush()
    print(json.dumps({"made": made, "at": time.time(), "graph": fingerprint(history.graph), "end": True}), flush=True)
    time.sleep(60)  # wait to be killed, also if all edits are done


def unsaid(graph: NavGraph, said: int, edits: int, seed: int) -> set[str]:
    """Digests of the graphs right after the first `said` reported ones. The journal may write an edit shortly before
    the child reports it."""
    history, found = History(graph), set[str]()
    for number, _ in enumerate(steps(history, edits, seed, history.mark_saved)):
        if number >= said:
            found.add(fingerprint(history.graph))
        if number > said:
            break
    return found


def one(kill_after: float, count: int, edits: int, seed: int) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file = write_connectivity(random_graph(count, seed=seed), folder)
        first = read_connectivity(file)
        argv = [sys.executable, __file__, "--child", name, "--edits", str(edits), "--seed", str(seed)]
        process = subprocess.Popen(argv, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        said = [json.loads(process.stdout.readline())]
        time.sleep(kill_after)
        killed = time.time()
        process.send_signal(signal.SIGKILL)
        said += json_lines(process.stdout)
        process.wait()
        started = time.perf_counter()
        saved = read_connectivity(file)
        with Journal.open(sidecar(file), plain=True) as journal:
            history = journal.history(saved)
            mine = fingerprint(history.graph)
            recovered = journal.recovered
            seconds = time.perf_counter() - started
        known = [line for line in said if line["graph"] == mine]
        if not known:
            if mine not in unsaid(first, len(said) - 1, edits, seed):
                raise SystemExit(f"the restored graph is not a graph of the child (seed {seed})")
            known = said
        lost = [line for line in said if line["made"] > known[-1]["made"]]
        age = killed - lost[0]["at"] if lost else 0.0
        return {
            "made": said[-1]["made"],
            "steps": len(history.steps) - 1,
            "unsaved_recovered": recovered,
            "lost_edits": said[-1]["made"] - known[-1]["made"],
            "lost_s": round(max(0.0, age), 3),
            "reopen_s": round(seconds, 3),
        }


def main() -> int:
    options = tyro.cli(Arguments, description=__doc__)
    if options.child is not None:
        child(options.child, options.edits, options.seed)
        return 0
    rng = random.Random(options.seed)
    runs = []
    for number in range(options.kills):
        run = one(rng.uniform(0.3, 4.0), options.viewpoints, options.edits, options.seed + number)
        runs.append(run)
        if not options.json:
            print(run)
    worst = max(run["lost_s"] for run in runs)
    result = {"kills": len(runs), "worst_lost_s": worst, "worst_lost_edits": max(r["lost_edits"] for r in runs),
              "slowest_reopen_s": max(r["reopen_s"] for r in runs), "files_whole": True}  # fmt: skip
    report(result, options.json)
    return 0 if worst <= 1.0 else 1


if __name__ == "__main__":
    sys.exit(main())
