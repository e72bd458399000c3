"""What `import milkglass` gives, and what it leaves alone."""

import importlib
import json
import os
import pkgutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import milkglass as mg
from milkglass.viewer.scene.lights import LIGHT_KINDS
from milkglass.viewer.scene.settings import TABLES
from tests.support.paths import PACKAGES

FACES = [
    module.name
    for module in pkgutil.walk_packages(mg.__path__, "milkglass.")
    if module.ispkg and "lazy(__name__)" in Path(importlib.import_module(module.name).__file__).read_text()
]


def run(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


def test_importing_changes_nothing_and_loads_no_numerics():
    code = """
import json, os, sys, threading
before = dict(os.environ), threading.active_count()
import milkglass
print(json.dumps([(dict(os.environ), threading.active_count()) == before, sorted(sys.modules)]))
"""
    same, modules = run(code)
    assert same
    foreign = {name.split(".")[0] for name in modules} & {
        "OpenGL", "OpenImageIO", "embreex", "glcontext", "glfw", "imgui_bundle", "moderngl", "numpy", "pyfftw", "scipy",
        "threadpoolctl", "trimesh", "typer",
    }  # fmt: skip
    assert foreign == set()


@pytest.mark.slow
def test_a_picture_leaves_the_threads_and_the_environment_as_they_were(context, model):
    """Those of NumPy's matrix products above all: they are the process's, not ours."""
    code = f"""
import json, os
import numpy as np
from threadpoolctl import threadpool_info
def state():
    blas = [library["num_threads"] for library in threadpool_info() if "numpy" in library["filepath"]]
    return dict(os.environ), blas, np.geterr()
before = state()
import milkglass as mg
scene = mg.Scene.from_toml('model.path = "{model.as_posix()}"\\ndisplay.image_size = [16, 16]')
frame = mg.render(scene, samples=1)
print(json.dumps([state() == before, float(frame.radiance.mean())]))
"""
    same, mean = run(code)
    assert same
    assert mean > 0.0


def test_the_face_hands_on_what_a_scene_is_made_of():
    wanted = {"Frame", "InputError", "Renderer", "Scene", "materials", "render", "render_image"}
    wanted |= {table.__name__ for table in TABLES.values()} | {kind.__name__ for kind in LIGHT_KINDS.values()}
    assert wanted <= set(mg.__all__) <= set(dir(mg))
    for name in mg.__all__:
        assert getattr(mg, name) is not None
    with pytest.raises(AttributeError, match="module 'milkglass' has no attribute 'rendre'"):
        _ = mg.rendre
    scene = mg.Scene(
        material=mg.MaterialSettings.of(mg.materials["skim milk"]), lights=(mg.DirectionalLight((0.0, 0.0, 1.0)),)
    )
    assert mg.Scene.from_toml(scene.to_toml()) == scene


@pytest.mark.parametrize("face", FACES)
def test_faces_of_rooms_have_what_they_say(face):
    module = importlib.import_module(face)
    assert module.__doc__
    assert module.__all__
    for name in module.__all__:
        found = getattr(module, name)
        assert not isinstance(found, type(sys)), f"{face}.{name} is a module of the same name"


def test_every_room_says_what_it_is_for():
    for room in pkgutil.walk_packages(mg.__path__, "milkglass."):
        if room.ispkg:
            assert importlib.import_module(room.name).__doc__, room.name
    assert {"milkglass.viewer.scene", "milkglass.viewer.render", "milkglass.core.grid"} <= set(FACES)


CONSUMER = """
import milkglass as mg
from milkglass.core.transport import Quality

scene = mg.Scene(material=mg.MaterialSettings.of(mg.materials["jade"]), lights=(mg.DirectionalLight((0, 0, 1)),))
frame: mg.Frame = mg.render(scene, samples=2)
quality: Quality = frame.quality
version: str = mg.__version__
mg.rendre(scene)
mg.render(scene, samples="two")
mg.Renderer().render(7)
"""


@pytest.mark.slow
def test_type_checkers_see_names_and_mistakes(tmp_path):
    """As a user's project is checked, whose own settings are not ours."""
    mypy = Path(sysconfig.get_path("scripts")) / "mypy"
    if not mypy.exists():
        pytest.skip("mypy is not installed")
    (tmp_path / "consumer.py").write_text(CONSUMER)
    command = [mypy, "--strict", "--config-file=", f"--cache-dir={tmp_path / 'cache'}", "consumer.py"]
    silent = ["--follow-imports=silent", "--ignore-missing-imports", "--no-error-summary"]
    done = subprocess.run(
        [*command, *silent], capture_output=True, text=True, check=False, cwd=tmp_path,
        env=os.environ | {"MYPYPATH": str(PACKAGES)},
    )  # fmt: skip
    errors = [line.split(": error: ") for line in done.stdout.splitlines() if ": error: " in line]
    assert [(place, message.split("[")[-1]) for place, message in errors] == [
        ("consumer.py:9", "attr-defined]"),
        ("consumer.py:10", "arg-type]"),
        ("consumer.py:11", "arg-type]"),
    ], done.stdout + done.stderr
