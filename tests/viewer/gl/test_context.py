"""The context and the GPU's limits."""

import re
import subprocess
import sys
from collections import deque
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

# The context


@pytest.mark.slow
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
    monkeypatch.setattr(gl, "_process", gl._Process(parent_used_opengl=False))
    with pytest.raises(InputError) as caught:
        gl.headless_context()
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

    with pytest.raises(InputError, match=r"^the GPU cannot make a volume: cannot create texture$"):
        gl.checked(context, fail, "a volume")


@pytest.mark.parametrize("raises", [True, False])
def test_only_a_lack_of_memory_is_called_one(raises):
    def allocate():
        if raises:
            raise moderngl.Error("cannot create texture")

    full = SimpleNamespace(error="GL_OUT_OF_MEMORY", objects=deque())
    with pytest.raises(InputError, match=r"^the GPU has no memory left for a volume; ask for fewer"):
        gl.checked(full, allocate, "a volume")


def test_a_framebuffer_is_cleared_whole_whatever_is_bound_with_whichever_scissor(context):
    cut, cleared = (context.framebuffer(gl.float_targets(context, (4, 4), 1)) for _ in range(2))
    gl.bind_cleared(cleared)
    cleared.clear(1.0, 1.0, 1.0, 1.0)
    cut.use()
    cut.scissor = 1, 1, 1, 1
    gl.bind_cleared(cleared)
    assert not gl.read_rgba(cleared.color_attachments[0]).any()


def test_rows_of_a_framebuffer_are_drawn_alone_and_all_of_them_after_an_error(context):
    framebuffer = context.framebuffer(gl.float_targets(context, (4, 4), 1))
    gl.bind_cleared(framebuffer)
    with gl.band(framebuffer, 1, 2):
        framebuffer.clear(1.0, 1.0, 1.0, 1.0)
    np.testing.assert_array_equal(gl.read_rgba(framebuffer.color_attachments[0])[:, 0, 0], [0.0, 1.0, 1.0, 0.0])
    with pytest.raises(KeyError), gl.band(framebuffer, 1, 2):
        raise KeyError
    framebuffer.clear(1.0, 1.0, 1.0, 1.0)
    assert gl.read_rgba(framebuffer.color_attachments[0]).all()
