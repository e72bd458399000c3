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

from viewer.images import read_image

ROOT = Path(__file__).parents[1]
PACKAGES = ("core", "viewer", "shaders")
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
    for name in PACKAGES:
        shutil.copytree(ROOT / name, sources / name, ignore=shutil.ignore_patterns("__pycache__"))
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
    run(*pip, "install", "--no-deps", "--no-index", "--quiet", str(wheel))
    # A path in a .pth file finds packages, but runs no .pth files of its own: an editable install stays out.
    site = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", env=environment()).strip()
    Path(site, "behind.pth").write_text(
        "\n".join({sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}) + "\n"
    )
    return python


@pytest.mark.slow
def test_the_wheel_holds_every_file_that_is_needed(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    wanted = {"core/py.typed", "viewer/py.typed", "core/materials.csv"}
    for package in PACKAGES:
        wanted |= {f"{package}/{path.name}" for path in (ROOT / package).glob("*.py")}
    wanted |= {f"shaders/{path.name}" for path in (ROOT / "shaders").iterdir() if path.suffix in SHADER_SUFFIXES}
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
    home = run(installed, "-c", "import core, viewer; print(core.__file__)", cwd=tmp_path, env=environment())
    assert home.startswith(str(installed.parents[1]))


@pytest.mark.slow
def test_the_names_of_our_packages_are_ours_alone(installed, tmp_path):
    """`core` is a common name: another distribution's would be overwritten."""
    code = "from importlib.metadata import packages_distributions as p; print([sorted(set(p()[n])) for n in %r])"
    found = run(installed, "-c", code % (PACKAGES,), cwd=tmp_path, env=environment())
    assert found.strip() == str([["milkglass"]] * len(PACKAGES))


def test_the_distribution_is_not_for_upload():
    metadata = importlib.metadata.metadata("milkglass")
    assert "Private :: Do Not Upload" in metadata.get_all("Classifier")


# The tree


@pytest.mark.parametrize(("folder", "limit"), [("core", 300), ("viewer", 300), ("shaders", 300), ("tests", 400)])
def test_files_are_of_a_readers_size(folder, limit):
    files = [path for path in (ROOT / folder).iterdir() if path.suffix in (".py", ".md", *SHADER_SUFFIXES)]
    lengths = {path.name: len(path.read_text("utf-8").splitlines()) for path in files}
    assert lengths
    assert {name: length for name, length in lengths.items() if length >= limit} == {}


def test_every_stage_has_a_test():
    """One stem a stage: each pass of the viewer has shaders and, but for the G-buffer, a test file of its own."""
    passes = {path.stem for path in (ROOT / "viewer").glob("*_pass.py")}
    assert len(passes) >= 6
    tested = {path.stem.removeprefix("test_") for path in (ROOT / "tests").glob("test_*_pass.py")}
    assert passes - {"gbuffer_pass"} <= tested
    shaded = {path.name.split(".")[0].split("_")[0] for path in (ROOT / "shaders").iterdir()}
    assert {name.removesuffix("_pass") for name in passes} <= shaded


def test_the_import_contract_holds():
    lint = Path(sysconfig.get_path("scripts")) / "lint-imports"
    if not lint.exists():
        pytest.skip("import-linter is not installed")
    output = run(lint, "--no-cache", cwd=ROOT)
    assert "0 broken" in output
