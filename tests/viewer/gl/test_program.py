"""Shader files, their includes, and the programs that are linked of them."""

import re
from pathlib import Path

import moderngl
import numpy as np
import pytest

from milkglass.viewer.gl import program as gl
from milkglass.viewer.gl.constants import CONSTANTS
from milkglass.viewer.gl.context import float_texture, leave_framebuffer
from milkglass.viewer.scene.lights import DirectionalLight, SphereLight
from tests.support.paths import ROOT, SHADERS
from tests.support.rendering import FRONT, MeshRenderer, scene_of

TABLE = re.findall(
    r"^\| ([\w -]+) \| ((?:\w+\.\w+(?:, )?)+) \| ([\w ;-]+) \|", (SHADERS / "README.md").read_text(), re.MULTILINE
)
# (files, switches) by name, of each program and each of its variants
PROGRAMS = {
    f"{name} {switches}".removesuffix(" -"): (files.split(", "), dict.fromkeys(re.findall(r"\w+", switches), True))
    for name, files, variants in TABLE
    for switches in variants.split("; ")
}
SOURCES = {path.name: path.read_text() for path in SHADERS.glob("*/*") if path.suffix in gl.SHADER_SUFFIXES}
UNIFORM = re.compile(r"^uniform \w+ (\w+)(?:\[[^]]+\])?;", re.MULTILINE)


def compiled_lines(file, **switches):
    """Text of a shader without what its switches leave out."""
    lines, kept = [], [True]
    for line in gl.shader_source(file, **switches).text.splitlines():
        if line.startswith("#ifdef "):
            kept.append(switches.get(line.removeprefix("#ifdef ").lower(), False))
        elif line == "#else":
            kept[-1] = not kept[-1]
        elif line == "#endif":
            kept.pop()
        elif all(kept):
            lines.append(line)
    return "\n".join(lines)


def build(context, files, **switches):
    text = compiled_lines(files[0], **switches)
    varyings = () if len(files) == 2 else tuple(re.findall(r"^out \w+ (\w+);", text, re.M))
    return gl.Program(context, *files, varyings=varyings, **switches)


def write_shaders(folder, monkeypatch, **texts):
    """Make a folder the package's shaders; `a_frag` is the text of a.frag."""
    paths = {name.replace("_", "."): folder / name for name in texts}
    for path, text in zip(paths.values(), texts.values(), strict=True):
        path.write_text(text)
    monkeypatch.setattr(gl, "_shader_files", lambda: paths)


# Shaders


@pytest.mark.parametrize("name", PROGRAMS)
def test_every_program_compiles_and_uses_every_uniform_that_it_declares(context, name):
    files, switches = PROGRAMS[name]
    program = build(context, files, **switches)
    declared = {uniform for file in files for uniform in UNIFORM.findall(compiled_lines(file, **switches))}
    assert program.uniforms == declared


@pytest.mark.parametrize("name", [name for name, (_, switches) in PROGRAMS.items() if "detail" not in switches])
def test_a_program_samples_no_more_textures_than_every_driver_has_units(name):
    """OpenGL 3.3 promises 16; colours and relief take more."""
    files, switches = PROGRAMS[name]
    text = compiled_lines(files[-1], **switches)
    assert len(re.findall(r"^uniform \w*sampler\w+ \w+", text, re.MULTILINE)) <= 16


def test_the_table_of_shaders_is_complete():
    """Every shader belongs to a program of shaders/README.md, every include to a shader, every switch to a program."""
    listed = {file for files, _ in PROGRAMS.values() for file in files}
    included = {name for text in SOURCES.values() for name in re.findall(r'^#include "(.+)"$', text, re.M)}
    assert listed | included == SOURCES.keys()
    assert {Path(name).suffix for name in included - listed} == {".glsl"}
    asked = {name for text in SOURCES.values() for name in re.findall(r"^#ifn?def (\w+)$", text, re.M)}
    assert asked == {switch.upper() for _, switches in PROGRAMS.values() for switch in switches}


