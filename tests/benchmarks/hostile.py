"""Open malicious projects from the command line and in windows, and look for forbidden effects.

python tests/benchmarks/hostile.py [--only WORDS] [--no-window] [--json]

A project must not make NVSim write outside of the project, execute code, open a pipe, signal a process, hang, or end in
a traceback. Linux only, because inotify reports opened files. Exit code 1 if any of this happens. A window takes about
ten seconds for each project.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import tyro

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parent), str(HERE.parents[1] / "gui")]

import hostile_projects  # noqa: E402

SECONDS = 120.0  # limit of all commands together
WINDOW_SECONDS = 90.0
_IN_OPEN = 0x20


@dataclass
class Outcome:
    """The effects of one malicious project for one way of opening it. `wrong` is empty if there is no problem."""

    project: str
    opened: str
    seconds: float
    wrong: list[str] = field(default_factory=list)


class Watch:
    """Counts how often the given files are opened, using inotify."""

    def __init__(self, *paths: Path) -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        self._descriptor = libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        for path in paths:
            libc.inotify_add_watch(self._descriptor, os.fsencode(path), _IN_OPEN)

    def opened(self) -> int:
        """Number of openings since the last call."""
        try:
            data = os.read(self._descriptor, 1 << 16)
        except BlockingIOError:
            return 0
        return len(data) // struct.calcsize("iIII")

    def close(self) -> None:
        os.close(self._descriptor)


def tree(folder: Path) -> dict[str, str]:
    """Every path below `folder` with its mode, size, and content hash."""
    found = {}
    for path in sorted(folder.rglob("*")):
        about = os.lstat(path)
        held = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
        found[str(path.relative_to(folder))] = f"{about.st_mode:o} {about.st_size} {held}"
    return found


def honest_project(folder: Path) -> Path:
    """A harmless project with a capture, a model, and a graph."""
    from demo_project import write_project

    return write_project(folder / "honest.nvsim", count=500, models=1)


class Trial:
    """A copy of a harmless project with one trap, and the bait around it."""

    def __init__(self, folder: Path, honest: Path, name: str) -> None:
        self.name = name
        canary = folder / "canary"
        canary.mkdir(parents=True)
        (canary / "precious").write_text("precious\n")
        os.mkfifo(folder / "pipe")
        self._victim = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=True)
        self.bait = hostile_projects.Bait(canary, folder / "pipe", self._victim.pid)
        self.root = Path(shutil.copytree(honest, folder / "house.nvsim"))
        hostile_projects.TRAPS[name](self.root, self.bait)
        self._before = tree(canary)
        self._watch = Watch(self.bait.pipe)
        self.environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "XDG_STATE_HOME": str(folder / "state"),
                            "XDG_CONFIG_HOME": str(folder / "config"), "TMPDIR": str(folder / "tmp")}  # fmt: skip
        self.folder = folder
        (folder / "tmp").mkdir()

    def run(self, opened: str, command: list[str], seconds: float, codes: tuple[int, ...] = (0, 2)) -> Outcome:
        begun = time.monotonic()
        process = subprocess.Popen(
            command, env=self.environment, cwd=self.folder, stdin=subprocess.DEVNULL, text=True, errors="replace",
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        wrong = []
        try:
            said, _ = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            said, _ = process.communicate()
            wrong.append(f"did not end in {seconds:.0f} s")
        else:
            if process.returncode not in codes:
                wrong.append(f"exit code {process.returncode}")
        if "Traceback" in said or "a bug in NVSim" in said:
            wrong.append("traceback: " + " ".join(said.strip().splitlines()[-1:])[:160])
        return Outcome(self.name, opened, time.monotonic() - begun, wrong + self.harm())

    def harm(self) -> list[str]:
        """The forbidden effects since the last call."""
        now, wrong = tree(self.bait.canary), []
        changed = sorted(name for name in {*now, *self._before} if now.get(name) != self._before.get(name))
        if changed:
            wrong.append(f"wrote outside: {', '.join(changed)}")
            self._before = now
        if self._watch.opened():
            wrong.append("opened a pipe")
        if self._victim.poll() is not None:
            wrong.append("signalled a process")
        return wrong

    def close(self) -> None:
        self._watch.close()
        self._victim.kill()
        self._victim.wait()


def play_commands(root: Path) -> int:
    """Runs commands that read the project one after another, and prints the exit code of each."""
    from nvsim.cli.main import main as command

    folder = root.parent
    verbs = {
        "graph check": [str(root)],
        "graph review": [str(root)],
        "graph log": [str(root), "--script", str(folder / "script.jsonl")],
        "graph log over a file": [str(root), "--script", str(folder / "canary" / "precious")],
        "evaluate graph": ["--project", str(root)],
        "export r2r": ["--project", str(root), "--out", str(folder / "out")],
        "submaps": ["--project", str(root)],
    }
    codes = {name: command([*name.removesuffix(" over a file").split(), *words]) for name, words in verbs.items()}
    print(codes, flush=True)
    found = codes.pop("graph check") in (0, 1, 2)  # 1: the graph has errors
    return 0 if found and set(codes.values()) <= {0, 2} and codes["graph log over a file"] == 2 else 1


def trial(folder: Path, honest: Path, name: str, window: bool) -> list[Outcome]:
    made = Trial(folder, honest, name)
    try:
        line = [sys.executable, str(HERE), "--play-commands", str(made.root)]
        found = [made.run("seven commands", line, SECONDS, (0,))]
        if window:
            child = [sys.executable, str(HERE), "--play-window", str(made.root)]
            found.append(made.run("a window, Run everything", child, WINDOW_SECONDS))
            real = [sys.executable, "-P", "-m", "nvsim_app", str(made.root), "--seconds", "4"]
            found.append(made.run("python -m nvsim_app", real, WINDOW_SECONDS))
        return found
    finally:
        made.close()


def play_window(root: Path) -> int:
    """Opens the project in a window, selects every job, runs everything, waits for a while, and closes the window."""
    from PySide6.QtCore import QSettings
    from PySide6.QtTest import QTest

    from nvsim.errors import InputError
    from nvsim.project.path_kind import check_openable
    from nvsim_app.panels.jobs import JobPanel
    from nvsim_app.session import Session
    from nvsim_app.start.application import make_application

    settings = QSettings(str(root.parent / "window.ini"), QSettings.Format.IniFormat)
    application = make_application("dark", settings)
    try:
        check_openable(root)
    except InputError as error:
        print(error)  # the program prints this message and does not open
        return 2
    session = Session(settings)
    session.window.show()
    session.open(root)
    QTest.qWait(1500)
    panel = session.window.panels["jobs"]
    assert isinstance(panel, JobPanel)
    for tab in range(panel.tabs.count()):
        panel.tabs.setCurrentIndex(tab)
        for handle in session.window.jobs.handles[:8]:
            panel.choose(handle)
            QTest.qWait(60)
    action = session.window.actions_table["run_everything"]
    if action.isEnabled():
        action.trigger()
    for _ in range(40):
        QTest.qWait(200)
        if not any(h.state in ("queued", "running") and h.is_own for h in session.window.jobs.handles):
            break
    for handle in session.window.jobs.handles:
        if handle.is_own and handle.state in ("queued", "running"):
            session.window.jobs.cancel(handle)
    QTest.qWait(300)
    session.close()
    application.processEvents()
    return 0


@dataclass(frozen=True)
class Arguments:
    only: str = ""
    """Use only projects whose name contains this text."""
    window: bool = True
    """Also open the projects in windows."""
    json: bool = False
    play_window: Path | None = None
    """Use this project in a window. The processes of the benchmark are started with this option or the next."""
    play_commands: Path | None = None
    """Run the commands on this project."""


def main() -> int:
    given = tyro.cli(Arguments, description=__doc__)
    if given.play_commands is not None:
        return play_commands(given.play_commands)
    if given.play_window is not None:
        return play_window(given.play_window)
    found: list[Outcome] = []
    with tempfile.TemporaryDirectory(prefix="nvsim-hostile-") as name:
        honest = honest_project(Path(name))
        for number, trap in enumerate(t for t in hostile_projects.TRAPS if given.only in t):
            outcomes = trial(Path(name) / str(number), honest, trap, given.window)
            found += outcomes
            if not given.json:
                for each in outcomes:
                    print(
                        f"{each.project:<20} {each.opened:<26} {each.seconds:6.1f} s  {'; '.join(each.wrong) or 'fine'}"
                    )
    if given.json:
        print(json.dumps([asdict(each) for each in found], indent=1))
    return 1 if any(each.wrong for each in found) else 0


if __name__ == "__main__":
    sys.exit(main())
