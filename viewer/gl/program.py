"""GLSL: shader files with their includes, and the programs that are linked of them."""

import re
from collections.abc import Mapping
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable

import moderngl
import numpy as np

from milkglass.viewer.gl.context import GLSL_VERSION

SHADER_SUFFIXES = (".glsl", ".vert", ".frag")
SAMPLER_UNIT = 15


def shader_source(name: str) -> str:
    """Return a shader with its includes, each included once.

    After a line `#replace "one.glsl" "other.glsl"`, the other is included in place of the one. Of files that are
    included, the version is left out.
    """
    return _expand(name, set(), {})


@cache
def _shader_files() -> dict[str, Traversable]:
    """Return every shader file by its bare name, which is unique over all rooms."""
    rooms = [room for room in resources.files("milkglass.shaders").iterdir() if room.is_dir()]
    return {file.name: file for room in rooms for file in room.iterdir() if file.name.endswith(SHADER_SUFFIXES)}


def _expand(name: str, seen: set[str], replaced: dict[str, str]) -> str:
    text = _shader_files()[name].read_text(encoding="utf-8")
    if seen:  # a variant includes the whole of another
        text = text.removeprefix(f"#version {GLSL_VERSION}\n")
    seen.add(name)

    def include(match: re.Match[str]) -> str:
        if match["other"] is not None:
            replaced[match["one"]] = match["other"]
            return ""
        wanted = replaced.get(match["name"], match["name"])
        return "" if wanted in seen else _expand(wanted, seen, replaced)

    directive = r'^#(?:include "(?P<name>[\w.]+)"|replace "(?P<one>[\w.]+)" "(?P<other>[\w.]+)")$'
    return re.sub(directive, include, text, flags=re.MULTILINE)


class Program:
    """A linked program whose uniforms are set by name, all of them or none: a missing or unknown one is an error."""

    def __init__(
        self,
        context: moderngl.Context,
        vertex: str,
        fragment: str | None = None,
        *,
        varyings: tuple[str, ...] = (),
    ) -> None:
        self.name = fragment or vertex
        self.program = context.program(
            vertex_shader=shader_source(vertex),
            fragment_shader=shader_source(fragment) if fragment else None,
            varyings=varyings,
        )
        self.uniforms = {n for n in self.program if isinstance(self.program[n], moderngl.Uniform)}

    def set(self, values: Mapping[str, object]) -> None:
        """Set every uniform. Matrices are NumPy row-vector matrices; textures are bound to units of their own.

        Raises
        ------
        KeyError
            If a name is not a uniform of the program, or a uniform is left out.
        """
        if values.keys() != self.uniforms:
            wrong = sorted(values.keys() ^ self.uniforms)
            raise KeyError(f"{self.name}: uniforms set and declared differ in {wrong}")
        unit = 0
        for name, value in values.items():
            uniform = self.program[name]
            assert isinstance(uniform, moderngl.Uniform)
            if isinstance(value, moderngl.Texture | moderngl.Texture3D):
                value.use(unit)
                uniform.value = unit
                unit += 1
            elif isinstance(value, moderngl.Sampler):
                # A sampler overrides what textures of its unit say of themselves: it gets a unit of its own.
                value.use(SAMPLER_UNIT)
                uniform.value = SAMPLER_UNIT
            elif isinstance(value, np.ndarray):
                # NumPy's row-major rows arrive as GLSL's columns: v @ M becomes M * v.
                uniform.write(np.ascontiguousarray(value, np.float32).tobytes())
            else:
                uniform.value = value
