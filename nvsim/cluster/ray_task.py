"""The task that Ray runs on a worker. It travels as a value, so that a worker without NVSim, or with another one, can
say so: nothing of NVSim is used before its version is known."""

from __future__ import annotations

from collections.abc import Iterator


def serve(order: bytes, cores: int, ours: dict[str, str]) -> Iterator[list[tuple[str, object]]]:
    """Does a pickled order with so many threads where the version of NVSim is that of `ours`. Yields pairs of a word
    and what belongs to it: "began" (machine, process), "refused" and why, "warned" and of what, then those of
    `nvsim.cluster.ray_worker`."""
    import os
    import socket

    host = socket.gethostname()
    yield [("began", f"{host}, process {os.getpid()}")]
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the command line does, before any thread pool is made
    try:
        from nvsim.cluster.versions import versions
    except ImportError:
        yield [("refused", f"{host} has no NVSim, or one that knows no clusters; install the same one everywhere.")]
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
    from nvsim.cluster.ray_worker import work

    yield from work(order, cores)
