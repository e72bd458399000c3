"""Speed, as ratios of times measured in turns within one run, so that other load affects all of them equally.

The minimum over the repeats is the cost of the code, the median the waiting time on this machine.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import pyfftw

from milkglass.core.errors import InputError
from milkglass.core.grid.convolution import LayerConvolver, prepared
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.profiles.registry import PROFILES, TABLE
from milkglass.viewer.gl.context import current, headless_context
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import MaterialSettings
from milkglass.viewer.session.navigation import turn_matrix

PreparedKernel = tuple[npt.NDArray[np.float32], ...]

SWITCHED = tuple(name for name in PROFILES if name != TABLE)
EFFORTS = ("FFTW_MEASURE", "FFTW_ESTIMATE")  # the renderer uses ESTIMATE: the same bits in every process


@dataclass(frozen=True)
class Timing:
    """Times of repeated runs of one task, ms."""

    times: tuple[float, ...]

    @property
    def minimum(self) -> float:
        """Shortest of the times, ms."""
        return min(self.times)

    @property
    def median(self) -> float:
        """Median of the times, ms."""
        return float(np.median(self.times))


@dataclass(frozen=True)
class ConvolutionRow:
    """Times of the layer convolution of three channels, and of the bare transforms of the same padded maps."""

    layers: int
    side: int
    threads: int
    effort: str
    convolution: Timing
    bare: Timing

    @property
    def ratio(self) -> float:
        """Median ratio of successive times of convolution and bare transforms, which other load affects equally."""
        return float(np.median(np.divide(self.convolution.times, self.bare.times)))


@dataclass(frozen=True)
class FrameRow:
    """Times of a frame after a change, and the median of each stage that ran, ms."""

    setting: str
    change: str
    total: Timing
    stages: dict[str, float]


def interleaved(tasks: Sequence[Callable[[], object]], repeats: int) -> list[Timing]:
    """Return times of tasks that run in turns, after a warm-up of each."""
    times: list[list[float]] = [[] for _ in tasks]
    for repeat in range(repeats + 1):
        for task, elapsed in zip(tasks, times, strict=True):
            start = time.perf_counter()
            task()
            if repeat:
                elapsed.append(1e3 * (time.perf_counter() - start))
    return [Timing(tuple(elapsed)) for elapsed in times]


def convolution_rows(n_layers: Sequence[int], side: int, threads: int, repeats: int) -> Iterator[ConvolutionRow]:
    """Yield times of the convolution and of rfft2 and irfft2 alone, with both efforts of FFTW's planner."""
    rng = np.random.default_rng(0)
    for n in n_layers:
        shape = ConvolutionShape(n, side, side)
        maps = rng.random((3, n, side, side), dtype=np.float32)
        for effort in EFFORTS:
            convolver = LayerConvolver(shape, threads, effort)
            kernel = prepared(shape, rng.random(shape.quadrant, dtype=np.float32))

            def convolve(convolver: LayerConvolver = convolver, kernel: PreparedKernel = kernel) -> None:
                for channel in maps:  # noqa: B023 (runs before the maps change)
                    convolver.convolve(channel, kernel)

            timings = interleaved([convolve, _bare_transforms(shape, threads, effort)], repeats)
            yield ConvolutionRow(n, side, threads, effort, *timings)


