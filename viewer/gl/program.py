"""GLSL: shader files with their includes, and the programs that are linked of them."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

import moderngl
import numpy as np

from milkglass.viewer.gl.constants import CONSTANTS

SHADER_SUFFIXES = (".glsl", ".vert", ".frag")

INCLUDE = re.compile(r'#include "([\w.]+)"')
UNIFORM = re.compile(r"^uniform (\w+) (\w+)(?=[;\[])", re.MULTILINE)
# `#line` numbers the lines of file k from k FILE_LINES on: Mesa forgets a source string's number within expressions.
FILE_LINES = 10_000
# Where compilers say that an error is: "0:12(5): error" (Mesa), "0(12) : error" (NVIDIA), "ERROR: 0:12: ..." (others).
ERROR_PLACE = re.compile(r"^(?P<before>(?:ERROR|WARNING): )?\d+[:(](?P<line>\d+)\)?", re.MULTILINE)


@dataclass(frozen=True)
class ShaderSource:
    """Text of one shader as the compiler takes it.

    Attributes
    ----------
    text : str
        With its includes, switches and constants; `#line` directives say which file a line is of, and its number there.
    files : tuple of str
        The files that it is made of.
    """

    text: str
    files: tuple[str, ...]

    def named(self, message: str) -> str:
        """Return a compiler's message with the places of errors by file and line, such as ``sheet.glsl:12``."""

        def place(match: re.Match[str]) -> str:
            file, line = divmod(int(match["line"]), FILE_LINES)
            return f"{match['before'] or ''}{self.files[file]}:{line}"

        return ERROR_PLACE.sub(place, message)

    @property
    def uniforms(self) -> dict[str, str]:
        """Return the types of all uniforms by name, of whatever switch."""
        return {name: kind for kind, name in UNIFORM.findall(self.text)}


def shader_source(name: str, constants: Mapping[str, float] | None = None, **switches: bool) -> ShaderSource:
    """Return a shader with its includes, each included once.

    After the line of the version it defines `SWITCH` for each switch that is true, in capitals, and all of
    `viewer.gl.constants.CONSTANTS`. Uniforms that are `constants`, by name, are declared as such.
    """
    files: list[str] = []
    version, text = _expanded(name, files).split("\n", 1)
    defines = [switch.upper() for switch, is_on in switches.items() if is_on]
    defines += [f"{constant} {value}" for constant, value in CONSTANTS.items()]
    lines = [version, *(f"#define {define}" for define in defines), _line(0, 2), text]
    fixed = constants or {}

    def declared(match: re.Match[str]) -> str:
        kind, uniform = match.groups()
        return f"const {kind} {uniform} = {kind}({float(fixed[uniform])})" if uniform in fixed else match[0]

    return ShaderSource(UNIFORM.sub(declared, "\n".join(lines)), tuple(files))


@cache
def _shader_files() -> dict[str, Traversable]:
    """Return every shader file by its bare name, which is unique over all rooms."""
    rooms = [room for room in resources.files("milkglass.shaders").iterdir() if room.is_dir()]
    return {file.name: file for room in rooms for file in room.iterdir() if file.name.endswith(SHADER_SUFFIXES)}


def _expanded(name: str, files: list[str]) -> str:
    """Return the text of a file with its includes; appends the names of all of them to `files`."""
    number = len(files)
    files.append(name)
    lines = []
    for i, line in enumerate(_shader_files()[name].read_text(encoding="utf-8").splitlines(), start=1):
        include = INCLUDE.fullmatch(line)
        if include is None:
            lines.append(line)
        elif include[1] in files:
            lines.append("")
        else:
            lines += [_line(len(files), 1), _expanded(include[1], files), _line(number, i + 1)]
    return "\n".join(lines)


def _line(file: int, line: int) -> str:
    return f"#line {FILE_LINES * file + line}"


