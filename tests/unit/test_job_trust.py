"""Who ordered a job, and whether its process lives: NVSim trusts no file of a foreign project for either."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from nvsim.cli.worker import check_order
from nvsim.errors import InputError
from nvsim.events import Log
from nvsim.project.jobs import worker_lock
from nvsim.project.jobs.files import (
    MOST_BYTES,
    MOST_LINE,
    EventFile,
    event_line,
    is_order_proven,
    order_proof,
    secret_path,
)
from nvsim.project.jobs.joblist import Job, JobCommand, JobList


@pytest.fixture
def jobs(tmp_path: Path) -> JobList:
    return JobList(tmp_path / "house.nvsim")


@pytest.fixture
def fresh_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return secret_path()


def needed(jobs: JobList, number: int = 1) -> Job:
    found = jobs.job(number)
    assert found is not None
    return found


def running_elsewhere(jobs: JobList) -> subprocess.Popen[str]:
    """Another process claims the next job and sleeps."""
    program = (
        "import sys, time\nfrom nvsim.project.jobs.joblist import JobList\n"
        "print(JobList(sys.argv[1]).claim() is not None, flush=True)\ntime.sleep(60)"
    )
    command = [sys.executable, "-c", program, str(jobs.root)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stdout is not None and process.stdout.readline().strip() == "True"
    return process


def write_status(job: Job, **values: object) -> None:
    (job.folder / "standing.json").write_text(json.dumps({"state": "running", "started": time.time(), **values}))


# Liveness -------------------------------------------------------------------------------------------------------


def test_a_clock_that_is_set_does_not_end_a_job(jobs: JobList, monkeypatch: pytest.MonkeyPatch) -> None:
    jobs.add("train", [], "Train")
    process = running_elsewhere(jobs)
    try:
        now = time.time()
        for shift in (-3600.0, -5.0, 5.0, 1e6):
            monkeypatch.setattr(time, "time", lambda shift=shift: now + shift)
            assert needed(jobs).status.state == "running"
        job = needed(jobs)
        write_status(job, pid=job.status.pid, started=now - 1e6)  # what was noted is off as well
        jobs.add("map", [], "Map")
        assert needed(jobs).status.state == "running" and jobs.claim() is None
    finally:
        process.kill()
        process.wait()
    assert needed(jobs).status.state == "interrupted"


def test_a_number_that_is_used_again_is_not_the_job(jobs: JobList) -> None:
    job = jobs.add("train", [], "Train")
    stranger = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"], start_new_session=True)
    try:
        write_status(job, pid=stranger.pid)
        assert needed(jobs).status.state == "interrupted"
        for number in (stranger.pid, os.getpid(), 1, 0, -1, 2**70):
            write_status(job, pid=number)
            jobs.ask(1, "pause")
            jobs.kill(1)
            assert not worker_lock.send(job.folder, number, signal.SIGKILL)
        assert stranger.poll() is None
    finally:
        stranger.kill()
        stranger.wait()


def test_a_forged_number_is_not_signalled_while_the_job_runs(jobs: JobList) -> None:
    jobs.add("train", [], "Train")
    process = running_elsewhere(jobs)
    stranger = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"], start_new_session=True)
    try:
        job = needed(jobs)
        write_status(job, pid=stranger.pid)
        assert needed(jobs).status.state == "running"  # somebody holds its lock
        jobs.ask(1, "cancel")
        jobs.kill(1)
        assert stranger.poll() is None and process.poll() is None
        write_status(job, pid=process.pid)
        jobs.kill(1)
        assert process.wait(10) == -signal.SIGKILL
    finally:
        for each in (process, stranger):
            each.kill()
            each.wait()


def test_a_folder_copied_from_where_its_job_runs_is_not_live(jobs: JobList, tmp_path: Path) -> None:
    jobs.add("train", [], "Train")
    process = running_elsewhere(jobs)
    try:
        shutil.copytree(jobs.root, tmp_path / "copy.nvsim")
        copy = JobList(tmp_path / "copy.nvsim")
        assert needed(jobs).status.state == "running"
        assert needed(copy).status.state == "foreign"
    finally:
        process.kill()
        process.wait()


# Whose order ----------------------------------------------------------------------------------------------------


def test_an_order_that_was_not_given_here_is_foreign_and_never_taken(jobs: JobList) -> None:
    folder = jobs.add("train", ["--project", str(jobs.root)], "Train").folder
    data = json.loads((folder / "order.json").read_text())
    forged = [
        {**data, "verb": "map"},
        {**data, "arguments": ["--project", "/elsewhere"]},
        {**data, "title": "Another"},
        {**data, "proof": "0" * 64},
        {**data, "proof": None},
        {name: value for name, value in data.items() if name != "proof"},
        {**data, "verb": "graph replay"},
    ]
    assert needed(jobs).ours and needed(jobs).status.state == "queued"
    for order in forged:
        (folder / "order.json").write_text(json.dumps(order))
        assert needed(JobList(jobs.root)).status.state == "foreign"
        assert jobs.claim() is None and jobs.claim(1) is None
        with pytest.raises(InputError, match="ordered elsewhere"):
            jobs.requeue(1)


def test_an_order_does_not_travel_to_another_project_or_number(jobs: JobList, tmp_path: Path) -> None:
    folder = jobs.add("train", [], "Train").folder
    other = JobList(tmp_path / "other.nvsim")
    theirs = other.add("map", [], "Map").folder
    for place in (theirs, jobs.folder / "000007"):
        place.mkdir(exist_ok=True)
        shutil.copy(folder / "order.json", place / "order.json")
    assert needed(other).status.state == "foreign"
    assert needed(jobs, 7).status.state == "foreign"
    shutil.move(jobs.root, tmp_path / "moved.nvsim")
    assert needed(JobList(tmp_path / "moved.nvsim")).status.state == "foreign"


def test_a_worker_hands_on_to_no_foreign_job(jobs: JobList) -> None:
    job = jobs.add("submaps", ["--project", str(jobs.root)], "Cut")
    data = json.loads((job.folder / "order.json").read_text())
    (job.folder / "order.json").write_text(json.dumps({**data, "proof": "ab"}))
    ended = subprocess.run([sys.executable, "-P", "-m", "nvsim.cli.worker", str(jobs.root)], check=False)
    assert ended.returncode == 0
    assert not (job.folder / "events.jsonl").exists() and not (job.folder / "standing.json").exists()


def test_what_the_user_saw_can_be_ordered_anew_and_nothing_else(jobs: JobList) -> None:
    job = jobs.add("train", [], "Train")
    data = json.loads((job.folder / "order.json").read_text())
    (job.folder / "order.json").write_text(json.dumps({**data, "title": "Theirs", "proof": ""}))
    seen = needed(jobs)
    (job.folder / "order.json").write_text(json.dumps({**data, "title": "Something else", "proof": ""}))
    with pytest.raises(InputError, match="has changed"):
        jobs.order_again(seen)
    jobs.order_again(needed(jobs))
    assert needed(jobs).ours and needed(jobs).status.state == "queued" and jobs.claim() is not None


@pytest.mark.parametrize(
    ("verb", "arguments", "words"),
    [
        ("graph replay", ["x", "y"], "cannot be a job"),
        ("app", [], "cannot be a job"),
        ("rm -rf", [], "cannot be a job"),
        ("map", ["--project", "/elsewhere"], "for another project"),
        ("map", ["--tyro-write-completion", "bash", "/tmp/x"], "no option"),
        (
            "map",
            ["--project", "ROOT", "--colour", "red"],
            "“Theirs” cannot run because its option --colour is not valid",
        ),
        ("export r2r", ["--project", "ROOT", "--out", "/etc"], "outside of the project"),
        ("export r2r", ["--project", "ROOT", "--out=ROOT/../x"], "outside of the project"),
        ("export r2r", ["--project", "ROOT", "--out=ROOT/link/x"], "outside of the project"),
        ("export r2r", ["--project", "ROOT"], "outside of the project"),  # where the window was started
        ("evaluate graph", ["--project", "ROOT", "--picture", "/tmp/x.png"], "outside of the project"),
        ("evaluate graph", ["--project", "ROOT", "--occupancy", "/dev/zero"], "outside of the project"),
        ("evaluate views", ["--project", "ROOT", "--csv", "/tmp/x"], "outside of the project"),
        ("import", ["/home", "--project", "ROOT"], "outside of the project"),
        (
            "export tasks",
            ["--project", "ROOT", "--out", "ROOT/t", "--endpoint", "http://other.example/v1", "--yes"],
            "would send data to http://other.example/v1",
        ),
        ("video", ["--project", "ROOT", "--path", "ROOT/p.json", "--out", "/tmp"], "outside of the project"),
    ],
)
def test_a_job_of_another_person_is_refused_if_it_leaves_the_project(
    tmp_path: Path, verb: str, arguments: list[str], words: str
) -> None:
    root = tmp_path / "house.nvsim"
    root.mkdir()
    (root / "link").symlink_to("/tmp")
    with pytest.raises(InputError, match=words):
        check_order(
            root, JobCommand(verb, tuple(a.replace("ROOT", str(root)) for a in arguments), "Theirs"), confined=True
        )


def test_an_order_within_the_project_can_be_taken_over(tmp_path: Path) -> None:
    root = tmp_path / "house.nvsim"
    train = ("--project", str(root), "--preset", "nvsim", "--steps", "100")
    check_order(root, JobCommand("train", train, "Train"), confined=True)
    export = ("--project", str(root), "--out", str(root / "r2r"))
    check_order(root, JobCommand("export r2r", export, "Export"), confined=True)


# The secret -----------------------------------------------------------------------------------------------------


def test_the_secret_is_the_users_alone_and_made_once(fresh_state: Path, tmp_path: Path) -> None:
    assert not is_order_proven(tmp_path, "order", 1, "ab") and not fresh_state.exists()
    proof = order_proof(tmp_path, "order", [1, "x"])
    assert fresh_state.stat().st_mode & 0o777 == 0o600 and fresh_state.stat().st_size == 32
    assert is_order_proven(tmp_path, "order", [1, "x"], proof) and order_proof(tmp_path, "order", [1, "x"]) == proof
    assert not is_order_proven(tmp_path, "settings", [1, "x"], proof)
    assert [p.name for p in fresh_state.parent.iterdir()] == [fresh_state.name]


@pytest.mark.parametrize("trap", ["link", "dangling", "open to all", "short", "pipe"])
def test_a_secret_that_others_may_have_laid_there_is_not_used(fresh_state: Path, tmp_path: Path, trap: str) -> None:
    fresh_state.parent.mkdir(parents=True)
    target = tmp_path / "theirs"
    if trap != "dangling":
        target.write_bytes(b"x" * 32)
        target.chmod(0o600)
    if trap in ("link", "dangling"):
        fresh_state.symlink_to(target)
    elif trap == "pipe":
        os.mkfifo(fresh_state, 0o600)
    else:
        fresh_state.write_bytes(b"x" * (32 if trap == "open to all" else 5))
        fresh_state.chmod(0o644 if trap == "open to all" else 0o600)
    with pytest.raises(InputError, match="is not a secret"):
        order_proof(tmp_path, "order", 1)
    assert not is_order_proven(tmp_path, "order", 1, "ab")
    assert trap != "dangling" or not target.exists()


# Damaged and hostile folders ------------------------------------------------------------------------------------

BAD_ORDERS = [
    b"",
    b"{",
    b"[" * 100_000,
    b"null",
    b"\xff\xfe",
    b'{"verb": 1, "arguments": [], "title": "x", "heavy": true, "ordered": 0}',
    b'{"verb": "train", "arguments": "ab", "title": "x", "heavy": true, "ordered": 0}',
    b'{"verb": "train", "arguments": [1], "title": "x", "heavy": true, "ordered": 0}',
    b'{"verb": "train", "arguments": [], "title": null, "heavy": true, "ordered": 0}',
    b'{"verb": "train", "arguments": [], "title": "x", "heavy": 2, "ordered": 0}',
    b'{"verb": "train", "arguments": [], "title": "x", "heavy": true, "ordered": NaN}',
    b'{"verb": "train", "arguments": [], "title": "x", "heavy": true, "ordered": 1' + b"0" * 5000 + b"}",
    b'{"verb": "train", "arguments": [], "title": "x", "heavy": true, "ordered": 0, "shell": true}',
    b" " * (2 << 20),
]


@pytest.mark.parametrize("number", range(len(BAD_ORDERS)))
def test_a_damaged_order_is_no_job_and_hides_no_other(jobs: JobList, number: int) -> None:
    (jobs.add("map", [], "Map").folder / "order.json").write_bytes(BAD_ORDERS[number])
    jobs.add("train", [], "Train")
    assert [j.order.verb for j in jobs.jobs()] == ["train"]


@pytest.mark.parametrize(
    "text",
    ["{", '{"state": "gone"}', '{"state": ["running"]}', '{"state": "done", "pid": "x"}', "[" * 99_999,
     '{"state": "done", "worked": Infinity}', '{"state": "done", "started": "now"}', '{"state": "done", "message": 1}'],
)  # fmt: skip
def test_a_job_whose_standing_is_damaged_is_not_run_again_unasked(jobs: JobList, text: str) -> None:
    (jobs.add("train", [], "Train").folder / "standing.json").write_text(text)
    assert needed(jobs).status.state == "interrupted" and "damaged" in needed(jobs).status.message
    assert jobs.claim() is None


@pytest.mark.parametrize("name", ["order.json", "standing.json", "wish", "worker.lock", "events.jsonl"])
@pytest.mark.parametrize("kind", ["pipe", "link", "device", "folder"])
def test_what_is_no_file_is_not_opened(jobs: JobList, tmp_path: Path, name: str, kind: str) -> None:
    place = jobs.add("train", [], "Train").folder / name
    place.unlink(missing_ok=True)
    if kind == "pipe":
        os.mkfifo(place)
    elif kind == "folder":
        place.mkdir()
    else:
        target = Path("/dev/zero") if kind == "device" else tmp_path / "canary"
        if kind == "link":
            target.write_text("untouched")
        place.symlink_to(target)
    file = EventFile(place)
    assert file.read() == [] and not file.has_unread_events
    for job in jobs.jobs():
        with contextlib.suppress(InputError):  # a sentence
            jobs.ask(job.number, "cancel")
        jobs.kill(job.number)
    assert kind != "link" or (tmp_path / "canary").read_text() == "untouched"


@pytest.mark.parametrize("part", ["logs", "logs/jobs", "logs/jobs/000001"])
def test_folders_of_jobs_that_are_links_lead_nowhere(tmp_path: Path, part: str) -> None:
    outside, real = tmp_path / "outside", JobList(tmp_path / "real.nvsim")
    real.add("train", [], "Train")
    root = tmp_path / "house.nvsim"
    link = root / part
    link.parent.mkdir(parents=True)
    shutil.copytree(real.root / part, outside)
    link.symlink_to(outside)
    before = sorted(outside.rglob("*"))
    jobs = JobList(root)
    assert jobs.jobs() == []
    try:
        jobs.add("train", [], "Train")
    except InputError as error:
        assert "symbolic link" in str(error)
    assert sorted(outside.rglob("*")) == before


def test_strange_names_of_job_folders_are_passed_over(jobs: JobList) -> None:
    jobs.add("train", [], "Train")
    for name in ("²²²²²²", "1", "-00001", "9" * 30, "abcdef", "٣٣٣٣٣٣"):
        (jobs.folder / name).mkdir()
    assert [j.number for j in jobs.jobs()] == [1]
    assert jobs.add("map", [], "Map").number == 2


def test_of_a_huge_file_of_events_only_the_end_is_read(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    with open(path, "wb") as file:
        file.truncate(3 * MOST_BYTES)  # takes no room
        file.seek(0, os.SEEK_END)
        file.write(b"\n" + event_line(Log("last"), 2.0).encode())
    events, most = EventFile(path), 0
    for _ in range(MOST_BYTES // MOST_LINE + 2):
        found = events.read(MOST_LINE)
        most = max(most, len(events._rest))
        if found:
            break
    assert [event for _, event in found] == [Log("last")] and most <= MOST_LINE and not events.has_unread_events


@pytest.mark.parametrize(
    "line",
    ['{"at": 1, "event": "progress", "stage": "x", "done": "a", "total": 1}',
     '{"at": 1e400, "event": "log", "text": ""}',
     '{"at": 1, "event": "metric", "stage": "x", "name": ["y"], "value": 1}', '{"at": 1, "event": "log", "text": {}}',
     '{"at": 1, "event": "progress", "stage": "x", "done": 1e400, "total": 1}', "[" * 100_000],
)  # fmt: skip
def test_an_event_of_a_wrong_type_is_left_out(tmp_path: Path, line: str) -> None:
    path = tmp_path / "events.jsonl"
    path.write_text(line + "\n" + event_line(Log("fine"), 1.0))
    file, heard = EventFile(path), []
    while file.has_unread_events:
        heard += file.read()
    assert [event for _, event in heard] == [Log("fine")]
