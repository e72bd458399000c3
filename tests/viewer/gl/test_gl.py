"""The context, the shaders and the GPU's limits."""

import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import moderngl
import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.grid.layers import LayerGrid
from milkglass.viewer.gl import context as gl
from milkglass.viewer.passes.layers import LayersPass
from tests.support.paths import SHADERS
from tests.support.rendering import MeshRenderer, scene_of

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


def test_a_part_included_by_two_parts_appears_once(tmp_path, monkeypatch):
    (tmp_path / "a.frag").write_text('first\n#include "b.glsl"\n#include "c.glsl"\n#include "d.glsl"\nlast\n')
    (tmp_path / "b.glsl").write_text('#include "d.glsl"\nb\n')
    (tmp_path / "c.glsl").write_text('c\n#include "d.glsl"\n#include "a.frag"\n')
    (tmp_path / "d.glsl").write_text("d\n")
    monkeypatch.setattr(gl, "_shader_files", lambda: {path.name: path for path in tmp_path.iterdir()})
    assert gl.shader_source("a.frag").split() == ["first", "d", "b", "c", "last"]


def test_a_part_takes_the_place_of_another(tmp_path, monkeypatch):
    (tmp_path / "a.frag").write_text('#version 330\nfirst\n#include "b.glsl"\nlast\n')
    (tmp_path / "b.glsl").write_text("b\n")
    (tmp_path / "c.glsl").write_text("c\n")
    (tmp_path / "other.frag").write_text('#version 330\n#replace "b.glsl" "c.glsl"\n#include "a.frag"\n')
    monkeypatch.setattr(gl, "_shader_files", lambda: {path.name: path for path in tmp_path.iterdir()})
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
    gl.leave_framebuffer(context)
    vertices.transform(output, moderngl.POINTS, 2)
    expected = points @ matrix[:3, :3] + matrix[3, :3]
    np.testing.assert_array_equal(np.frombuffer(output.read(), np.float32).reshape(2, 3), expected)


def test_textures_of_one_call_get_units_of_their_own(context):
    composite = build(context, PROGRAMS["composite"])
    samplers = sorted(name for name in composite.uniforms if name.startswith("t_"))
    values = {name: composite.program[name].value for name in composite.uniforms}  # as they are
    values |= {name: gl.float_texture(context, (1, 1)) for name in samplers}
    values["t_exitance"] = context.texture3d((1, 1, 1), 3, dtype="f4")
    composite.set(values)
    assert len(samplers) >= 5
    assert sorted(composite.program[name].value for name in samplers) == list(range(len(samplers)))


# The context


