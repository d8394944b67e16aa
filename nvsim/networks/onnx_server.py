"""The child process that runs onnxruntime; see `nvsim.networks.onnx_session`.

A foreign network may loop forever, use all memory, or crash the library, both when it is loaded and when it runs. This
module has few imports, because the child imports it at its start.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from nvsim.errors import InputError
from nvsim.files.reading import reading


@dataclass(frozen=True)
class Node:
    """An input or an output of a file. A side of the shape is a number, a name, or None if it is dynamic."""

    name: str
    type: str
    shape: tuple[int | str | None, ...]


@dataclass(frozen=True)
class LoadRequest:
    """Request to load a file, which replaces the file loaded so far. The answer is Loaded or Failed."""

    path: Path
    providers: tuple[str, ...]
    threads: int


@dataclass(frozen=True)
class LoadedModel:
    """metadata  properties stored in the file
    provider  the first of the providers that onnxruntime could use
    """

    inputs: tuple[Node, ...]
    outputs: tuple[Node, ...]
    metadata: dict[str, str]
    provider: str


@dataclass(frozen=True)
class RunRequest:
    """Request for the outputs `names` (None for all) for inputs by name. The answer is a list of arrays or Failed."""

    names: list[str] | None
    feed: dict[str, Any]


@dataclass(frozen=True)
class RunFailure:
    """The reason why the network does not run, in the words of onnxruntime."""

    reason: str


def import_onnxruntime() -> ModuleType:
    """The module `onnxruntime`, with its telemetry disabled unless the environment enables it.

    By default, onnxruntime 1.29 and newer sends data about each network to its vendor, also on Linux, and writes a
    device identifier into the user's cache folder. It reads the variable once, when it is imported.
    """
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime

    module: ModuleType = onnxruntime
    return module


class OnnxServer:
    """Processes Load and Run requests."""

    def __init__(self) -> None:
        self._onnxruntime = import_onnxruntime()
        self._onnxruntime.set_default_logger_severity(4)
        self._session: Any = None

    def __call__(self, request: LoadRequest | RunRequest) -> LoadedModel | RunFailure | list[Any]:
        if isinstance(request, LoadRequest):
            return self._load(request)
        try:
            return list(self._session.run(request.names, request.feed))
        except Exception as error:  # onnxruntime's exceptions have no narrower common base class
            return RunFailure(_reason_of(error))

    def _load(self, request: LoadRequest) -> LoadedModel | RunFailure:
        self._session = None  # frees the memory of the previous session
        options = self._onnxruntime.SessionOptions()
        options.intra_op_num_threads = request.threads
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.add_session_config_entry("session.load_model_format", "ONNX")  # the format whose files are checked
        options.log_severity_level = 4
        try:
            session = self._onnxruntime.InferenceSession(str(request.path), options, providers=list(request.providers))
        except Exception as error:
            return RunFailure(_reason_of(error))
        with reading(request.path, "an ONNX network", "export it again"):
            found = LoadedModel(
                _nodes(session.get_inputs()),
                _nodes(session.get_outputs()),
                dict(session.get_modelmeta().custom_metadata_map),
                session.get_providers()[0],
            )
        self._session = session
        return found


def _nodes(nodes: Any) -> tuple[Node, ...]:
    return tuple(Node(n.name, n.type, tuple(n.shape if n.shape is not None else ())) for n in nodes)


def _reason_of(error: Exception) -> str:
    """The reason of an onnxruntime exception. Raises MemoryError if memory ran out, and passes InputError through."""
    if isinstance(error, InputError | MemoryError):
        raise error
    if re.search(r"bad_alloc|Failed to allocate memory|alloc\w* failed", str(error)):
        raise MemoryError from error
    return reason(error)


_SOURCE = re.compile(r"(?:[\w./\\-]*[\\/])?\w+\.(?:cc|cpp|cu|h|hpp|cuh):\d+\s*")
"""A source line of onnxruntime, which is followed by the signature of the function."""
_MOST = 240


def reason(error: Exception) -> str:
    """The reason why a network cannot be loaded or run, in one line.

    It is the last clause of onnxruntime's message, without the C++ path and signature before it. A long reason keeps
    its end."""
    said = " ".join(str(error).split()) or type(error).__name__
    said = re.sub(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ", "", said)
    said = re.sub(r"^Load model from .*? failed:\s*", "", said)
    said = said.split(" Status Message: ")[-1]
    places = list(_SOURCE.finditer(said))
    if places:
        before, said = said[: places[-1].start()].strip(), _behind_signature(said[places[-1].end() :])
        said = said or before
    said = said.removeprefix("Fatal error: ").rstrip(". ")
    if len(said) > _MOST:
        said = "..." + said[-_MOST:]
    return "".join(c if c.isprintable() else "?" for c in said)


def _behind_signature(text: str) -> str:
    """`text` without the C++ function at its start: "void onnxruntime::f(const A<B()>&) const [with T = C] ...". The
    bare name of a function is also removed: "GetExtDataFromTensorProto ..."."""
    start = text.find("(")
    if start > 0 and re.fullmatch(r"[\w:<>,*&~\s\[\]=]+(?:operator)?", text[:start]) and "::" in text[:start]:
        depth = 0
        for i, letter in enumerate(text[start:], start):
            depth += (letter == "(") - (letter == ")")
            if depth == 0:
                rest = re.sub(r"^(?:\s*(?:const|noexcept|&&?|\[with [^\]]*\]))*\s*", "", text[i + 1 :])
                return rest.strip()
    return re.sub(r"^[A-Z]\w*[a-z][A-Z]\w*\s+", "", text).strip()