class Program:
    """A linked program whose uniforms are set by name, all of them or none: a missing or unknown one is an error.

    Parameters
    ----------
    context : moderngl.Context
    vertex, fragment : str
        Names of shader files; without a fragment shader it is for transform feedback.
    varyings : tuple of str
        Outputs that transform feedback captures.
    constants : mapping, optional
        Values of scalar uniforms that are compiled in, by name; what they leave no use for is left out.
    **switches : bool
        Variants of the shaders, see the table of shaders/README.md; those that are true are defined in both.

    Raises
    ------
    moderngl.Error
        If a shader does not compile; the message names its file and line.
    """

    def __init__(
        self,
        context: moderngl.Context,
        vertex: str,
        fragment: str | None = None,
        *,
        varyings: tuple[str, ...] = (),
        constants: Mapping[str, float] | None = None,
        **switches: bool,
    ) -> None:
        self.name = " ".join([fragment or vertex, *(switch for switch, is_on in switches.items() if is_on)])
        sources = [shader_source(name, constants, **switches) for name in (vertex, fragment) if name is not None]
        try:
            self.program = context.program(
                vertex_shader=sources[0].text,
                fragment_shader=sources[1].text if fragment else None,
                varyings=varyings,
            )
        except moderngl.Error as problem:
            failed = sources[-1] if "fragment_shader" in str(problem) else sources[0]
            raise moderngl.Error(failed.named(str(problem))) from None
        self.uniforms = {n for n in self.program if isinstance(self.program[n], moderngl.Uniform)}
        self._idle: set[str] = set()
        if constants:
            self._idle = constants.keys() | {name for source in sources for name in source.uniforms} - self.uniforms

    def set(self, values: Mapping[str, object]) -> None:
        """Set every uniform. Matrices are NumPy row-vector matrices; textures are bound to units of their own.

        Values of constants, and of what these leave no use for, may be among them.

        Raises
        ------
        KeyError
            If a name is not a uniform of the program, or a uniform is left out.
        """
        wrong = (values.keys() ^ self.uniforms) - self._idle
        if wrong:
            raise KeyError(f"{self.name}: uniforms set and declared differ in {sorted(wrong)}")
        unit = 0
        for name, value in values.items():
            if name in self._idle:
                continue
            uniform = self.program[name]
            assert isinstance(uniform, moderngl.Uniform)
            if isinstance(value, moderngl.Texture | moderngl.Texture3D | moderngl.TextureArray | moderngl.Sampler):
                # A sampler stays bound, and overrides what later textures of its unit say of themselves.
                self.program.ctx.clear_samplers(unit, unit + 1)
                value.use(unit)
                uniform.value = unit
                unit += 1
            elif isinstance(value, np.ndarray):
                # NumPy's row-major rows arrive as GLSL's columns: v @ M becomes M * v.
                uniform.write(np.ascontiguousarray(value, np.float32).tobytes())
            else:
                uniform.value = value


class FullScreen:
    """A fragment shader on a triangle over the whole picture, linked for each case that it is drawn with.

    What is the same at all pixels and says which way they go is a constant, as a driver without a GPU (llvmpipe)
    computes both ways of every branch that is left: each uniform that is a `bool`, and those of `choices`.

    Parameters
    ----------
    context : moderngl.Context
    fragment : str
        Name of a shader file.
    *choices : str
        Uniforms: `int` of few values, or `float` that turns something off where it is 0, and is a constant there.
    """

    def __init__(self, context: moderngl.Context, fragment: str, *choices: str) -> None:
        self._context, self._fragment = context, fragment
        declared = shader_source(fragment).uniforms
        self._choices = [name for name, kind in declared.items() if kind == "bool" or name in choices]
        self._cases: dict[tuple[object, ...], tuple[Program, moderngl.VertexArray]] = {}

    def prepared(self, values: Mapping[str, Any], **switches: bool) -> moderngl.VertexArray:
        """Return the triangle of a case, with its uniforms set; see `Program` for arguments and errors."""
        given = {name: values[name] for name in self._choices if name in values}
        constants = {name: value for name, value in given.items() if not isinstance(value, float) or value == 0.0}
        key = *switches.items(), *constants.items()
        if key not in self._cases:
            program = Program(
                self._context, "fullscreen.vert", self._fragment, varyings=(), constants=constants, **switches
            )
            self._cases[key] = program, self._context.vertex_array(program.program, [])
        program, triangle = self._cases[key]
        program.set(values)
        return triangle
