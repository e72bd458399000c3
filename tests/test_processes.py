"""Rendering from Python wherever work is done: any thread, several at once, spawned and forked processes.

In processes of their own: this one's main thread has the OpenGL context to the end.
"""

import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.waiting import DEADLINE

COMMON = """
import multiprocessing, os, sys, threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
import numpy as np
import milkglass as mg
from milkglass.viewer.gl.context import current, headless_context

TEXT = '''
[model]
path = "{model}"
[transport]
method = "{method}"
resolution = 16
[display]
image_size = [48, 40]
[[lights]]
kind = "directional"
direction = [0.3, 0.4, 1.0]
'''
ANGLES = [0, 40, 80, 120]

def picture(azimuth):
    scene = mg.Scene.from_toml(TEXT)
    return mg.render(replace(scene, camera=replace(scene.camera, azimuth_deg=float(azimuth))), samples=2).image

def check(found, expected):
    assert len(found) == len(expected)
    for a, b in zip(found, expected):
        assert a.std() > 5.0
        np.testing.assert_array_equal(a, b)

def in_thread(work):
    found = []
    thread = threading.Thread(target=lambda: found.append(work()))
    thread.start()
    thread.join()
    return found[0]

def refused(_):
    try:
        picture(0)
    except mg.InputError as problem:
        return str(problem)
"""

CASES = {
    "a second thread, one after another": """
main = [picture(angle) for angle in ANGLES[:2]]
check([in_thread(lambda: picture(angle)) for angle in ANGLES[:2]], main)
check([picture(angle) for angle in ANGLES[:2]], main)
""",
    "first in a thread that is gone": """
found = in_thread(lambda: picture(0))
check([picture(0)], [found])
""",
    "after a thread that failed": """
def fail():
    def progress(words):
        raise ZeroDivisionError
    try:
        mg.render(mg.Scene.from_toml(TEXT), progress=progress)
    except ZeroDivisionError:
        return picture(0)
check([picture(0)], [in_thread(fail)])
""",
    "several at once": """
main = [picture(angle) for angle in ANGLES]
with ThreadPoolExecutor(4) as pool:
    check(list(pool.map(picture, ANGLES)), main)
""",
    "one renderer in several threads": """
renderer, scene = mg.Renderer(), mg.Scene.from_toml(TEXT)
scenes = [replace(scene, camera=replace(scene.camera, azimuth_deg=float(angle))) for angle in ANGLES]
with ThreadPoolExecutor(4) as pool:
    frames = list(pool.map(lambda scene: renderer.render(scene, samples=2), scenes))
check([frame.image for frame in frames], [picture(angle) for angle in ANGLES])
""",
    "inside blocks of one's own": """
main = picture(0)
with headless_context():
    check([picture(0)], [main])
with current(headless_context()):
    check([picture(0)], [main])
def around():
    with headless_context():
        return picture(0)
check([in_thread(around)], [main])
""",
    "beside a context of one's own": """
import moderngl
own = moderngl.create_context(standalone=True, backend="egl", libgl="libGL.so.1", libegl="libEGL.so.1")
main = picture(0)
target = own.simple_framebuffer((2, 2))
target.use()
target.clear(1.0, 0.0, 0.0, 1.0)
check([picture(0), in_thread(lambda: picture(0))], [main] * 2)
target.clear(0.0, 1.0, 0.0, 1.0)
assert target.read()[:3] == bytes((0, 255, 0))
assert own.error == "GL_NO_ERROR"
""",
    "a picture that stays on the GPU, read elsewhere": """
from milkglass.viewer.render.picture import PictureRequest, read_frame
from milkglass.viewer.scene.camera import pixel_offsets
renderer, scene = mg.Renderer(), mg.Scene.from_toml(TEXT)
drawn = renderer.draw(scene, PictureRequest(pixel_offsets(2), parts=True))
frame = in_thread(lambda: read_frame(drawn, renderer.timings))
check([frame.image], [picture(scene.camera.azimuth_deg)])
in_thread(lambda: renderer.pick((20, 20)))
""",
    "fork": """
with multiprocessing.get_context("fork").Pool(2) as pool:
    found = pool.map_async(picture, ANGLES).get(timeout=300)
check(found, [picture(angle) for angle in ANGLES])
""",
    "fork after a picture": """
main = picture(0)
with multiprocessing.get_context("fork").Pool(2) as pool:
    sentences = pool.map_async(refused, range(4)).get(timeout=300)
assert all(s.startswith("OpenGL was in use before this process was forked") for s in sentences), sentences
check([picture(0)], [main])
""",
    "fork while a thread draws": """
begun, end = threading.Event(), threading.Event()
def progress(words):
    begun.set()
    end.wait(300)
thread = threading.Thread(target=lambda: mg.render(mg.Scene.from_toml(TEXT), samples=1, progress=progress))
thread.start()
begun.wait(300)
child = os.fork()
if child == 0:
    os._exit(0 if "before this process was forked" in refused(0) else 1)
end.set()
thread.join()
assert os.waitpid(child, 0)[1] == 0
""",
    "memory stays": """
def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1])
for i in range(10):
    in_thread(lambda: picture(9 * i))
after_ten = resident()
for i in range(10, 40):
    in_thread(lambda: picture(9 * i))
assert resident() < 1.2 * after_ten
""",
}
SOLVED = [(case, "diffusion") for case in CASES if case.startswith(("several", "fork"))]


def run(folder, *arguments):
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, check=False, timeout=2 * DEADLINE, cwd=folder
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize(("case", "method"), [*((case, "layered") for case in CASES), *SOLVED])
def test_pictures_are_the_same_wherever_they_are_made(context, model, tmp_path, case, method):
    if case.startswith("fork") and not hasattr(os, "fork"):
        pytest.skip("this system does not fork")
    if case == "memory stays" and not Path("/proc/self/statm").exists():
        pytest.skip("this system does not say how much memory is resident")
    common = COMMON.replace("{model}", model.as_posix()).replace("{method}", method)
    run(tmp_path, "-c", common + CASES[case])


@pytest.mark.slow
def test_a_spawned_process_renders(context, model, tmp_path):
    """Spawning reads the program again: it is a file, as in anybody's project."""
    body = """
if __name__ == "__main__":
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        found = pool.map_async(picture, ANGLES).get(timeout=300)
    check(found, [picture(angle) for angle in ANGLES])
"""
    assert "spawn" in multiprocessing.get_all_start_methods()
    program = tmp_path / "program.py"
    program.write_text(COMMON.replace("{model}", model.as_posix()).replace("{method}", "layered") + body)
    run(tmp_path, program)


@pytest.mark.window
@pytest.mark.slow
def test_beside_a_window_pictures_are_made_in_another_thread(display, context, model, tmp_path, monkeypatch):
    """Where the window's context is current, EGL's cannot be: a sentence, not a picture of something else."""
    monkeypatch.setenv("DISPLAY", display)
    code = """
import glfw
main = in_thread(lambda: picture(0))
assert glfw.init()
glfw.window_hint(glfw.VISIBLE, False)
window = glfw.create_window(32, 32, "", None, None)
glfw.make_context_current(window)
assert refused(0).startswith("a window's or another library's OpenGL context is current in this thread")
check([in_thread(lambda: picture(0))], [main])
glfw.make_context_current(None)
check([picture(0)], [main])
glfw.terminate()
"""
    run(tmp_path, "-c", COMMON.replace("{model}", model.as_posix()).replace("{method}", "layered") + code)
