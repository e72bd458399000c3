"""Shader files, their includes, and the programs that are linked of them."""

import re
from pathlib import Path

import moderngl
import numpy as np
import pytest

from milkglass.viewer.gl import program as gl
from milkglass.viewer.gl.context import float_texture, leave_framebuffer
from tests.support.paths import SHADERS
from tests.support.rendering import MeshRenderer

TABLE = re.findall(r"^\| ([\w -]+) \| ((?:\w+\.\w+(?:, )?)+) \|", (SHADERS / "README.md").read_text(), re.MULTILINE)
PROGRAMS = {name: files.split(", ") for name, files in TABLE}
UNIFORM = re.compile(r"^uniform \w+ (\w+)(?:\[\d+\])?;", re.MULTILINE)


def build(context, files):
    varyings = () if len(files) == 2 else tuple(re.findall(r"^out \w+ (\w+);", gl.shader_source(files[0]), re.M))
    return gl.Program(context, *files, varyings=varyings)


# Shaders


@pytest.mark.parametrize("name", PROGRAMS)
def test_every_program_compiles_and_uses_every_uniform_that_it_declares(context, name):
    program = build(context, PROGRAMS[name])
    declared = {uniform for file in PROGRAMS[name] for uniform in UNIFORM.findall(gl.shader_source(file))}
    assert program.uniforms == declared


def test_the_table_of_shaders_is_complete():
    """Every shader belongs to a program of shaders/README.md, every include to a shader."""
    listed = {file for files in PROGRAMS.values() for file in files}
    included = {
        name
        for path in SHADERS.glob("*/*.*")
        for name in re.findall(r'^#(?:include|replace "[^"]+") "(.+)"$', path.read_text(), re.M)
    }
    on_disk = {path.name for path in SHADERS.glob("*/*") if path.suffix in (".vert", ".frag", ".glsl")}
    assert listed | included == on_disk
    assert {Path(name).suffix for name in included - listed} == {".glsl"}


def test_the_renderer_builds_the_programs_of_the_table(context, monkeypatch, shapes):
    """So that the test above compiles what is drawn with; the window's own programs may be more."""
    built = []
    make = gl.Program.__init__

    def record(self, context, *files, **options):
        built.append(list(files))
        make(self, context, *files, **options)

    monkeypatch.setattr(gl.Program, "__init__", record)
    MeshRenderer(context, shapes["cube"])
    assert len(built) >= 8
    assert all(files in PROGRAMS.values() for files in built)


@pytest.mark.parametrize("file", sorted({file for files in PROGRAMS.values() for file in files}))
def test_includes_resolve_once(file):
    source = gl.shader_source(file)
    assert "#include" not in source
    assert source.startswith("#version 330\n")
    definitions = re.findall(r"^\w+ (\w+)\(.*\{$", source, re.MULTILINE)
    assert len(definitions) == len(set(definitions))


def write_shaders(folder, monkeypatch, **texts):
    """Make a folder of one room the package's shaders."""
    (folder / "room").mkdir()
    for name, text in texts.items():
        (folder / "room" / name.replace("_", ".")).write_text(text)
    monkeypatch.setattr(gl.resources, "files", lambda package: folder)
    monkeypatch.setattr(gl, "_shader_files", gl._shader_files.__wrapped__)


def test_a_part_included_by_two_parts_appears_once(tmp_path, monkeypatch):
    write_shaders(
        tmp_path,
        monkeypatch,
        a_frag='first\n#include "b.glsl"\n#include "c.glsl"\n#include "d.glsl"\nlast\n',
        b_glsl='#include "d.glsl"\nb\n',
        c_glsl='c\n#include "d.glsl"\n#include "a.frag"\n',
        d_glsl="d\n",
    )
    assert gl.shader_source("a.frag").split() == ["first", "d", "b", "c", "last"]


def test_a_part_takes_the_place_of_another(tmp_path, monkeypatch):
    write_shaders(
        tmp_path,
        monkeypatch,
        a_frag='#version 330\nfirst\n#include "b.glsl"\nlast\n',
        b_glsl="b\n",
        c_glsl="c\n",
        other_frag='#version 330\n#replace "b.glsl" "c.glsl"\n#include "a.frag"\n',
    )
    assert gl.shader_source("other.frag").split() == ["#version", "330", "first", "c", "last"]


# Uniforms


@pytest.fixture(scope="module")
def program(context):
    return gl.Program(context, "layers_samples.vert", varyings=("v_coordinates",))


@pytest.mark.parametrize(
    ("values", "wrong"),
    [
        ({}, "u_world_to_grid"),
        ({"u_world_to_grid": np.eye(4), "u_unknown": 1.0}, "u_unknown"),
        ({"u_world_to_grids": np.eye(4)}, "u_world_to_grid', 'u_world_to_grids"),
    ],
)
def test_a_missing_or_unknown_uniform_is_an_error(program, values, wrong):
    with pytest.raises(KeyError, match=f"layers_samples.vert.*{wrong}"):
        program.set(values)


def test_a_row_vector_matrix_arrives_as_glsl_expects_it(context, program):
    """NumPy's v @ M is GLSL's M * v: translation in row 3."""
    matrix = np.eye(4)
    matrix[:3, :3] = [[0, 2, 0], [0, 0, 3], [5, 0, 0]]
    matrix[3, :3] = [7, 11, 13]
    program.set({"u_world_to_grid": matrix})
    points = np.array([[1, 2, 3], [-4, 5, 0.5]], np.float32)
    output = context.buffer(reserve=points.nbytes)
    vertices = context.vertex_array(program.program, [(context.buffer(points), "3f", "a_position")])
    leave_framebuffer(context)
    vertices.transform(output, moderngl.POINTS, 2)
    expected = points @ matrix[:3, :3] + matrix[3, :3]
    np.testing.assert_array_equal(np.frombuffer(output.read(), np.float32).reshape(2, 3), expected)


def test_textures_of_one_call_get_units_of_their_own(context):
    composite = build(context, PROGRAMS["composite"])
    samplers = sorted(name for name in composite.uniforms if name.startswith("t_"))
    values = {name: composite.program[name].value for name in composite.uniforms}  # as they are
    values |= {name: float_texture(context, (1, 1)) for name in samplers}
    values["t_exitance"] = context.texture3d((1, 1, 1), 3, dtype="f4")
    composite.set(values)
    assert len(samplers) >= 5
    assert sorted(composite.program[name].value for name in samplers) == list(range(len(samplers)))