def test_the_renderer_builds_the_programs_of_the_table(context, monkeypatch, shapes):
    """So that the test above compiles what is drawn with; the window's own programs may be more."""
    built = []
    make = gl.Program.__init__

    def record(self, context, *files, varyings=(), constants=None, **switches):
        built.append((list(files), {name: True for name, is_on in switches.items() if is_on}))
        make(self, context, *files, varyings=varyings, constants=constants, **switches)

    monkeypatch.setattr(gl.Program, "__init__", record)
    MeshRenderer(context, shapes["cube"]).render(scene_of(), samples=1)
    assert len(built) >= 12
    assert all(program in PROGRAMS.values() for program in built)


@pytest.mark.parametrize("name", PROGRAMS)
def test_includes_resolve_once(name):
    files, switches = PROGRAMS[name]
    for file in files:
        assert "#include" not in gl.shader_source(file, **switches).text
        assert gl.shader_source(file, **switches).text.startswith("#version 330\n")
        definitions = re.findall(r"^\w+ (\w+)\(.*\{", compiled_lines(file, **switches), re.MULTILINE)
        assert len(definitions) == len(set(definitions))


def test_a_part_included_by_two_parts_appears_once(tmp_path, monkeypatch):
    write_shaders(
        tmp_path,
        monkeypatch,
        a_frag='#version 330\nfirst\n#include "b.glsl"\n#include "c.glsl"\n#include "d.glsl"\nlast\n',
        b_glsl='#include "d.glsl"\nb\n',
        c_glsl='c\n#include "d.glsl"\n#include "a.frag"\n',
        d_glsl="d\n",
    )
    source = gl.shader_source("a.frag")
    assert [line for line in source.text.splitlines() if line and line[0] != "#"] == ["first", "d", "b", "c", "last"]
    assert source.files == ("a.frag", "b.glsl", "d.glsl", "c.glsl")


def test_a_switch_is_defined_only_if_it_is_on():
    text = gl.shader_source("composite.frag", detail=True, soft=False).text
    assert "\n#define DETAIL\n" in text
    assert "#define SOFT" not in text


@pytest.mark.parametrize("stage", ["vertex", "fragment"])
@pytest.mark.parametrize(
    ("parts", "place"),
    [
        ({"part_glsl": "float f() {\n    return 1.0;\n}\n\nfloat g() { return nowhere; }\n"}, "part.glsl:5"),
        ({"part_glsl": '// b\n#include "b.glsl"\nvoid g() {}\n', "b_glsl": "\nnowhere;\n"}, "b.glsl:2"),
        ({"part_glsl": '#include "b.glsl"\n\nvoid g() { nowhere; }\n', "b_glsl": "\n\n\n\n"}, "part.glsl:3"),
        ({"part_glsl": "float g() { return 0.0; }\n"}, "main.{suffix}:5"),
    ],
)
def test_a_compilers_error_names_file_and_line(context, tmp_path, monkeypatch, stage, parts, place):
    suffix = "vert" if stage == "vertex" else "frag"
    out = "gl_Position" if stage == "vertex" else "o_colour"
    declared = "" if stage == "vertex" else "out vec4 o_colour;"
    main = f'#version 330\n{declared}\n#include "part.glsl"\nvoid main() {{\n    {out} = vec4(nowhere);\n}}\n'
    if "main" not in place:
        main = main.replace("nowhere", "1.0")
    good = {
        "fine_vert": "#version 330\nvoid main() { gl_Position = vec4(0.0); }\n",
        "fine_frag": "#version 330\nout vec4 o;\nvoid main() { o = vec4(0.0); }\n",
    }
    write_shaders(tmp_path, monkeypatch, **{f"main_{suffix}": main}, **parts, **good)
    files = ("main.vert", "fine.frag") if stage == "vertex" else ("fine.vert", "main.frag")
    with pytest.raises(moderngl.Error) as caught:
        gl.Program(context, *files)
    assert re.search(rf"^{re.escape(place.format(suffix=suffix))}\b", str(caught.value), re.MULTILINE)


