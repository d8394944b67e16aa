"""Lists, tests, and installs networks in a child process, because opening a network takes seconds and memory. Does not
use Qt."""

from __future__ import annotations

import json
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from app.state.child import Child, answer

Found = dict[str, Any]
"""{"catalogue": …} in the format of `nvsim.networks.catalogue.Catalogue`, with {"checked": {name: …}} for tested models
and {"added": name} for an installed model."""


class ModelsChild:
    """One task that `result` starts: tests the models `check`, or installs the files `add`; then lists all models."""

    def __init__(self, check: Sequence[str] = (), add: Sequence[Path] = ()) -> None:
        self._asked = {"check": list(check), "add": [str(path.absolute()) for path in add]}
        self._lock = threading.Lock()
        self._child: Child | None = None
        self._killed = False

    def result(self) -> Found | None:
        """Runs the task and waits for it. None after `kill`. Raises InputError with the reason if files cannot be
        installed."""
        with tempfile.TemporaryDirectory(prefix="nvsim-models-") as folder:
            (Path(folder) / "asked.json").write_text(json.dumps(self._asked))
            with self._lock:
                if self._killed:
                    return None
                self._child = Child("app.state.models_child", Path(folder), "The networks cannot be listed")
            found = self._child.output()
        return None if found is None else json.loads(found)

    def kill(self) -> None:
        """Ends the process. Can be called from any thread, also before the start and after the end."""
        with self._lock:
            self._killed = True
            if self._child is not None:
                self._child.kill()


def _work(folder: Path) -> bytes:
    from nvsim.files.regular import read_json
    from nvsim.networks.catalogue import catalogue

    asked = read_json(folder / "asked.json", "the request", "try again")
    found: Found = {"checked": {}, "added": ""}
    if asked["add"]:
        from nvsim.networks.adding import add

        found["added"] = add([Path(path) for path in asked["add"]]).name
    if asked["check"]:
        from nvsim.networks.installed import bundled, installed
        from nvsim.perception.checking import check

        known = {model.name: model for model in (*installed()[0], *bundled())}
        found["checked"] = {name: asdict(check(known[name])) for name in asked["check"] if name in known}
    found["catalogue"] = catalogue().as_dict()
    return json.dumps(found).encode()


if __name__ == "__main__":
    sys.exit(answer(_work))
