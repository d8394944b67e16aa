"""The tasks of a file with the scans that they lie in, read and checked against each other."""

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
    """folder   of scans.txt and the connectivity files
    graphs   scan id -> graph, of the scans that tasks lie in
    """

    folder: Path
    tasks: Sequence[Task]
    graphs: Mapping[str, NavGraph]

    @staticmethod
    def read(scans: Path, tasks: Path) -> Benchmark:
        """Raises InputError where one of them cannot be read, there is no task, or a path is not in the graphs."""
        found = read_tasks(tasks)
        if not found:
            raise InputError(f"{tasks} holds no path; export tasks with paths in this split.")
        files = scan_files(scans, list(dict.fromkeys(task.scan for task in found)))
        graphs = {scan: read_connectivity(path) for scan, path in files.items()}
        benchmark = Benchmark(next(iter(files.values())).parent, found, graphs)
        check_tasks(found, benchmark.distances, tasks)
        return benchmark

    @cached_property
    def distances(self) -> Mapping[str, Distances]:
        """scan id -> metres between its viewpoints"""
        return {scan: Distances(graph) for scan, graph in self.graphs.items()}
