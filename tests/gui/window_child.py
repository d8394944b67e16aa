"""A real window in a process of its own that starts a training and goes on until it is closed or killed."""

from __future__ import annotations

import sys
from pathlib import Path

from PySide6.QtCore import QSettings

from nvsim_app.session import Session
from nvsim_app.start.application import make_application
from nvsim_app.wiring.jobs import JobsPart

if __name__ == "__main__":
    project, verb = Path(sys.argv[1]), sys.argv[2]
    settings = QSettings(str(project.parent / "window.ini"), QSettings.Format.IniFormat)
    application = make_application("dark", settings)
    session = Session(settings)
    session.window.show()
    session.open(project)
    if verb != "-":
        part = session.window.part(JobsPart)
        handle = part.run_stage(verb)
        assert handle is not None
    print("ready", flush=True)
    application.exec()
    session.close()
