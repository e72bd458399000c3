import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import milkglass
from milkglass.core.errors import InputError
from milkglass.viewer.bench.run import PARTS
from milkglass.viewer.commands import cli
from milkglass.viewer.commands.options import FLAGS
from milkglass.viewer.files import images
from milkglass.viewer.render import renderer
from milkglass.viewer.scene.scene import default_scene
from tests.support.paths import ROOT


@pytest.fixture(autouse=True)
def in_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)


@pytest.fixture
def rendered(monkeypatch):
    """A renderer that needs no OpenGL: records the scenes and saves 16 x 16 grey pictures."""
    calls = []

    def save(path):
        if path.endswith(".png"):
            images.write_png(path, np.full((16, 16, 3), rendered.level, np.uint8))

    def render(scene, *, samples, seed, progress=None):
        calls.append((scene, samples, seed))
        return SimpleNamespace(
            save=save,
            timings={"layers": 1.25},
            warnings=rendered.warnings,
            quality=SimpleNamespace(summary="layered, 8 layers"),
            remarks=("coarse",),
            parts=("rays: none",),
            log_average=0.25,
        )

    rendered = SimpleNamespace(calls=calls, level=100, warnings=())
    for name in ("render", "render_image"):
        monkeypatch.setattr(renderer, name, render)
    return rendered


BAD_LINES = [
    ("rendr", "no such command 'rendr'. Did you mean 'render'?"),
    ("dragon.ply", "no such command 'dragon.ply'; to show a model, write `milkglass view MODEL`."),
    ("--laers 3", "no such option: --laers; did you mean --version?"),
    ("render", "missing option '--output' / '-o'."),
    ("render --output", "option '--output' requires an argument."),
    ("render --output a.png --laers 3", "no such option: --laers; did you mean --layers"),
    ("render --output a.jpg", "a.jpg must end in .png or .exr"),
    ("render -o a.jpg", "a.jpg must end in .png or .exr"),
    ("render --output no/a.png", "The folder no does not exist"),
    ("render --output a.png --output b.gif", "b.gif must end in .png or .exr"),
    ("render --output a.png --samples 0", "invalid value for '--samples'"),
    ("render --output a.png --samples many", "invalid value for '--samples'"),
    ("render --output a.png --seed -1", "invalid value for '--seed'"),
    ("render --output a.png --reference-threshold nan", "invalid value for '--reference-threshold'"),
    ("render --output a.png --reference no.png", "--reference no.png: there is no such file"),
    ("render a.png --output a.png", "--output a.png would overwrite the model"),
    ("render --environment a.exr --output a.exr", "--output a.exr would overwrite the environment"),
    ("render --set model.texture=a.png --output a.png", "--output a.png would overwrite the texture"),
    ("render --set model.normal_map=a.png --output a.png", "--output a.png would overwrite the normal map"),
    ("view a.ply --record a.ply", "--record a.ply would overwrite the model"),
    ("render a.ply b.ply --output a.png", "got unexpected extra argument"),
    ("view", "there is no display for a window; write a picture with `milkglass render --output FILE`."),
    ("view a.toml", "a.toml is a scene file, not a model; write --scene before it."),
    ("view --scene no.toml", "no.toml: cannot read the scene file (No such file or directory)."),
    ("view --set camera.zom=2", '--set camera.zom is unknown; did you mean "camera.zoom"?'),
    ("view --set camera.zoom", "--set 'camera.zoom' is not an assignment; write table.key=value."),
    ("view --size-mm 0", "--size-mm must be a number from 0.001 to 1e6 or \"file\", not 0.0."),
    ("view --size-mm big", '--size-mm must be a number from 0.001 to 1e6 or "file", not "big".'),
    ("view --up w", '--up must be one of "x", "y", "z", "-x", "-y", "-z", not "w".'),
    ("view --material jaed", "unknown material 'jaed': the nearest are jade"),
    ("view --layers 0", "--layers must be a whole number from 1 to 128, not 0."),
    ("view --layers 2.5", '--layers must be a whole number from 1 to 128, not "2.5".'),
    ("view --resolution 5000", "--resolution must be a whole number from 16 to 1024, not 5000."),
    ("view --transport magic", '--transport must be one of "diffusion", "ewald", "layered", not "magic".'),
    ("view --error-target 2", "--error-target must be a number from 0.001 to 0.5, not 2."),
    ("view --light sun:0,1,0", "--light sun:0,1,0: unknown kind of light; known are directional, point, "),
    ("view --light pint:0,1,0", '--light pint:0,1,0: unknown kind of light; did you mean "point"?'),
    ("view --light point", "--light point: write point:x,y,z or point:x,y,z:r,g,b, then :key=value for more."),
    ("view --light point:1,2,3:1,2,3:4", "--light point:1,2,3:1,2,3:4: write point:x,y,z or"),
    ("view --light point:1,2", "--light point:1,2: position_mm must be 3 numbers"),
    ("view --light point:1,b,3", "--light point:1,b,3: '1,b,3' is not a list of numbers; write numbers as"),
    ("view --light directional:0,0,0", "--light directional:0,0,0: direction must not be the zero vector"),
    ("view --light directional:0,1,0:1,1,-1", "--light directional:0,1,0:1,1,-1: irradiance must be 3 numbers"),
    ("view --light directional:0,nan,0", "--light directional:0,nan,0: direction must be 3 numbers"),
    ("view --environment stduio", '--environment stduio is neither a file nor builtin; did you mean "studio"?'),
    ("view --environment-rotation inf", "--environment-rotation must be a number from -360 to 360, not inf."),
    ("view --environment-intensity -1", "--environment-intensity must be a number from 0 to 1e6, not -1.0."),
    ("view --image-size 1024", "--image-size must be 2 whole numbers from 16 to 16384, not [1024]."),
    ("view --image-size 8x8", "--image-size must be 2 whole numbers from 16 to 16384, not [8, 8]."),
    ("view --image-size 1024,768", "--image-size 1024,768: '1024,768' is not a list of numbers; write WIDTHxHEIGHT"),
    ("view --camera-azimuth x", '--camera-azimuth must be a number from -360 to 360, not "x".'),
    ("view --camera-elevation 91", "--camera-elevation must be a number from -90 to 90, not 91.0."),
    ("view --camera-view-angle 0", "--camera-view-angle must be a number from 1 to 120, not 0.0."),
    ("view --camera-zoom nan", "--camera-zoom must be a number from 0.01 to 100, not nan."),
    ("view --orthographic=yes", "option '--orthographic' does not take a value."),
    ("view --background pink", '--background must be one of "black", "transparent", "environment", #rrggbb, not "p'),
    ("view --background environment", 'display.background is "environment" but there is none'),
    ("bench --fast", "no such option: --fast."),
    ("materials unobtainium", "unknown material 'unobtainium'"),
    ("edit photo.png", "missing option '--mask'"),
]  # fmt: skip


