"""Many scenes in one renderer: memory, threads and objects of OpenGL stay what they were.

MILKGLASS_LONG_USE=1000 draws so many pictures in place of those that every run has time for.
"""

import ctypes
import ctypes.util
import gc
import os
import threading
from pathlib import Path

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.render import memory
from milkglass.viewer.render.renderer import Renderer
from tests.support.random_scenes import random_scene, write_models

SCENES = 6
PICTURES = int(os.environ.get("MILKGLASS_LONG_USE", "30"))
LONG = 200  # pictures from which on the heap is judged
WARM = 3  # rounds until caches are full
GROWTH = 30 << 20  # bytes that the heap may move by over all that follows
KINDS = ("Texture", "Buffer", "Framebuffer", "Renderbuffer", "Program", "VertexArray")


def live_objects(context, library):
    """How many objects of each kind OpenGL knows."""
    newest = [context.texture((1, 1), 4), context.buffer(reserve=4), context.simple_framebuffer((1, 1))]
    end = max(made.glo for made in newest) + 8
    for made in newest:
        made.release()
    return {kind: sum(bool(getattr(library, f"glIs{kind}")(i)) for i in range(1, end)) for kind in KINDS}


def resident_bytes():
    memory.give_back()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory as Linux tells it")
def test_many_scenes_leave_nothing_behind(context, few_rays, tmp_path):
    name = ctypes.util.find_library("GL")
    if name is None:
        pytest.skip("no libGL to ask for its objects")
    library, renderer, models = ctypes.CDLL(name), Renderer(context), write_models(tmp_path)
    rng = np.random.default_rng(11)
    scenes = [random_scene(rng, models, ("diffusion", "ewald", "layered")[i % 3]) for i in range(SCENES)]
    seen = []
    for _ in range(PICTURES // SCENES):
        for scene in scenes:
            try:
                renderer.render(scene, samples=1)
            except InputError:
                continue
        gc.collect()
        seen.append((live_objects(context, library), threading.active_count(), resident_bytes()))
    objects, threads, heap = zip(*seen[WARM:], strict=True)
    assert all(found == objects[0] for found in objects), objects
    assert len(set(threads)) == 1
    if PICTURES >= LONG:  # else what other tests leave in the process moves it by more
        assert max(heap) - heap[0] < GROWTH, heap
