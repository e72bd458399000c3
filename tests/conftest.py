"""Fixtures that several test files share."""

import contextlib
import ctypes
import functools
import os
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import moderngl
import pytest

from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.sculpture import sculpture
from milkglass.viewer.gl.context import current, driver_name, free_dropped, headless_context, leave_framebuffer
from tests.support.display import virtual_display
from tests.support.paths import DATA, PACKAGES
from tests.support.rendering import MeshRenderer
from tests.support.shapes import ball, cube, plate, torus_knot


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--regenerate-baselines", action="store_true", help="rewrite tests/baselines/*.png and skip their tests"
    )


def pytest_configure(config: pytest.Config) -> None:
    config.option.loadscopereorder = False  # xdist's: files with the most tests first, which are quick ones


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the files with the most slow tests first, so that no worker is left with a long one at the end."""
    for item in items:
        if "context" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.gl)
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: -slow[item.path])


@pytest.fixture(scope="session")
def data_dir() -> Path:
    if not DATA.is_dir():
        pytest.skip("the folder of third-party data is absent")
    return DATA


@pytest.fixture(scope="session", autouse=True)
def cache_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache of the tests' own, whose bakes serve all of them and not the user; and a folder for materials."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        if "MESA_SHADER_CACHE_DIR" not in os.environ:  # what the driver has compiled stays where it would put it
            users = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
            patch.setenv("MESA_SHADER_CACHE_DIR", users)
        patch.setenv("PYTHONPATH", str(PACKAGES))  # of the programs that tests start
        patch.setenv("XDG_CACHE_HOME", str(folder))
        patch.setenv("XDG_DATA_HOME", str(folder / "data"))
        patch.setenv("XDG_STATE_HOME", str(folder / "state"))
        patch.setattr("milkglass.viewer.assets.ray_cache.cache_folder", lambda: folder / "milkglass")
        yield folder


@pytest.fixture(scope="session", autouse=True)
def sculpted_once() -> Iterator[None]:
    """Compute the built-in sculpture once: a renderer reads the detail of a scene's model, whatever mesh it draws."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("milkglass.viewer.files.builtin.sculpture", functools.cache(sculpture))
        yield


@pytest.fixture(scope="module", autouse=True)
def freed_memory() -> Iterator[None]:
    """Hand what tests have freed back to the system: the C library keeps gigabytes of it in each process."""
    yield
    if sys.platform == "linux":
        with contextlib.suppress(AttributeError, OSError):  # of a C library that is not GNU's
            ctypes.CDLL("libc.so.6").malloc_trim(0)


@pytest.fixture(scope="session")
def context() -> Iterator[moderngl.Context]:
    """The process's one OpenGL context, the main thread's to the end; continuous integration must have one."""
    try:
        context = headless_context()
    except InputError as problem:
        if os.environ.get("CI"):
            raise
        pytest.skip(str(problem))
    with current(context):
        yield context


@pytest.fixture(scope="session")
def display() -> Iterator[str]:
    """The name of an X display that no other process of the tests draws on."""
    with virtual_display() as name:
        yield name


@pytest.fixture(scope="session")
def on_llvmpipe(context: moderngl.Context) -> bool:
    return "llvmpipe" in driver_name(context)


@pytest.fixture(autouse=True)
def no_gl_errors(request: pytest.FixtureRequest) -> Iterator[None]:
    """Check that a test neither finds nor leaves an OpenGL error."""
    if "context" not in request.fixturenames:
        yield
        return
    context = request.getfixturevalue("context")
    assert context.error == "GL_NO_ERROR"
    yield
    assert context.error == "GL_NO_ERROR"
    free_dropped(context)
    leave_framebuffer(context)


@pytest.fixture(scope="session")
def shapes() -> dict[str, Mesh]:
    return {"ball": ball(), "knot": torus_knot(), "plate": plate(), "cube": cube()}


@pytest.fixture(scope="session")
def renderer_of(context: moderngl.Context, shapes: dict[str, Mesh]):
    """Return the session's renderer of a mesh, or of a shape by its name; it keeps what it has computed."""
    kept: dict[Mesh, MeshRenderer] = {}

    def renderer(mesh: Mesh | str) -> MeshRenderer:
        mesh = shapes[mesh] if isinstance(mesh, str) else mesh
        if mesh not in kept:
            kept[mesh] = MeshRenderer(context, mesh)
        return kept[mesh]

    return renderer


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the file of a small knot."""
    from tests.support.driving import write_knot

    return write_knot(tmp_path_factory.mktemp("model") / "knot.ply")


@pytest.fixture
def few_rays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look for occlusion with few rays: where what runs is judged, and not how well."""
    for module in ("core.light.bake", "viewer.assets.visibility"):
        monkeypatch.setattr(f"milkglass.{module}.directions_for", lambda n: 256)


@pytest.fixture
def driver(context: moderngl.Context, model: Path):
    """Return a window without a screen that shows the knot."""
    from tests.support.driving import Driver, small_scene  # imports the window, which most tests do without

    driver = Driver(small_scene(model))
    yield driver
    driver.close()
