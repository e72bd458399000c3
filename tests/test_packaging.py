"""What is shipped: the wheel's contents, that it renders where the sources are not, and the rules of the tree."""

import importlib.metadata
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

import milkglass
from milkglass import DirectionalLight, DisplaySettings, Scene, TransportSettings, render
from milkglass.viewer.files.images import read_image
from tests.support.paths import ROOT

ROOMS = ("core", "viewer", "shaders")
SETUPTOOLS = 77  # as pyproject.toml asks for
SHADER_SUFFIXES = (".glsl", ".vert", ".frag")


def run(*command, **options):
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def environment():
    """Of a process that finds nothing of these sources by itself."""
    return {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "PYTEST", "COV"))}


def copied_sources(folder):
    """Copy the sources, so that no build files are left in the tree."""
    sources = folder / "sources"
    sources.mkdir()
    for name in (".package", *ROOMS):
        shutil.copytree(
            ROOT / name, sources / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info")
        )
    for path in ROOT.iterdir():
        if path.is_file() and path.name != ".git":
            shutil.copy(path, sources)
    return sources


def pip(*arguments, python=sys.executable):
    """Run pip, which builds with this environment's setuptools where it can: that needs no network."""
    command = [sys.executable, "-m", "pip", "--python", str(python), *map(str, arguments), "--no-deps", "--quiet"]
    if int(importlib.metadata.version("setuptools").split(".")[0]) >= SETUPTOOLS:
        command.append("--no-build-isolation")
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), check=False)
    if done.returncode and "No matching distribution found for setuptools" in done.stderr and not os.environ.get("CI"):
        pytest.skip(f"setuptools >= {SETUPTOOLS} is neither installed nor to be had")
    assert done.returncode == 0, done.stderr


def built_wheel(source, folder):
    pip("wheel", "--wheel-dir", folder, source)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    return built_wheel(copied_sources(folder), folder)


