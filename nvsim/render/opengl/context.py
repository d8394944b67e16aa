"""An OpenGL context without a window: EGL on Linux, which needs no X server; the default of the system elsewhere."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from nvsim.errors import InputError

if TYPE_CHECKING:
    import moderngl


def standalone_context() -> moderngl.Context:
    """A new context, current in this thread. Raises InputError with the reason if none can be created."""
    import moderngl

    try:
        settings: dict[str, Any] = {"backend": "egl"} if sys.platform.startswith("linux") else {}
        return moderngl.create_context(require=330, standalone=True, **settings)
    except Exception as error:  # the loader raises plain Exception, the binding its own types
        raise InputError(
            f"OpenGL 3.3 cannot be used here ({error}); install a graphics driver (on Debian libegl1 and "
            "libgl1-mesa-dri), or render on the CPU."
        ) from error
