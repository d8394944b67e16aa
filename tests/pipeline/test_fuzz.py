"""Damaged and hostile files: no reader may crash, hang or take the memory; and the fuzzer sees it when one does."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
INPUTS = 300


@pytest.mark.timeout(600)
def test_every_reader_reads_or_refuses_damaged_files():
    began = time.monotonic()
    words = ["--inputs", str(INPUTS), "--seed", "1", "--json"]
    run = subprocess.run(
        [sys.executable, str(BENCHMARKS / "fuzz.py"), *words], capture_output=True, text=True, check=False
    )
    assert run.stdout, run.stderr
    found = json.loads(run.stdout)
    causes = "\n".join(f"{c['count']} x {c['reader']} {c['index']}: {c['where']} {c['error']}" for c in found["causes"])
    assert found["inputs"] == INPUTS and found["accepted"] > INPUTS / 10
    assert (found["tracebacks"], found["hangs"], found["memory"]) == (0, 0, 0), causes
    assert run.returncode == 0
    print(f"{time.monotonic() - began:.0f} s")


@pytest.fixture
def fuzzing(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from fuzzing import isolation, plan, reader, report

    monkeypatch.setattr(isolation, "SECONDS", 0.5)
    return isolation, plan, reader, report


def outcome(fuzzing, tmp_path, read):
    """The results of forty inputs of a reader."""
    isolation, plan, reader, report = fuzzing
    one = reader.Reader("one", list, read)
    seed = reader.Seed({"f": b"1 2 3\n" * 20}, "f", "f", "text")
    pool = isolation.Pool(plan.Plan([one], {"one": [seed]}, 0), range(40), tmp_path, 2)
    pool.run()
    figures = report.figures(pool)
    assert figures["inputs"] == 40
    return figures, pool.faults()


def odd(path: Path) -> bool:
    """Some of the inputs, always the same."""
    return path.is_file() and path.read_bytes()[:4] != b"1 2 "


def test_a_reader_that_raises_is_a_traceback_with_its_input(fuzzing, tmp_path):
    def read(path):
        if odd(path):
            raise KeyError("no such")

    figures, faults = outcome(fuzzing, tmp_path, read)
    assert 0 < figures["tracebacks"] == len(faults) < 40
    assert figures["accepted"] == 40 - len(faults)
    assert all(f.error == "KeyError: 'no such'" and f.damage.startswith("f: ") for f in faults)


def test_a_refusal_is_none_and_one_of_many_lines_is_unclear(fuzzing, tmp_path):
    from nvsim.errors import InputError

    class TwoLines(InputError):
        def __str__(self):
            return "One.\nTwo."

    def read(path):
        raise TwoLines("") if odd(path) else InputError(f"{path} is wrong; write it again.")

    figures, _ = outcome(fuzzing, tmp_path, read)
    assert figures["refused"] == 40 and 0 < figures["unclear"] < 40 and not figures["tracebacks"]


def test_a_reader_that_does_not_end_is_a_hang_and_the_others_go_on(fuzzing, tmp_path):
    def read(path):
        while odd(path):
            pass

    figures, _ = outcome(fuzzing, tmp_path, read)
    assert figures["hangs"] > 0 and figures["accepted"] == 40 - figures["hangs"]


def test_a_reader_that_waits_for_ever_is_a_hang(fuzzing, tmp_path):
    def read(path):
        if odd(path):
            time.sleep(3600)

    figures, _ = outcome(fuzzing, tmp_path, read)
    assert figures["hangs"] > 0 and figures["accepted"] == 40 - figures["hangs"]


def test_a_reader_that_ends_its_process_is_found(fuzzing, tmp_path):
    def read(path):
        if odd(path):
            import os
            import signal

            os.kill(os.getpid(), signal.SIGSEGV)

    figures, faults = outcome(fuzzing, tmp_path, read)
    assert figures["tracebacks"] > 0 and figures["accepted"] == 40 - figures["tracebacks"]
    assert {f.error for f in faults} == {"the process ended with SIGSEGV"}


def lavish(path):
    return float(np.ones(100 << 17).sum()) if odd(path) else 0.0


def test_memory_far_beyond_the_file_is_a_fault_though_it_is_given_back(fuzzing, tmp_path):
    figures, _ = outcome(fuzzing, tmp_path, lavish)
    assert figures["memory"] > 0 and figures["accepted"] == 40 - figures["memory"], figures


def test_it_is_a_fault_though_it_was_free_already_and_in_the_process(fuzzing, tmp_path):
    held = [np.ones(12_000) for _ in range(1400)]  # each too small to be given back by itself
    last = np.ones(12_000)
    del held
    figures, _ = outcome(fuzzing, tmp_path, lavish)
    assert figures["memory"] > 0 and len(last) == 12_000, figures


def test_memory_that_is_refused_only_because_there_is_none_is_a_fault(fuzzing, tmp_path):
    from nvsim.files.reading import reading

    def read(path):
        with reading(path, "a number"):
            np.ones(1 << 40)

    figures, _ = outcome(fuzzing, tmp_path, read)
    assert figures["memory"] == 40


def test_an_input_depends_on_seed_reader_and_number_alone(fuzzing):
    _, plan, reader, _ = fuzzing
    seed = reader.Seed({"f": b"1 2 3\n" * 20}, "f", "f", "text")
    one, two = (reader.Reader(name, list, len) for name in ("one", "two"))
    seeds = {"one": [seed], "two": [seed]}
    together, alone = plan.Plan([one, two], seeds, 5), plan.Plan([two], seeds, 5)
    assert together.input(7)[2:] == alone.input(7)[2:]
    assert any(plan.Plan([two], seeds, 6).input(k)[2:] != alone.input(k)[2:] for k in range(9))
