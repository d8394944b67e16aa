"""Train four submaps with local processes and with a Ray cluster on this machine, and compare the models.

python tests/benchmarks/cluster.py [--steps 600] [--image-size 320] [--kill-every 60] [--storage shared|sent]
    [--no-local] [--json]

Both have two workers of one core. A second run on the cluster kills a worker at intervals. The benchmark prints the
duration of each run and whether the models are equal bit by bit. It starts a Ray head and stops it at the end.
--kill-every 0 kills no worker. The efficiency is the time of the undisturbed run over that of the run with killed
workers. All runs start with workers that have imported the libraries. A new worker finds their bytecode, as in any
installation, regardless of the environment. Exit code 1 if models differ.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

import psutil
import tyro
from harness import report, timed

from nvsim.building import BuildingConfig, generate
from nvsim.cluster.config import ClusterConfig, Storage
from nvsim.cluster.executor_choice import open_executor
from nvsim.events import Event, Worker, ignore_event
from nvsim.project.config import CaptureConfig
from nvsim.project.project import Project
from nvsim.project.stages import floors, imported, submaps, trained
from nvsim.submaps.split import SubmapConfig
from nvsim.training.compilation import compile_ahead
from nvsim.training.config import TrainingConfig


@dataclasses.dataclass(frozen=True)
class Arguments:
    steps: int = 600
    image_size: int = 320
    gaussian_cap: int = 20_000
    kill_every: float = 60.0
    storage: Literal["shared", "sent"] = "shared"
    local: bool = True
    """Also train with local processes. Otherwise, use only the cluster."""
    json: bool = False


def make(path: Path, width: int) -> None:
    """Creates a project with four submaps, ready for training."""
    with Project.create_or_open(path) as project:
        building = BuildingConfig(size="small", width=width, height=width * 3 // 4, step=0.5, turn=30.0, people=False)
        generate(project.layout.root, building, ignore_event)
        imported.run(project, project.layout.built_in_capture, CaptureConfig(), ignore_event)
        submaps.run(project, SubmapConfig(count=4), ignore_event)
        floors.run(project, ignore_event)


@contextlib.contextmanager
def head(cores: int) -> Iterator[str]:
    """Starts a cluster on this machine with a new token. Yields its address."""
    os.environ |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32), "RAY_USAGE_STATS_ENABLED": "0"}
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    folder = Path(tempfile.mkdtemp(prefix="nvr-", dir="/tmp"))
    os.environ["PYTHONPYCACHEPREFIX"] = str(folder / "bytecode")
    command = [sys.executable, "-m", "ray.scripts.scripts", "start", "--head", f"--port={port}",
               f"--num-cpus={cores}", "--include-dashboard=false", "--object-store-memory=200000000", "--block",
               f"--temp-dir={folder}"]  # fmt: skip
    with open(folder / "head.log", "wb") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
    try:
        while "block forever" not in (folder / "head.log").read_text():
            if process.poll() is not None:
                raise SystemExit((folder / "head.log").read_text())
            time.sleep(0.1)
        yield f"127.0.0.1:{port}"
    finally:
        process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(20)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        shutil.rmtree(folder, ignore_errors=True)


class Killer:
    """Event listener that kills a worker every `every` seconds, each in turn."""

    def __init__(self, every: float) -> None:
        self._every, self._next, self.kills = every, time.monotonic() + every, 0
        self._working: dict[int, int] = {}  # part -> process

    def __call__(self, event: Event) -> None:
        if isinstance(event, Worker):
            if event.state == "works":
                self._working[event.part] = int(event.name.split()[-1])
            else:
                self._working.pop(event.part, None)
        if self._every > 0 and time.monotonic() > self._next and self._working:
            part = next(iter(self._working))
            with contextlib.suppress(psutil.Error):
                psutil.Process(self._working.pop(part)).kill()
                self.kills += 1
            self._next = time.monotonic() + self._every


def models(path: Path) -> dict[str, str]:
    """Hashes of the files of each model."""
    found = {}
    with Project.open(path) as project:
        for submap in project.submaps("train"):
            for file in sorted(project.layout.model(submap.index).iterdir()):
                if file.suffix != ".json":  # it contains the training time
                    digest = hashlib.sha256(file.read_bytes()).hexdigest()
                    found[f"{submap.index}/{file.suffix}"] = digest
    return found


def train_copy(base: Path, name: str, run: Callable[[Project], None]) -> tuple[float, dict[str, str]]:
    """Trains a copy of the project. Returns the duration in seconds and the hashes of its models."""
    path = base.with_name(f"{name}.nvsim")
    shutil.copytree(base, path)
    with Project.open(path, writable=True) as project:
        _, seconds = timed(lambda: run(project))
    return seconds, models(path)


def measure(
    work: Path, config: TrainingConfig, kill_every: float, storage: Storage, with_local: bool
) -> dict[str, object]:
    """Performs all runs, one after another."""
    base = work / "base.nvsim"
    make(base, config.image_size)
    compile_ahead(ignore_event)
    result: dict[str, object] = {"load": round(os.getloadavg()[0], 1)}
    expected: dict[str, str] = {}
    if with_local:
        here, expected = train_copy(base, "here", lambda p: trained.run(p, config, ignore_event, at_once=2))
        result["local_seconds"] = round(here, 1)
    with head(2) as address, open_executor(ClusterConfig("ray", address, storage)) as executor:

        def run(listen: Callable[[Event], None]) -> Callable[[Project], None]:
            return lambda p: trained.run(p, config, listen, at_once=2, executor=executor)

        few = dataclasses.replace(config, steps=2)
        train_copy(base, "warm", lambda p: trained.run(p, few, ignore_event, at_once=2, executor=executor))
        afar, found = train_copy(base, "afar", run(ignore_event))
        result["ray_seconds"] = round(afar, 1)
        if with_local:
            result["same_models"] = found == expected
        if kill_every > 0:
            killer = Killer(kill_every)
            shot, again = train_copy(base, "shot", run(killer))
            result |= {
                "kills": killer.kills, "killed_seconds": round(shot, 1), "efficiency": round(afar / shot, 2),
                "same_models_although_killed": again == found,
            }  # fmt: skip
    return result


def main() -> int:
    a = tyro.cli(Arguments, description=__doc__)
    config = TrainingConfig(steps=a.steps, image_size=a.image_size, gaussian_cap=a.gaussian_cap, threads=1)
    with tempfile.TemporaryDirectory() as folder:
        result = measure(Path(folder), config, a.kill_every, a.storage, a.local)
    report(result, a.json)
    return 0 if all(v for k, v in result.items() if k.startswith("same_models")) else 1


if __name__ == "__main__":
    sys.exit(main())