@pytest.mark.parametrize(
    ("message", "named"),
    [
        ("0:20007(5): error: `x' undeclared", "c.glsl:7(5): error: `x' undeclared"),
        ("0(10012) : error C1503: undefined variable", "b.glsl:12 : error C1503: undefined variable"),
        ("ERROR: 0:3: 'x' : undeclared identifier", "ERROR: a.frag:3: 'x' : undeclared identifier"),
        ("GLSL Compiler failed\n\n0:1(1): error\nsee 0:1", "GLSL Compiler failed\n\na.frag:1(1): error\nsee 0:1"),
    ],
)
def test_the_messages_of_several_compilers_are_read(message, named):
    assert gl.ShaderSource("", ("a.frag", "b.glsl", "c.glsl")).named(message) == named


# Constants


def test_no_shader_defines_a_constant_of_pythons():
    for file, text in SOURCES.items():
        defined = re.findall(r"^\s*const \w+ (\w+)", text, re.M) + re.findall(r"^\s*#define (\w+)", text, re.M)
        assert not CONSTANTS.keys() & set(defined), file
        assert "#define" not in text, f"{file}: a constant is a const, a switch comes from Python"


def test_every_constant_of_pythons_is_used_by_a_shader():
    words = {word for text in SOURCES.values() for word in re.findall(r"\w+", text)}
    assert CONSTANTS.keys() <= words


def test_constants_that_python_and_shaders_share_by_a_comment_are_injected():
    """A number that says of itself that a shader has it too belongs into the list."""
    for path in [*(ROOT / "core").rglob("*.py"), *(ROOT / "viewer").rglob("*.py")]:
        assert not re.search(r"= .*#.*\bas in (?:the shader|\w+\.(?:glsl|frag|vert))", path.read_text()), path


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("PI", "3.141592653589793"),
        ("LUMINANCE", "vec3(0.2126, 0.7152, 0.0722)"),
        ("SHEET_NEAR", "vec2(0.5, 1.0)"),
        ("LIGHT_POINT", "1"),
        ("NEAREST_LIGHT", "1e-06"),
    ],
)
def test_constants_are_glsls_literals(name, value):
    assert f"\n#define {name} {value}\n" in gl.shader_source("fullscreen.vert").text


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
    composite = build(context, PROGRAMS["composite"][0])
    samplers = sorted(name for name in composite.uniforms if name.startswith("t_"))
    values = {name: composite.program[name].value for name in composite.uniforms}  # as they are
    values |= {name: float_texture(context, (1, 1)) for name in samplers}
    values["t_exitance"] = context.texture3d((1, 1, 1), 3, dtype="f4")
    composite.set(values)
    assert len(samplers) >= 5
    assert sorted(composite.program[name].value for name in samplers) == list(range(len(samplers)))


def drawn_values(context, program, textures):
    """What a program puts into one pixel, (4,)."""
    target = context.framebuffer([float_texture(context, (1, 1))])
    target.use()
    context.enable_only(moderngl.NOTHING)
    program.set(textures)
    context.vertex_array(program.program, []).render(vertices=3)
    return np.frombuffer(target.read(components=4, dtype="f4"), np.float32)


def test_neither_samplers_nor_textures_share_a_unit_or_leave_one_behind(context, tmp_path, monkeypatch):
    """A sampler overrides what textures of its unit say of themselves, in this draw and in those after it."""
    n = 16  # units that every driver has
    names = [f"t_{i}" for i in range(n)]
    declared = "".join(f"uniform sampler2D {name};\n" for name in names)
    read = [f"texture({name}, vec2(0.5)).r" for name in names]
    first, rest = " + ".join(read[: n - 3]), ", ".join(read[n - 3 :])
    text = f"#version 330 core\n{declared}out vec4 o_values;\nvoid main() {{ o_values = vec4({first}, {rest}); }}\n"
    triangle = SOURCES["fullscreen.vert"]
    write_shaders(tmp_path, monkeypatch, fullscreen_vert=triangle, read_frag=text)
    program = gl.Program(context, "fullscreen.vert", "read.frag")
    texture = context.texture((2, 1), 1, np.array([0.0, 1.0], np.float32), dtype="f4")
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    nearest = context.sampler(filter=(moderngl.NEAREST, moderngl.NEAREST), texture=texture)
    linear = context.sampler(filter=(moderngl.LINEAR, moderngl.LINEAR), texture=texture)
    both = {**dict.fromkeys(names, texture), names[-2]: nearest, names[-1]: linear}
    filtered = drawn_values(context, program, both) == [0.5 * (n - 3), 0.5, 0.5, 0.5]
    np.testing.assert_array_equal(filtered, [True, True, False, True])
    for name in names:
        drawn_values(context, program, {**both, name: nearest})
    filtered = drawn_values(context, program, dict.fromkeys(names, texture))
    np.testing.assert_array_equal(filtered, [0.5 * (n - 3), 0.5, 0.5, 0.5])


