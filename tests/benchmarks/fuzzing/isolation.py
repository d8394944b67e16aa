"""Read every input in a forked process that is watched, so that a fault ends only that process.

The parent has imported and warmed up all code; a child takes a batch of inputs. The outcomes are in shared memory, so
that no result is lost if a child is killed.
"""

from __future__ import annotations

import contextlib
import ctypes
import faulthandler
import json
import mmap
import os
import resource
import shutil
import signal
import struct
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from fuzzing.measures import forget_peak, memory, processor_time, sleeps, with_children
from fuzzing.plan import Plan
from fuzzing.reader import Reader, lay
from nvsim.errors import InputError

PENDING, ACCEPTED, REFUSED, UNCLEAR, TRACEBACK, HANG, MEMORY = range(7)
_C = ctypes.CDLL(None)
KINDS = ("pending", "accepted", "refused", "unclear", "traceback", "hang", "memory")
"""An unclear refusal has no presentable sentence: it has several lines, control characters, or excessive length."""
SECONDS = 2.0
"""Limit of the processor time for an input, of the reader or of its children, and of the time that all of them
sleep."""
ALLOWANCE = 64 << 20
PER_BYTE = 10
_ADDRESS_SPACE = 3 << 30  # limit above the parent's address space, which protects the machine
_LONGEST = 4000  # characters of a sentence, including the path
_BATCH = 250
_TOLD_EVERY = 10_000
_ROW = struct.Struct("<Bff")  # outcome, milliseconds, MiB
_NOW = struct.Struct("<qd")  # index of the current input (-1: none), processor seconds at its start


@dataclass(frozen=True)
class Fault:
    """damage  the damage of the file, in words
    where      the last line of the product's code in the traceback, "file.py:12"
    """

    reader: str
    index: int
    kind: str
    error: str
    where: str
    damage: str


class Pool:
    """Runs the inputs `indices` of a plan in up to `workers` processes. `outcomes` are in the order of `indices`."""

    def __init__(self, plan: Plan, indices: Sequence[int], folder: Path, workers: int) -> None:
        self.plan, self.indices, self.folder = plan, indices, folder
        self._workers = workers
        self._rows = mmap.mmap(-1, max(1, len(indices)) * _ROW.size)
        self._now = mmap.mmap(-1, workers * _NOW.size)
        self._faults = folder / "faults.jsonl"
        self._faults.touch()
        self._running: dict[int, tuple[int, range]] = {}  # slot -> process, places

    def run(self) -> None:
        """Runs until every input is read."""
        todo = [range(a, min(a + _BATCH, len(self.indices))) for a in range(0, len(self.indices), _BATCH)][::-1]
        # slot -> current input, last time when it was awake, processor time of its children at the start
        seen: dict[int, tuple[int, float, float]] = {}
        told, began = 0, time.monotonic()
        try:
            while todo or self._running:
                done = len(self.indices) - sum(map(len, todo))
                if done - told >= _TOLD_EVERY:
                    told = done
                    found = self._faults.read_bytes().count(b"\n")
                    print(
                        f"{done} inputs begun, {found} faults, {time.monotonic() - began:.0f} s",
                        file=sys.stderr,
                        flush=True,
                    )
                for slot in range(self._workers):
                    if slot not in self._running and todo:
                        places = todo.pop()
                        self._running[slot] = (self._fork(slot, places), places)
                time.sleep(0.02)
                for slot, (process, places) in list(self._running.items()):
                    rest = self._look(slot, process, places, seen)
                    if rest is not None and len(rest):
                        todo.append(rest)
        finally:
            for process, _ in self._running.values():
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)

    def outcomes(self) -> Iterator[tuple[int, int, float, float]]:
        """Yields (index, outcome, milliseconds, MiB) for every input."""
        for place, index in enumerate(self.indices):
            yield index, *_ROW.unpack_from(self._rows, place * _ROW.size)

    def faults(self) -> list[Fault]:
        return [Fault(**json.loads(line)) for line in self._faults.read_text().splitlines()]

    # The parent's side ------------------------------------------------------------------------------------------

    def _fork(self, slot: int, places: range) -> int:
        _NOW.pack_into(self._now, slot * _NOW.size, -1, 0.0)
        process = os.fork()
        if process == 0:
            try:
                self._work(slot, places)
            except BaseException:
                with open(self.folder / "broken.txt", "a") as file:
                    traceback.print_exc(file=file)
                os._exit(70)
            os._exit(0)
        return process

    def _look(self, slot: int, process: int, places: range, seen: dict[int, tuple[int, float, float]]) -> range | None:
        """Checks a child. Returns None while it works, else the inputs that it has left."""
        place, began = _NOW.unpack_from(self._now, slot * _NOW.size)
        ended, status = os.waitpid(process, os.WNOHANG)
        kind, error = TRACEBACK, ""
        if ended:
            if place < 0 and status == 0:
                del self._running[slot]
                return range(0)
            if place < 0:
                raise RuntimeError(f"a worker ended with {status}: {self._broken()}")
            number = os.waitstatus_to_exitcode(status)
            error = f"the process ended with {signal.Signals(-number).name if number < 0 else f'code {number}'}"
        else:
            if place < 0:
                return None
            all_of_it = with_children(process)
            theirs = sum(processor_time(child) for child in all_of_it[1:])
            before, awake, base = seen.get(slot, (-1, 0.0, 0.0))
            if before != place:
                base = theirs
            if before != place or not sleeps(all_of_it):
                awake = time.monotonic()
                seen[slot] = (place, awake, base)
            busy = max(processor_time(process) - began, theirs - base)
            if busy < SECONDS and time.monotonic() - awake < SECONDS:
                return None
            os.kill(process, signal.SIGKILL)
            os.waitpid(process, 0)
            kind, error = HANG, f"more than {SECONDS:g} s"
        del self._running[slot]
        if _ROW.unpack_from(self._rows, place * _ROW.size)[0] == PENDING:
            _, _, _, damage = self.plan.input(self.indices[place])
            self._note(place, kind, error, "", damage)
            _ROW.pack_into(self._rows, place * _ROW.size, kind, SECONDS * 1e3 if kind == HANG else 0.0, 0.0)
        shutil.rmtree(self.folder / f"slot{slot}", ignore_errors=True)
        return range(place + 1, places.stop)

    def _broken(self) -> str:
        path = self.folder / "broken.txt"
        return path.read_text() if path.exists() else "no word"

    def _note(self, place: int, kind: int, error: str, where: str, damage: str) -> None:
        index = self.indices[place]
        fault = Fault(self.plan.reader(index).name, index, KINDS[kind], error, where, damage)
        with open(self._faults, "a") as file:
            file.write(json.dumps(asdict(fault)) + "\n")

    # The child's side -------------------------------------------------------------------------------------------

    def _work(self, slot: int, places: range) -> None:
        _quiet()
        for place in places:
            reader, seed, files, damage = self.plan.input(self.indices[place])
            folder = self.folder / f"slot{slot}" / reader.name / str(self.plan.seeds[reader.name].index(seed))
            fresh = reader.disposable or not folder.exists()
            changed = {n: c for n, c in files.items() if fresh or c is not seed.files.get(n)}
            lay(changed, folder)
            size = sum(map(len, files.values()))
            began = time.process_time()
            _NOW.pack_into(self._now, slot * _NOW.size, place, began)
            kind, error, where, growth = _watched(reader, folder / seed.opened, size)
            if kind >= UNCLEAR:
                self._note(place, kind, error, where, damage)
            _ROW.pack_into(self._rows, place * _ROW.size, kind, (time.process_time() - began) * 1e3, growth / (1 << 20))
            _NOW.pack_into(self._now, slot * _NOW.size, -1, 0.0)
            if reader.disposable:
                shutil.rmtree(folder, ignore_errors=True)
            else:
                lay({n: seed.files[n] for n in changed if n in seed.files}, folder)