@pytest.fixture(scope="module")
def sdist(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sdist")
    code = "import sys, setuptools.build_meta as backend; backend.build_sdist(sys.argv[1])"
    if int(importlib.metadata.version("setuptools").split(".")[0]) < SETUPTOOLS:
        pytest.skip(f"setuptools >= {SETUPTOOLS} is not installed")
    sources = copied_sources(folder)
    (sources / "tests").mkdir()
    (sources / "tests" / "test_a.py").write_text("")  # which setuptools would take along
    run(sys.executable, "-c", code, folder, cwd=sources, env=environment())
    (built,) = folder.glob("*.tar.gz")
    return built


def fresh_python(folder):
    """Make a Python that has this environment's packages behind its own."""
    run(sys.executable, "-m", "venv", "--without-pip", folder)
    python = folder / "bin" / "python"
    # A path in a .pth file finds packages, but runs no .pth files of its own: an editable install stays out.
    site = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", env=environment()).strip())
    (site / "behind.pth").write_text("\n".join(path for path in sys.path if path.endswith("-packages")) + "\n")
    return python, site


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A Python that has the wheel."""
    python, _ = fresh_python(tmp_path_factory.mktemp("installed"))
    pip("install", "--no-index", wheel, python=python)
    return python


def contents(wheel):
    return set(zipfile.ZipFile(wheel).namelist())


@pytest.mark.slow
def test_the_wheel_holds_every_file_that_is_needed(wheel):
    names = contents(wheel)
    wanted = {"milkglass/__init__.py", "milkglass/py.typed", "milkglass/core/material/library.csv"}
    for folder in ROOMS:
        files = [path for path in (ROOT / folder).rglob("*.*") if path.suffix in (".py", *SHADER_SUFFIXES)]
        wanted |= {f"milkglass/{path.relative_to(ROOT)}" for path in files}
    assert wanted <= names
    extra = {name for name in names - wanted if not name.startswith("milkglass-")}
    assert {Path(name).suffix for name in extra} <= {".csv", ".md"}
    assert not any(name.startswith("tests") for name in names)
    assert any(name.endswith("/licenses/LICENSE") for name in names)


@pytest.mark.slow
def test_the_sdist_holds_the_licence_and_no_tests(sdist):
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"LICENSE", "CITATION.cff", "README.md", "pyproject.toml"} <= names
    assert not any(name.startswith("tests") for name in names)


@pytest.mark.slow
def test_a_wheel_of_the_sdist_is_the_wheel(wheel, sdist, tmp_path):
    assert contents(built_wheel(sdist, tmp_path)) == contents(wheel)


@pytest.mark.slow
def test_the_installed_program_renders(context, installed, tmp_path):
    """From another folder, without the sources."""
    program = installed.parent / "milkglass"
    arguments = ["render", "--output", "x.png", "--output", "x.exr", "--image-size", "64x64"]
    run(program, *arguments, cwd=tmp_path, env=environment())
    image = read_image(tmp_path / "x.png")
    assert image.shape == (64, 64, 3)
    assert image.std() > 5.0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.exr", "x.png"]
    home = run(installed, "-c", "import milkglass; print(milkglass.__file__)", cwd=tmp_path, env=environment())
    assert home.startswith(str(installed.parents[1]))


@pytest.fixture(scope="module")
def rendered_mean(context, tmp_path_factory):
    """What a Python finds for the mean radiance of a scene in a folder that holds nothing else, and what is right."""
    empty = tmp_path_factory.mktemp("empty")
    scene = Scene(
        display=DisplaySettings(image_size=(48, 40)),
        transport=TransportSettings(resolution=20, exchange="off"),
        lights=(DirectionalLight((0.3, 0.4, 1.0)),),
    )
    scene.save(empty / "jade.toml")
    right = float(render(scene, samples=2).radiance.mean())
    code = "import milkglass as mg; print(mg.render(mg.Scene.load('jade.toml'), samples=2).radiance.mean(dtype=float))"

    def check(python):
        assert float(run(python, "-c", code, cwd=empty, env=environment())) == pytest.approx(right, rel=1e-6)
        assert [path.name for path in empty.iterdir()] == ["jade.toml"]

    return check


@pytest.mark.slow
def test_python_of_the_wheel_renders_the_same(installed, rendered_mean):
    rendered_mean(installed)


@pytest.mark.slow
def test_python_of_the_sdist_renders_the_same(sdist, rendered_mean, tmp_path):
    python, _ = fresh_python(tmp_path / "installed")
    pip("install", sdist, python=python)
    rendered_mean(python)


@pytest.mark.slow
def test_an_editable_install_renders_the_same_and_sees_new_files(rendered_mean, tmp_path):
    """By a plain path in a .pth file, which checkers and editors read too."""
    sources = copied_sources(tmp_path)
    python, site = fresh_python(tmp_path / "installed")
    pip("install", "--editable", sources, python=python)
    rendered_mean(python)
    (link,) = site.glob("__editable__*.pth")
    assert link.read_text().strip() == str(sources / ".package")
    (sources / "core" / "brand_new.py").write_text("VALUE = 7\n")
    code = "from milkglass.core.brand_new import VALUE; print(VALUE)"
    assert run(python, "-c", code, cwd=tmp_path, env=environment()).strip() == "7"


@pytest.mark.slow
@pytest.mark.parametrize("distribution", ["wheel", "sdist"])
def test_the_licence_is_told(distribution, request, tmp_path):
    built = request.getfixturevalue(distribution)
    shutil.unpack_archive(built, tmp_path, "zip" if distribution == "wheel" else "gztar")
    (found,) = (
        path for path in tmp_path.rglob("*") if path.name in ("METADATA", "PKG-INFO") and "egg" not in str(path)
    )
    metadata = found.read_text()
    assert "License-Expression: BSD-3-Clause\n" in metadata
    assert f"\nVersion: {milkglass.__version__}\n" in metadata
    assert f"\nversion: {milkglass.__version__}\n" in (ROOT / "CITATION.cff").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("name", ROOMS)
def test_common_names_stay_free(installed, tmp_path, name):
    """`core` is anybody's name: only `milkglass` is ours."""
    code = f"import importlib.util; print(importlib.util.find_spec({name!r}))"
    assert run(installed, "-c", code, cwd=tmp_path, env=environment()).strip() == "None"


# The tree


def test_every_stage_has_a_test():
    """One stem a stage: each pass of the viewer has shaders and, but for the G-buffer, a test file of its own."""
    passes = {"gbuffer", "shadows", "irradiance", "layers", "composite", "highlights", "detail", "tonemap"}
    assert passes <= {path.stem for path in (ROOT / "viewer" / "passes").glob("*.py")}
    tested = {path.stem for path in (ROOT / "tests" / "viewer" / "passes").glob("test_*.py")}
    assert {f"test_{name}_pass" for name in passes - {"gbuffer"}} <= tested
    shaded = {path.name.split(".")[0].split("_")[0] for path in (ROOT / "shaders").glob("*/*.*")}
    assert passes <= shaded