def test_importing_makes_no_context():
    """Every module of the package, in a process of its own, where making a context is an error."""
    code = """
import importlib, pkgutil, sys
import glcontext, moderngl
def refuse(*args, **kwargs):
    raise SystemExit("a context was made")
moderngl.create_context = moderngl.create_standalone_context = glcontext.get_backend_by_name = refuse
import milkglass
for module in pkgutil.walk_packages(milkglass.__path__, "milkglass."):
    importlib.import_module(module.name)
from milkglass import Frame, Scene, render
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=SHADERS.parent, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_there_is_one_context(context):
    assert gl.headless_context() is context
    assert context.version_code >= 330


@pytest.mark.parametrize("reason", ["libEGL.so.1: cannot open shared object file.", ""])
def test_a_machine_without_egl_is_told_what_to_install(monkeypatch, reason):
    def fail(**options):
        raise Exception(reason)

    monkeypatch.setattr(gl.moderngl, "create_context", fail)
    with pytest.raises(InputError) as caught:
        gl.headless_context.__wrapped__()
    sentence = str(caught.value)
    assert sentence.startswith(f"cannot create an OpenGL 3.3 context ({reason.rstrip('.') or 'Exception'});")
    assert "apt-get install libegl1 libgl1 libgl1-mesa-dri" in sentence
    assert "\n" not in sentence


def test_a_framebuffer_may_go_while_it_is_bound_if_left_first(context):
    framebuffer = context.simple_framebuffer((4, 4))
    framebuffer.use()
    gl.leave_framebuffer(context)
    framebuffer.release()
    context.simple_framebuffer((2, 2)).release()
    assert context.error == "GL_NO_ERROR"


# Limits


def with_limits(**limits):
    return SimpleNamespace(info={f"GL_{name}": value for name, value in limits.items()})


@pytest.mark.parametrize(
    ("texture", "viewport", "size", "largest"),
    [
        (4096, (8192, 8192), (4097, 16), 4096),
        (8192, (8192, 2048), (16, 2049), 2048),
        (16384, (16384, 16384), (16385, 16385), 16384),
    ],
)
def test_an_image_beyond_the_limits_names_the_largest_side(texture, viewport, size, largest):
    limited = with_limits(MAX_TEXTURE_SIZE=texture, MAX_VIEWPORT_DIMS=viewport)
    gl.check_image_size(limited, (largest, largest))
    with pytest.raises(InputError, match=rf"image_size = {size[0]} x {size[1]} .* largest side is {largest}$"):
        gl.check_image_size(limited, size)


def grid_of(n_layers, height, width):
    return LayerGrid(n_layers, height, width, 1.0, 1.0, tuple(map(tuple, np.eye(4))))


@pytest.mark.parametrize(
    ("side", "renderer", "shape"),
    [
        (512, "some GPU", (8, 700, 400)),
        (512, "some GPU", (8, 100, 513)),
        (2048, "llvmpipe (LLVM 15.0.6, 256 bits)", (128, 1024, 1024)),
        (2048, "llvmpipe (LLVM 15.0.6, 256 bits)", (128, 1024, 800)),
    ],
)
def test_layers_beyond_the_limits_name_the_largest_resolution_that_fits(context, side, renderer, shape):
    layers = LayersPass(context)
    layers._context = with_limits(MAX_3D_TEXTURE_SIZE=side, RENDERER=renderer)
    with pytest.raises(InputError, match=r"transport\.resolution = ") as caught:
        layers.check_limits(grid_of(*shape))
    largest = int(re.search(r"the largest that fits is (\d+)$", str(caught.value))[1])
    longest = max(shape[1:])
    scaled = [tuple(round(n * r / longest) for n in shape[1:]) for r in (largest, largest + 2)]
    layers.check_limits(grid_of(shape[0], *scaled[0]))
    with pytest.raises(InputError):
        layers.check_limits(grid_of(shape[0], *scaled[1]))


def test_more_layers_than_the_gpu_takes_name_the_largest_number(context):
    layers = LayersPass(context)
    layers._context = with_limits(MAX_3D_TEXTURE_SIZE=100, RENDERER="some GPU")
    with pytest.raises(InputError, match=r"transport.layers = 101 .* the largest is 100$"):
        layers.check_limits(grid_of(101, 16, 16))


def test_limits_are_checked_before_any_work(context, on_llvmpipe, shapes):
    if not on_llvmpipe:
        pytest.skip("1024 x 1024 x 128 fits other GPUs")
    renderer = MeshRenderer(context, shapes["ball"])
    with pytest.raises(InputError, match=r"1024 with 128 layers .* fits is 724$"):
        renderer.render(scene_of("transport.layers=128", "transport.resolution=1024"))
    assert renderer.timings.keys() <= {"model", "transport"}


def test_a_failed_allocation_is_one_sentence(context):
    def fail():
        raise moderngl.Error("cannot create texture")

    with pytest.raises(InputError, match=r"^the GPU cannot hold a volume \(cannot create texture\); ask for fewer"):
        gl.checked(context, fail, "a volume")
    full = SimpleNamespace(error="GL_OUT_OF_MEMORY")
    with pytest.raises(InputError, match=r"^the GPU has no memory left for a volume; ask for fewer"):
        gl.checked(full, lambda: None, "a volume")
