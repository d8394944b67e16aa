"""A network that the user brings, opened with onnxruntime."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from nvsim.errors import InputError
from nvsim.files.regular import opened

TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(int64)": np.int64,
    "tensor(int32)": np.int32,
}
"""What an input of the network takes, by onnxruntime's word for it."""


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
