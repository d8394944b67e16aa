"""A tasks file together with the scans that its tasks use, read and checked against each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from nvsim.errors import InputError
from nvsim.graph.connectivity import read_connectivity, scan_files
from nvsim.graph.types import NavGraph
from nvsim.r2r.metrics.distances import Distances, check_tasks
from nvsim.r2r.tasks.task import Task
from nvsim.r2r.tasks.task_files import read_tasks


@dataclass(frozen=True, eq=False)
class Benchmark:
    """A set of tasks and the graphs of their scans.

    folder   contains scans.txt and the connectivity files
    graphs   scan id -> graph, for every scan that has a task
    """

    folder: Path
    tasks: Sequence[Task]
    graphs: Mapping[str, NavGraph]

    @staticmethod
    def read(scans: Path, tasks: Path) -> Benchmark:
        """Reads a scans folder and a tasks file.

        Raises InputError if a file is unreadable, there are no tasks, or a path is not in its graph.
        """
        found = read_tasks(tasks)
        if not found:
            raise InputError(f"{tasks} has no paths; export tasks again with paths in this split.")
        files = scan_files(scans, list(dict.fromkeys(task.scan for task in found)))
        graphs = {scan: read_connectivity(path) for scan, path in files.items()}
        benchmark = Benchmark(next(iter(files.values())).parent, found, graphs)
        check_tasks(found, benchmark.distances, tasks)
        return benchmark

    @cached_property
    def distances(self) -> Mapping[str, Distances]:
        """scan id -> distances in meters between the viewpoints of the scan"""
        return {scan: Distances(graph) for scan, graph in self.graphs.items()}