def _bare_transforms(shape: ConvolutionShape, threads: int, effort: str) -> Callable[[], object]:
    """Return a task of padded 2-D real transforms of 3 n maps and back.

    Each thread has a plan for its share of the maps: FFTW's threads wait actively at every barrier, and are slower than
    this where another process uses a core.
    """
    size = shape.padded_height, shape.padded_width
    plans = []
    for share in np.array_split(np.arange(3 * shape.n_layers), threads):
        real = pyfftw.zeros_aligned((len(share), *size), "float32")
        spectrum = pyfftw.zeros_aligned((len(share), size[0], size[1] // 2 + 1), "complex64")
        options = {"axes": (1, 2), "threads": 1, "flags": (effort,)}
        forward = pyfftw.FFTW(real, spectrum, **options)
        backward = pyfftw.FFTW(spectrum, real, direction="FFTW_BACKWARD", normalise_idft=False, **options)
        real[:] = 0.0  # planning leaves arbitrary values, and NaN is slow
        plans.append((forward, backward))

    def run_plans(pair: tuple[pyfftw.FFTW, pyfftw.FFTW]) -> None:
        for plan in pair:
            plan.execute()

    pool = ThreadPoolExecutor(threads)
    return lambda: list(pool.map(run_plans, plans))


def frame_rows(scene: Scene, setting: str, repeats: int) -> Iterator[FrameRow]:
    """Yield times of frames of a loaded scene after changes of camera, lights, material and profile."""
    renderer = Renderer(headless_context())
    renderer.draw(scene)
    for change, apply in CHANGES.items():
        renderer.draw(apply(scene, 0))  # a warm-up: allocations and plans of the change
        totals: list[float] = []
        stages: dict[str, list[float]] = {}
        for i in range(1, repeats + 1):
            changed = apply(scene, i)
            start = time.perf_counter()
            with current(renderer.context) as context:
                renderer.draw(changed)
                context.finish()
            totals.append(1e3 * (time.perf_counter() - start))
            for stage, milliseconds in renderer.timings.items():
                stages.setdefault(stage, []).append(milliseconds)
        yield FrameRow(
            setting, change, Timing(tuple(totals)), {name: float(np.median(t)) for name, t in stages.items()}
        )


def _turned(scene: Scene, i: int) -> Scene:
    return replace(scene, camera=replace(scene.camera, azimuth_deg=40.0 + 7.0 * i))


def relit(scene: Scene, i: int) -> Scene:
    """Return the scene with its lights turned, to another place each time."""
    turn = turn_matrix(np.array([0.0, 1.0, 0.0]), 5.0 * (i + 1))
    return replace(scene, lights=tuple(light.turned(turn) for light in scene.effective_lights()))


def _thinned(scene: Scene, i: int) -> Scene:
    """Return the scene with another concentration, of a lower scattering coefficient each time."""
    material = scene.material.resolve()
    r, g, b = (value / (1.1 + 0.1 * i) for value in material.sigma_s_prime)
    settings = MaterialSettings(sigma_s_prime=(r, g, b), sigma_a=material.sigma_a, eta=material.eta, g=material.g)
    return replace(scene, material=settings)


def _reprofiled(scene: Scene, i: int) -> Scene:
    """Return the scene with another profile and concentration each time, so that no spectra or tables are cached."""
    thinned = _thinned(scene, i)
    return replace(thinned, material=replace(thinned.material, profile=SWITCHED[i % len(SWITCHED)]))


CHANGES: dict[str, Callable[[Scene, int], Scene]] = {
    "exposure": lambda scene, i: replace(scene, display=replace(scene.display, key=0.18 + 0.01 * i)),
    "camera": _turned,
    "lights": relit,
    "material": _thinned,
    "profile": _reprofiled,
    "camera, lights, material": lambda scene, i: _thinned(relit(_turned(scene, i), i), i),
}

# Peak memory: on Linux ru_maxrss of a child includes that of its parent, VmHWM does not.
_MEASURED = """
import sys
from pathlib import Path
from milkglass.viewer.commands.cli import main
code = main(sys.argv[1:])
status = Path("/proc/self/status")
if status.exists():
    lines = status.read_text().splitlines()
    kilobytes = next(float(line.split()[1]) for line in lines if line.startswith("VmHWM"))
else:
    import resource
    kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024 if sys.platform == "darwin" else 1)
print(kilobytes / 1024)
sys.exit(code)
"""


@dataclass(frozen=True)
class ProcessRow:
    """Times and peak memory, MB, of `milkglass render` from the start of the process to the file."""

    setting: str
    time: Timing
    megabytes: float


def process_row(
    scene: Scene,
    setting: str,
    folder: Path,
    repeats: int,
    output: str = "picture.png",
    environment: Mapping[str, str] = MappingProxyType({}),
) -> ProcessRow:
    """Return times of `milkglass render` of a scene in new processes, with files in `folder`.

    `environment` are variables that these processes have besides.
    """
    scene_path, picture = folder / "scene.toml", folder / output
    scene.save(scene_path)
    times, peak = [], 0.0
    command = [sys.executable, "-c", _MEASURED, "render", "--scene", str(scene_path), "--output", str(picture)]
    for _ in range(repeats):
        start = time.perf_counter()
        completed = subprocess.run(
            command, capture_output=True, text=True, check=False, env=program_environment() | dict(environment)
        )
        times.append(1e3 * (time.perf_counter() - start))
        if completed.returncode != 0:
            last = completed.stderr.strip().rpartition("\n")[2].removeprefix("milkglass: ")
            raise InputError(f"milkglass render failed in the benchmark: {last}")
        peak = max(peak, float(completed.stdout.split()[-1]))
    return ProcessRow(setting, Timing(tuple(times)), peak)


def program_environment() -> dict[str, str]:
    """Return an environment in which a new process finds the packages of this one, installed or not."""
    return os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