@pytest.mark.parametrize(("line", "expected"), BAD_LINES)
def test_bad_line_is_one_sentence_and_code_2(line, expected, capsys, tmp_path):
    assert cli.main(line.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"milkglass: {expected}")
    assert err.count("\n") == 1
    assert err.endswith((".\n", "?\n"))
    assert os.listdir(tmp_path) == []


def test_a_recording_over_its_scene_is_refused(capsys):
    Path("s.toml").write_text("[camera]\nzoom = 1\n")
    assert cli.main(["view", "--scene", "s.toml", "--record", "s.toml"]) == 2
    assert "--record s.toml would overwrite the scene file" in capsys.readouterr().err


def test_bad_scene_file_is_one_sentence_and_code_2(capsys):
    Path("s.toml").write_text("[camera]\nzom = 3\n")
    assert cli.main(["render", "--scene", "s.toml", "--output", "a.png"]) == 2
    assert capsys.readouterr().err == 'milkglass: s.toml: unknown key camera."zom"; did you mean "zoom"?\n'


@pytest.mark.parametrize(
    ("raised", "code", "said"),
    [
        (InputError("No EGL:\n install libegl1."), 2, "milkglass: No EGL: install libegl1.\n"),
        (MemoryError(), 2, "milkglass: not enough memory; ask for a smaller --image-size"),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_what_happens_inside_becomes_an_exit_code(raised, code, said, monkeypatch, capsys):
    def render(*_, **__):
        raise raised

    for name in ("render", "render_image"):
        monkeypatch.setattr(renderer, name, render)
    assert cli.main(["render", "--output", "a.png"]) == code
    assert capsys.readouterr().err.startswith(said)


def test_render_writes_every_output_and_passes_its_options(rendered, capsys, tmp_path):
    line = "render m.ply --output a.png --output b.png --samples 9 --seed 5 --verbose --set display.key=0.5"
    rendered.warnings = ("m.ply is not closed.",)
    assert cli.main(line.split()) == 0
    ((scene, samples, seed),) = rendered.calls
    assert (samples, seed, scene.display.key, scene.model.path) == (9, 5, 0.5, tmp_path / "m.ply")
    assert sorted(os.listdir()) == ["a.png", "b.png"]
    out, err = capsys.readouterr()
    assert "layers" in out
    assert "1.2" in out
    assert out.endswith(
        "layered, 8 layers\nThe log-average of the object's radiance is 0.25 (display.average).\nrays: none\ncoarse\n"
    )
    assert err == "milkglass: warning: m.ply is not closed.\n"


def test_comparison_decides_the_exit_code(rendered, capsys):
    assert cli.main(["render", "--output", "reference.png"]) == 0
    again = ["render", "--output", "x.exr", "--output", "a.png", "--reference", "reference.png"]
    assert cli.main(again) == 0
    assert capsys.readouterr().out.startswith("a.png agrees with reference.png: rms 0")
    rendered.level = 110
    assert cli.main(again) == 1
    err = capsys.readouterr().err
    assert err.startswith("milkglass: a.png differs from reference.png: rms 0.0392")
    assert err.count("\n") == 1
    assert Path("a.diff.png").is_file()
    assert cli.main([*again, "--reference-threshold", "0.04"]) == 0


def test_reference_is_never_overwritten_and_must_match(rendered, capsys):
    assert cli.main(["render", "--output", "r.png"]) == 0
    assert cli.main(["render", "--output", "./r.png", "--reference", "r.png"]) == 2
    assert "--output ./r.png would overwrite the reference" in capsys.readouterr().err
    assert cli.main(["render", "--output", "a.exr", "--reference", "r.png"]) == 2
    assert "r.png can only be compared with an --output that ends in .png" in capsys.readouterr().err
    assert len(rendered.calls) == 1


def test_milkglass_alone_without_a_display_writes_a_picture(rendered, capsys):
    assert cli.main([]) == 0
    assert rendered.calls == [(default_scene(), cli.FIRST_SAMPLES, 0)]
    assert os.listdir() == ["milkglass.png"]
    out = capsys.readouterr().out
    assert "no display" in out
    assert "milkglass.png" in out


@pytest.mark.parametrize("variable", ["DISPLAY", "WAYLAND_DISPLAY"])
def test_window_where_there_is_a_display(variable, monkeypatch):
    shown = []
    monkeypatch.setattr("milkglass.viewer.window.window.run", lambda scene, **_: shown.append(scene))
    monkeypatch.setenv(variable, ":99")
    assert cli.main([]) == 0
    assert cli.main(["view", "ball.ply"]) == 0
    assert cli.main(["view", "ball.ply", "--material", "wax", "--environment", "probe.hdr"]) == 0
    assert [scene.material.name for scene in shown] == ["jade", "jade", "wax"]
    first, viewed, probed = shown
    assert (viewed.ground, viewed.display) == (first.ground, first.display)
    assert viewed.all_lights()
    assert not probed.all_lights()


def test_bench_passes_its_options(monkeypatch):
    calls = []
    monkeypatch.setattr("milkglass.viewer.bench.run.run", lambda *files, **options: calls.append((*files, options)))
    assert cli.main(["bench"]) == 0
    assert cli.main(["bench", "--quick", "--output", "d", "--model", "m.ply", "--only", "window, sight"]) == 0
    some = {"quick": True, "only": ["window", "sight"]}
    assert calls == [(None, None, {"quick": False, "only": PARTS}), (Path("d"), Path("m.ply"), some)]


@pytest.mark.parametrize("line", ["--help", "view --help", "render --help", "bench --help", "materials --help"])
def test_help_names_the_options(line, capsys):
    assert cli.main(line.split()) == 0
    out = capsys.readouterr().out
    for flag in FLAGS if line.split()[0] in ("view", "render") else ():
        assert flag.option in out


def test_version(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"milkglass {milkglass.__version__}\n"


def test_help_and_tables_load_no_graphics():
    code = (
        "import sys; from milkglass.viewer.commands.cli import main; main(['materials']); main(['render', '--help']);"
        "heavy = {'moderngl', 'glfw', 'pyfftw', 'trimesh', 'OpenImageIO', 'skimage', 'imgui_bundle'};"
        "heavy &= set(sys.modules);"
        "sys.exit(f'loaded {heavy}' if heavy else 0)"
    )
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_as_a_program():
    command = [sys.executable, "-m", "milkglass.viewer.commands.cli", "render", "--output", "a.png", "--layers", "999"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == "milkglass: --layers must be a whole number from 1 to 128, not 999.\n"
