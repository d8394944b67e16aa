"""Compiles the shaders of resources/shaders to programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import resources

if TYPE_CHECKING:
    import moderngl

FOLDER = Path(resources.__file__).parent / "shaders"


def source(name: str, defines: dict[str, str] | None = None) -> str:
    """The text of a shader with `defines` after its version line."""
    text = (FOLDER / name).read_text("utf-8")
    head, version, rest = text.partition("#version 330 core\n")
    lines = "".join(f"#define {key} {value}\n" for key, value in (defines or {}).items())
    return f"{head}{version}{lines}{rest}"


def splat_program(context: moderngl.Context) -> moderngl.Program:
    """The program that draws quads as color times alpha."""
    return context.program(vertex_shader=source("splat.vert"), fragment_shader=source("splat.frag"))


def close_program(context: moderngl.Context) -> moderngl.Program:
    """The program that marks pixels with a transmittance below `least` in the depth buffer."""
    return context.program(vertex_shader=source("screen.vert"), fragment_shader=source("close.frag"))


def composite_program(context: moderngl.Context, sky: bool, levels: int) -> moderngl.Program:
    """The program that draws the splats over a background, with spherical harmonics if `sky`, and with a floor texture
    of `levels` levels."""
    defines = {"SKY": "1"} if sky else {}
    if levels:
        # GLSL 3.30 allows only constants as the index of a sampler, so each level has its own name and line.
        defines["FLOOR"] = str(levels)
        defines["LEVEL_SAMPLERS"] = " ".join(f"uniform sampler2D level{i};" for i in range(levels))
        defines["LEVEL_SUM"] = " ".join(
            f"c += level_colour(level{i}, texels[{i}], share, footprint);" for i in range(levels)
        )
    return context.program(vertex_shader=source("screen.vert"), fragment_shader=source("composite.frag", defines))
