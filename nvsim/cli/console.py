"""Show events to a user or a program: a progress display in a terminal, plain lines in a pipe, or JSON lines."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from nvsim.cli.terminal import as_json, guard_streams, print_lines, unguarded_stream
from nvsim.events import Done, Event, Failed, Listener, Log, Metric, Preview, Progress, Warning, to_json
from nvsim.plain_text import printable

_redirected_to: Listener | None = None
_verb = ""  # the running command
_arguments: tuple[str, ...] = ()  # its arguments
_stage = ""  # the stage of the last event
_terminal: _Terminal | None = None  # the progress display on the screen


@contextmanager
def redirect_events(listen: Listener) -> Iterator[None]:
    """In the block, sends the events of each command of this process to `listen` instead of a terminal or pipe."""
    global _redirected_to
    _redirected_to = listen
    try:
        yield
    finally:
        _redirected_to = None


def advise(verb: str, arguments: Sequence[str] = ()) -> None:
    """Sets the command for whose options messages are renamed, see `nvsim.cli.options`."""
    global _verb, _arguments, _stage
    _verb, _arguments, _stage = verb, tuple(arguments), ""


def command() -> tuple[str, tuple[str, ...]] | None:
    """Verb and arguments of the running command; None if the library is called directly."""
    return (_verb, _arguments) if _verb else None


def forwards_events() -> bool:
    """Whether the events of this process go to another listener, see `redirect_events`."""
    return _redirected_to is not None


def with_command_options(text: str, stage: str = "") -> str:
    """A message with options renamed for the running command. `stage`: its stage, by default that of the last event."""
    if not _verb or "--" not in text:
        return text
    from nvsim.cli.options import rename_options

    return rename_options(_verb, text, stage or _stage)


def _advising(listen: Listener) -> Listener:
    def advise_and_forward(event: Event) -> None:
        global _stage
        _stage = event.stage or _stage
        if isinstance(event, Log | Warning):
            event = replace(event, text=with_command_options(event.text, event.stage))
        elif isinstance(event, Done):
            event = replace(event, summary=with_command_options(event.summary, event.stage))
        listen(event)

    return advise_and_forward


@contextmanager
def event_listener(in_json: bool) -> Iterator[Listener]:
    """Yields a listener for the duration of a command."""
    with _event_listener(in_json) as listen:
        yield _advising(listen)


@contextmanager
def _event_listener(in_json: bool) -> Iterator[Listener]:
    if _redirected_to is not None:
        yield _redirected_to
    elif in_json:
        yield _print_json
    elif sys.stderr.isatty():
        global _terminal
        with _Terminal() as terminal:
            _terminal = terminal
            try:
                yield terminal
            finally:
                _terminal = None
    else:
        yield _Plain()


@contextmanager
def without_progress_bars() -> Iterator[None]:
    """Removes the progress bars from the screen during a question, because they would hold back unfinished lines."""
    if _terminal is None:
        yield
        return
    _terminal.stop()
    try:
        yield
    finally:
        _terminal.start()


def report_failure(event: Failed, in_json: bool) -> None:
    """Reports the failure of a command to a listening program."""
    if _redirected_to is not None:
        _redirected_to(event)
    elif in_json:
        _print_json(event)


def _print_json(event: Event) -> None:
    print_lines(as_json(json.loads(to_json(event))))


class _Plain:
    """Prints a line when a stage begins, at every tenth of it, and when it ends."""

    def __init__(self) -> None:
        self._tenth: dict[str, int] = {}
        self._psnr = ""

    def __call__(self, event: Event) -> None:
        if isinstance(event, Progress):
            tenth = 10 * event.done // max(event.total, 1)
            if self._tenth.get(event.stage) != tenth and event.total > 1:
                self._tenth[event.stage] = tenth
                detail = f" ({event.detail})" if event.detail else ""
                self._print(f"{event.stage}: {10 * tenth} %{detail}{self._psnr if event.stage == 'train' else ''}")
        elif isinstance(event, Metric) and event.name == "psnr":
            self._psnr = f", PSNR {event.value:.1f} dB so far"
        elif isinstance(event, Done):
            self._print(f"{event.stage}: {event.summary}")
        elif isinstance(event, Warning):
            self._print(f"{event.stage}: warning: {event.text}")
        elif isinstance(event, Log):
            self._print(f"{event.stage}: {event.text}" if event.stage else event.text)

    @staticmethod
    def _print(text: str) -> None:
        print_lines(text, error=True)


class _Terminal:
    """rich's progress bars: stage, percent, rate, time left, best PSNR so far."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bars

        self._bars = Bars(
            TextColumn("{task.fields[stage]:<9}", markup=False),
            BarColumn(bar_width=30),
            TaskProgressColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[psnr]}"),
            TextColumn("{task.description}", style="dim", markup=False),
            console=Console(file=unguarded_stream(sys.stderr)),
        )
        self._tasks: dict[str, tuple] = {}

    def __enter__(self) -> _Terminal:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self) -> None:
        self._bars.start()
        guard_streams()  # rich has replaced the streams by its own

    def stop(self) -> None:
        self._bars.stop()

    def __call__(self, event: Event) -> None:
        if isinstance(event, Progress):
            if event.stage not in self._tasks:
                task = self._bars.add_task("", total=event.total, stage=printable(event.stage), rate="", psnr="")
                self._tasks[event.stage] = (task, event.done, time.monotonic())
            task, first, since = self._tasks[event.stage]
            elapsed = time.monotonic() - since
            rate = f"{(event.done - first) / elapsed:.1f}/s" if elapsed > 1 and event.done > first else ""
            self._bars.update(
                task, completed=event.done, total=event.total, description=printable(event.detail), rate=rate
            )
        elif isinstance(event, Metric) and event.name == "psnr" and event.stage in self._tasks:
            self._bars.update(self._tasks[event.stage][0], psnr=f"{event.value:.1f} dB")
        elif isinstance(event, Done):
            self._print_above_bars("✓ ", "green", f"{event.stage}: {event.summary}")
        elif isinstance(event, Warning):
            self._print_above_bars("! ", "yellow", f"{event.stage}: {event.text}")
        elif isinstance(event, Failed):
            self._print_above_bars("✗ ", "red", f"{event.stage}: {event.message}")
        elif isinstance(event, Log):
            self._print_above_bars(
                "  " if event.stage else "", "", f"{event.stage}: {event.text}" if event.stage else event.text
            )
        elif isinstance(event, Preview):
            pass  # a terminal shows no images

    def _print_above_bars(self, mark: str, color: str, text: str) -> None:
        """Prints a line above the bars: a colored mark and plain text, without interpreting markup."""
        from rich.text import Text

        self._bars.console.print(Text.assemble((mark, color), printable(text)))
