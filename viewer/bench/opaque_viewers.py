"""Other viewers, which draw a mesh opaque: each in a process and an OpenGL context of its own, without a window.

As a program, `python -m milkglass.viewer.bench.opaque_viewers NAME FILE SIDE` draws a first picture, then one of the
turned mesh for each line that it reads, and writes the processor time of each, ms, as a line.
"""

import importlib.util
import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from types import MappingProxyType

import numpy as np

Turn = Callable[[], object]  # draws the mesh turned by a step

COMMAND = sys.executable, "-m", __name__
MARK = "cpu_ms "  # before a time, as the programs write lines of their own
TURN_DEG = 1.4  # of the camera between two pictures, as of ours


def polyscope_turns(path: Path, side: int) -> Turn:
    """Return what draws the next picture of an orbit by Polyscope, smooth, with its panel, without its ground."""
    import polyscope
    import trimesh

    mesh = trimesh.load(path, process=False)
    polyscope.set_verbosity(0)
    polyscope.set_allow_headless_backends(True)
    polyscope.init("openGL3_egl")
    polyscope.set_window_size(side, side)
    polyscope.set_ground_plane_mode("none")
    polyscope.register_surface_mesh("model", mesh.vertices, mesh.faces, smooth_shade=True)
    centre, size = mesh.vertices.mean(axis=0), float(np.ptp(mesh.vertices, axis=0).max())
    angles = iter(np.deg2rad(TURN_DEG * np.arange(1_000_000)))

    def turn() -> None:
        angle = next(angles)
        polyscope.look_at(centre + 1.8 * size * np.array([np.sin(angle), 0.2, np.cos(angle)]), centre)
        polyscope.screenshot_to_buffer(transparent_bg=False, include_UI=True)

    return turn


def f3d_turns(path: Path, side: int) -> Turn:
    """Return what draws the next picture of an orbit by F3D."""
    import f3d

    f3d.Log.set_verbose_level(f3d.Log.QUIET)
    engine = f3d.Engine.create_egl()
    engine.window.size = (side, side)
    engine.scene.add(str(path))

    def turn() -> None:
        engine.window.camera.azimuth(TURN_DEG)
        engine.window.render()

    return turn


# Name of a program -> its Python package, and what draws by it.
PROGRAMS = MappingProxyType({"Polyscope": ("polyscope", polyscope_turns), "F3D": ("f3d", f3d_turns)})


def installed() -> tuple[str, ...]:
    """Return the names of the programs that are installed (extra `rivals`)."""
    return tuple(name for name, (package, _) in PROGRAMS.items() if importlib.util.find_spec(package))


class OpaqueViewer:
    """Another program that has drawn a first picture of a mesh, in a process that waits to draw the next.

    Attributes
    ----------
    first : float
        Processor time from the start of the process until its first picture, ms; NaN if it drew none.
    """

    def __init__(self, name: str, path: Path, side: int) -> None:
        command = [*COMMAND, name, str(path), str(side)]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        self._process = subprocess.Popen(command, text=True, **pipes)  # type: ignore[call-overload]
        self.first = self._time()

    def turn(self) -> float:
        """Let it draw the next picture of an orbit and return the processor time, ms; NaN if it has ended."""
        if self._process.poll() is not None:
            return float("nan")
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return self._time()

    def close(self) -> None:
        """End the process."""
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()

    def _time(self) -> float:
        for line in self._process.stdout:
            if line.startswith(MARK):
                return float(line.removeprefix(MARK))
        return float("nan")


@contextmanager
def started(path: Path, side: int) -> Iterator[dict[str, OpaqueViewer]]:
    """Start the programs that are installed, by name, and end them afterwards; without those that draw nothing."""
    with ExitStack() as stack:
        viewers = {name: stack.enter_context(closing(OpaqueViewer(name, path, side))) for name in installed()}
        yield {name: viewer for name, viewer in viewers.items() if not math.isnan(viewer.first)}


def main(name: str, path: Path, side: int) -> None:
    """Draw a first picture, and another for each line of stdin; write the processor time of each, ms, to stdout."""
    _, turns = PROGRAMS[name]
    turn = turns(path, side)
    turn()
    sys.stdout.write(f"\n{MARK}{1e3 * time.process_time()}\n")
    sys.stdout.flush()
    for _ in sys.stdin:
        start = time.process_time()
        turn()
        sys.stdout.write(f"\n{MARK}{1e3 * (time.process_time() - start)}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]))
