"""Lists, tries and installs networks in a process of its own, because to open one takes seconds and memory. Knows no
Qt."""

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
"""{"catalogue": …} as `nvsim.networks.catalogue.Catalogue` has it, with {"checked": {name: …}} where models were tried
and {"added": name} where one was installed."""


class ModelsChild:
    """One task, which `result` begins: tries the models named in `check`, or installs the files `add`, and lists."""

    def __init__(self, check: Sequence[str] = (), add: Sequence[Path] = ()) -> None:
        self._asked = {"check": list(check), "add": [str(path.absolute()) for path in add]}
        self._lock = threading.Lock()
        self._child: Child | None = None
        self._killed = False

    def result(self) -> Found | None:
        """Waits for it; None after `kill`. Raises InputError with the reason where files cannot be installed."""
        with tempfile.TemporaryDirectory(prefix="nvsim-models-") as folder:
            (Path(folder) / "asked.json").write_text(json.dumps(self._asked))
            with self._lock:
                if self._killed:
                    return None
                self._child = Child("app.state.models_child", Path(folder), "The networks cannot be listed")
            found = self._child.output()
        return None if found is None else json.loads(found)

    def kill(self) -> None:
        """Ends it; from any thread, also before it began and when it has ended."""
        with self._lock:
            self._killed = True
            if self._child is not None:
                self._child.kill()


def _work(folder: Path) -> bytes:
    from nvsim.files.regular import read_json
    from nvsim.networks.catalogue import catalogue

    asked = read_json(folder / "asked.json", "what is asked", "ask again")
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
