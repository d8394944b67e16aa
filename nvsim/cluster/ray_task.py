"""The task that Ray runs on a worker.

Ray sends this module by value. A worker without NVSim, or with another version, can therefore report that. The task
imports no other module of NVSim before the version is checked.
"""

from __future__ import annotations

from collections.abc import Iterator


def run_order(order: bytes, cores: int, ours: dict[str, str]) -> Iterator[list[tuple[str, object]]]:
    """Runs a pickled order with `cores` threads if the worker has the NVSim version in `ours`.

    Yields pairs of a kind and a value: "began" (machine and process), "refused" (the reason), "warned" (the warning),
    and the pairs of `nvsim.cluster.ray_worker`.
    """
    import os
    import socket

    host = socket.gethostname()
    yield [("began", f"{host}, process {os.getpid()}")]
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the command line does; must precede any thread pool
    try:
        from nvsim.cluster.versions import versions
    except ImportError:
        yield [("refused", f"{host} has no NVSim, or one without cluster support; install the same one everywhere.")]
        return
    theirs = versions()
    if theirs["NVSim"] != ours["NVSim"]:
        words = (
            f"{host} has NVSim {theirs['NVSim']}, and this machine {ours['NVSim']}; install the same one everywhere."
        )
        yield [("refused", words)]
        return
    other = [f"{name} {theirs[name]} instead of {version}" for name, version in ours.items() if theirs[name] != version]
    if other:
        yield [("warned", f"{host} has {', '.join(other)}: its results may differ in their last digits.")]
    from nvsim.cluster.ray_worker import run_work_call

    yield from run_work_call(order, cores)
