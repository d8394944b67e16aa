"""Read damaged and hostile files with every reader of the product, and count the faults.

    python tests/benchmarks/fuzz.py --inputs 200000 --seed 1

Each input must be read, or refused with one sentence (InputError). A traceback or crash is a fault, and so is more than
two seconds of processor time. Memory is a fault above 64 MiB plus ten times the file. Exit code 1 if there is a fault.
A seed, a list of readers, and an index determine an input. Each fault is printed with the command that reproduces it.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import tyro

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2])]
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", OPENCV_LOG_LEVEL="SILENT", QT_QPA_PLATFORM="offscreen")
os.environ.update(NUMBA_NUM_THREADS="1", NUMBA_THREADING_LAYER="workqueue")  # threading layers that survive a fork


@dataclass(frozen=True)
class Arguments:
    inputs: int = 3000
    seed: int = 0
    reader: str = ""
    """Names of readers, separated by commas. Default: all."""
    only: int | None = None
    """Read only this input and show its traceback."""
    workers: int = 2
    keep: Path | None = None
    """A folder for the files of every fault."""
    json: bool = False
    list: bool = False
    """Print the names of the readers and exit."""


def main() -> int:
    a = tyro.cli(Arguments, description=__doc__)
    from fuzzing import archives
    from fuzzing.isolation import Pool
    from fuzzing.plan import Plan
    from fuzzing.reader import lay
    from fuzzing.readers import all_readers
    from fuzzing.report import causes, figures, table
    from harness import report

    readers = all_readers()
    if a.list:
        print("\n".join(r.name for r in readers))
        return 0
    if a.reader:
        names = a.reader.split(",")
        if unknown := set(names) - {r.name for r in readers}:
            raise SystemExit(f"There is no reader {', '.join(sorted(unknown))}; --list names them.")
        readers = [r for r in readers if r.name in names]
    place = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    folder = Path(tempfile.mkdtemp(prefix="nvsim-fuzz-", dir=place))
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # the folder is in memory and must be removed
    tempfile.tempdir = str(folder)
    try:
        archives.prepare()
        seeds = {r.name: r.seeds() for r in readers}
        plan = Plan(readers, seeds, a.seed)
        _warm(plan, folder / "warm", a.only is None)
        if a.only is not None:
            return _again(plan, a.only, folder, a.keep)
        began = time.monotonic()
        pool = Pool(plan, range(a.inputs), folder, a.workers)
        pool.run()
        found, faults = figures(pool), pool.faults()
        found["seconds"] = round(time.monotonic() - began, 1)
        for fault in faults if a.keep is not None else ():
            _, _, files, _ = plan.input(fault.index)
            lay(files, a.keep / f"{fault.reader}-{a.seed}-{fault.index}")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    listed = causes(faults)
    if a.json:
        report({**found, "causes": [{"count": n, **vars(f)} for n, f in listed]}, as_json=True)
    else:
        print(table(found))
        print(f"{found['seconds']} s")
        for count, f in listed:
            print(f"\n{count} x {f.reader}: {f.kind} {f.where} {f.error}\n    {f.damage}")
            print(f"    python tests/benchmarks/fuzz.py --seed {a.seed} --reader '{f.reader}' --only {f.index}")
    return 1 if any(found[kind] for kind in ("tracebacks", "hangs", "memory")) else 0


def _warm(plan, folder: Path, judged: bool) -> None:
    """Reads every undamaged seed, so that imports and compiled code are ready before the fork. If `judged`, a seed that
    cannot be read stops the run, because it would find nothing."""
    from fuzzing.reader import lay

    refused = []
    for reader in plan.readers:
        for k, seed in enumerate(plan.seeds[reader.name]):
            at = folder / reader.name / str(k)
            files = dict(seed.files) if seed.seal is None else seed.seal(dict(seed.files))
            lay(files, at)
            try:
                reader.read(at / seed.opened)
            except reader.refusals:
                continue  # an edit that the graph refuses is a valid seed
            except Exception as error:
                if seed.readable:
                    refused.append(f"the undamaged file {seed.target} is not read by {reader.name}: {error!r}")
    shutil.rmtree(folder, ignore_errors=True)
    if refused and judged:
        raise SystemExit("\n".join(refused))


def _again(plan, index: int, folder: Path, keep: Path | None) -> int:
    """Reads one input in this process, for its traceback or for a debugger."""
    from fuzzing.reader import lay

    reader, seed, files, damage = plan.input(index)
    at = folder / "again" if keep is None else keep / f"{reader.name}-{plan.seed}-{index}"
    lay(files, at)
    print(f"{reader.name}: {damage}")
    print(f"read {reader.read(at / seed.opened)!r:.500}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
