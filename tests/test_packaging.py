"""What is shipped: the wheel's contents, that it renders where the sources are not, and the rules of the tree."""

import importlib.metadata
import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

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


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A wheel built from a copy of the sources, so that no build files are left in the tree."""
    folder = tmp_path_factory.mktemp("wheel")
    sources = folder / "sources"
    sources.mkdir()
    for name in (".package", *ROOMS):
        shutil.copytree(
            ROOT / name, sources / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info")
        )
    for path in ROOT.glob("*.*"):
        if path.is_file():
            shutil.copy(path, sources)
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--quiet", "--wheel-dir", str(folder), str(sources)]
    if int(importlib.metadata.version("setuptools").split(".")[0]) >= SETUPTOOLS:
        command.insert(4, "--no-build-isolation")  # needs no network
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), check=False)
    if done.returncode and "No matching distribution found for setuptools" in done.stderr and not os.environ.get("CI"):
        pytest.skip(f"setuptools >= {SETUPTOOLS} is neither installed nor to be had")
    assert done.returncode == 0, done.stderr
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A Python that has the wheel, and this environment's packages behind it."""
    folder = tmp_path_factory.mktemp("installed")
    run(sys.executable, "-m", "venv", "--without-pip", folder)
    python = folder / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", str(python))
    run(*pip, "install", "--no-deps", "--no-index", "--quiet", str(wheel), env=environment())
    # A path in a .pth file finds packages, but runs no .pth files of its own: an editable install stays out.
    site = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", env=environment()).strip()
    Path(site, "behind.pth").write_text("\n".join(path for path in sys.path if path.endswith("-packages")) + "\n")
    return python


@pytest.mark.slow
def test_the_wheel_holds_every_file_that_is_needed(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    wanted = {"milkglass/__init__.py", "milkglass/py.typed", "milkglass/core/material/library.csv"}
    for folder in ROOMS:
        files = [path for path in (ROOT / folder).rglob("*.*") if path.suffix in (".py", *SHADER_SUFFIXES)]
        wanted |= {f"milkglass/{path.relative_to(ROOT)}" for path in files}
    assert wanted <= names
    extra = {name for name in names - wanted if not name.startswith("milkglass-")}
    assert {Path(name).suffix for name in extra} <= {".csv", ".md"}
    assert not any(name.startswith("tests") for name in names)


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


def test_the_import_contract_holds():
    lint = Path(sysconfig.get_path("scripts")) / "lint-imports"
    if not lint.exists():
        pytest.skip("import-linter is not installed")
    output = run(lint, "--no-cache", cwd=ROOT)
    assert "0 broken" in output