# Cases of a shader that is drawn over the whole picture

CASES = """#version 330
uniform bool u_tinted;
uniform int u_kind;
uniform int u_count;
uniform float u_gain;
uniform sampler2D t_tint;
out vec4 o_values;
void main() {
    o_values = vec4(u_kind, u_count, 0.0, 1.0);
    if (u_tinted) o_values.b = texelFetch(t_tint, ivec2(0), 0).r;
    if (u_gain > 0.0) o_values *= u_gain;
}
"""


@pytest.fixture
def full_screen(context, tmp_path, monkeypatch):
    write_shaders(tmp_path, monkeypatch, fullscreen_vert=SOURCES["fullscreen.vert"], cases_frag=CASES)
    return gl.FullScreen(context, "cases.frag", "u_kind", "u_gain")


@pytest.fixture
def linked(monkeypatch):
    """Programs that are linked from now on."""
    programs, make = [], gl.Program.__init__
    monkeypatch.setattr(gl.Program, "__init__", lambda self, *a, **k: (programs.append(self), make(self, *a, **k))[1])
    return programs


def test_each_case_of_a_shader_has_a_program_without_what_it_does_not_use(context, full_screen, linked):
    tint = context.texture((1, 1), 1, np.array([0.5], np.float32), dtype="f4")
    target = context.framebuffer([float_texture(context, (1, 1))])
    seen = []
    for tinted, kind, count, gain in [(True, 2, 3, 0.0), (False, 2, 3, 0.0), (False, 2, 4, 0.5), (True, 2, 5, 0.0)]:
        values = {"u_tinted": tinted, "u_kind": kind, "u_count": count, "u_gain": gain, "t_tint": tint}
        target.use()
        context.enable_only(moderngl.NOTHING)
        full_screen.prepared(values).render(vertices=3)
        seen.append(np.frombuffer(target.read(components=4, dtype="f4"), np.float32).tolist())
    assert seen == [[2, 3, 0.5, 1], [2, 3, 0, 1], [1, 2, 0, 0.5], [2, 5, 0.5, 1]]
    assert [program.uniforms for program in linked] == [{"u_count", "t_tint"}, {"u_count"}, {"u_count", "u_gain"}]


@pytest.mark.parametrize(("change", "wrong"), [({"u_unknown": 1}, "u_unknown"), ({"u_count": None}, "u_count")])
def test_a_case_asks_for_its_uniforms_and_knows_no_others(context, full_screen, change, wrong):
    values = {"u_tinted": False, "u_kind": 1, "u_count": 1, "u_gain": 0.0} | change
    given = {name: value for name, value in values.items() if value is not None}
    with pytest.raises(KeyError, match=wrong):
        full_screen.prepared(given)


@pytest.mark.parametrize(
    "assignments",
    [["transport.method=diffusion"], ["specular.model=phong"]],
)
def test_cases_change_no_pixel(context, shapes, monkeypatch, assignments):
    """Beside the same shaders that take each case by its uniforms."""

    def without_cases(self, context, fragment, *_):
        make(self, context, fragment)
        self._choices = []

    lamps = DirectionalLight(FRONT), SphereLight((60.0, 10.0, 80.0), (1e4, 2e4, 3e4), radius_mm=8.0)
    scene = scene_of("environment.builtin=studio", *assignments, method="ewald", lights=lamps)
    pictures, make = [MeshRenderer(context, shapes["knot"]).render(scene, samples=1)], gl.FullScreen.__init__
    monkeypatch.setattr(gl.FullScreen, "__init__", without_cases)
    pictures.append(MeshRenderer(context, shapes["knot"]).render(scene, samples=1))
    first, second = (picture.radiance for picture in pictures)
    assert np.ptp(first) > 0.0
    np.testing.assert_allclose(first, second, rtol=1e-4, atol=1e-6 * first.max())
