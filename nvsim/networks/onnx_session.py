"""A network that the user brings, opened with onnxruntime."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from nvsim.errors import InputError
from nvsim.files.regular import opened

Provider = Literal["auto", "cpu", "cuda"]
_PROVIDERS = {
    "auto": ("CUDAExecutionProvider", "CPUExecutionProvider"),
    "cpu": ("CPUExecutionProvider",),
    "cuda": ("CUDAExecutionProvider",),
}
TYPES: dict[str, Any] = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(int64)": np.int64,
    "tensor(int32)": np.int32,
    "tensor(uint8)": np.uint8,
    "tensor(bool)": np.bool_,
}
"""What an input of the network takes, by onnxruntime's word for it."""


def providers(wanted: Provider) -> list[str]:
    """What onnxruntime is to run on, the best first. Raises InputError where it can run on none of it."""
    import onnxruntime

    here = onnxruntime.get_available_providers()
    found = [name for name in _PROVIDERS[wanted] if name in here]
    if not found:
        raise InputError(
            f"This onnxruntime cannot run on {wanted if wanted != 'auto' else 'cpu or cuda'} (it has "
            f"{', '.join(here) or 'nothing'}); install onnxruntime{'-gpu' if wanted == 'cuda' else ''}."
        )
    return found


def session(path: Path, providers: Sequence[str] = ("CPUExecutionProvider",)) -> Any:
    """An `onnxruntime.InferenceSession` on the first of `providers` that can run it. Raises InputError for a file that
    cannot be loaded."""
    import onnxruntime

    with opened(path):
        pass  # a pipe is refused, and not waited for
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = os.cpu_count() or 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=list(providers))
    except Exception as error:  # onnxruntime's classes share no base but this one
        words = (str(error).strip().splitlines() or [type(error).__name__])[0][:160]
        raise InputError(f"{path} cannot be loaded as an ONNX network ({words}); export it again.") from error