def _watched(reader: Reader, path: Path, size: int) -> tuple[int, str, str, int]:
    """Reads a file. Returns outcome, error, location, and the peak growth of the memory in bytes."""
    _C.malloc_trim(0)  # release freed memory, because its reuse would not be counted
    forget_peak()
    before = memory("VmRSS")
    kind, error, where = ACCEPTED, "", ""
    try:
        reader.read(path)
    except (InputError, *reader.refusals) as refusal:
        kind = REFUSED
        if not _is_sentence(str(refusal), path):
            kind, error, where = UNCLEAR, f"{str(refusal)[:160]!r}", _place_of(refusal)
        if (want := _want_of_memory(refusal)) is not None:
            kind, error, where = MEMORY, f"refused only after a failed memory allocation: {want}", _place_of(refusal)
    except BaseException as failure:
        kind = TRACEBACK
        error, where = f"{type(failure).__name__}: {' '.join(str(failure)[:2000].split())[:160]}", _place_of(failure)
    growth = memory("VmHWM") - before
    if kind in (ACCEPTED, REFUSED, UNCLEAR) and growth > ALLOWANCE + PER_BYTE * size:
        kind, error = MEMORY, f"{growth >> 20} MiB for a file of {size} bytes"
    return kind, error, where, growth


def _is_sentence(text: str, path: Path) -> bool:
    return text.replace(str(path), "").isprintable() and len(text) <= _LONGEST and " object at 0x" not in text


def _want_of_memory(error: BaseException) -> str | None:
    """The message of a refusal that was caused by a failed memory allocation, or None."""
    cause: BaseException | None = error
    while cause is not None:
        text = str(cause)
        if isinstance(cause, MemoryError) or "Insufficient memory" in text or "llocate" in text:
            return text[:120]
        cause = cause.__cause__ or cause.__context__
    return None


def _place_of(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "/nvsim/" in f.filename or "/nvsim_app/" in f.filename]
    if not ours:
        return ""
    last = ours[-1]
    at = max(last.filename.rfind("/nvsim/"), last.filename.rfind("/nvsim_app/"))
    return f"{last.filename[at + 1 :]}:{last.lineno}"


def _quiet() -> None:
    """Disables output and core files, limits the address space, and returns large freed arrays to the system."""
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nothing, stream)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    limit = memory("VmSize") + _ADDRESS_SPACE
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    faulthandler.disable()
    _C.mallopt(-3, 1 << 20)
    sys.unraisablehook = lambda _: None
