"""Works of side processes. They import little, because the process imports this file."""

from __future__ import annotations

from nvsim_app.processes.serving import Requests


def until_asked(requests: Requests, source: object) -> None:
    requests.send_notice("busy")
    requests.wait_for_request()


def nothing(requests: Requests, source: object) -> None:
    pass
