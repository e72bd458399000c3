"""The default transport compared with bare transforms and with the paper's setting, in turns within one process.

For a shape of marble: FFTW alone and scipy.fft on the padded boxes of the default `ewald` for its three channels, then
a new light by both methods, with the code of the renderer: deposit, convolution (FFT and multiplication), and the
gather, W^T O at 100,000 visible points on the CPU. Results that do not depend on light (weights, spectra) are cached.
"""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pyfftw
import scipy.fft

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.grid import layers
from milkglass.core.grid.kernels import Kernels
from milkglass.core.material import library as materials
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.stages import Stage
from milkglass.core.transport.ewald import make_transport
from milkglass.viewer.bench.error import SchemeRun, Target
from milkglass.viewer.bench.lights import LIGHTS
from milkglass.viewer.bench.report import BenchReport
from milkglass.viewer.bench.schemes import PAPER, Scheme
from milkglass.viewer.bench.speed import Timing, interleaved

MATERIAL = "marble"
LIGHT = "front"
VISIBLE_POINTS = 100_000
PIECES_ALONG_SIDE = 266  # along the longest side, from which these points are chosen
EFFORT = "FFTW_MEASURE"  # of the bare transforms; the convolution of the renderer uses FFTW_ESTIMATE
TARGET_RATIOS = {"convolution": 1.0, "new light": 1.5}  # largest accepted ratio to the time of the paper's setting

PaddedSize = tuple[int, int, int]


@dataclass(frozen=True)
class YardstickRow:
    """Times of one shape, ms.

    Attributes
    ----------
    shape, scheme : str
    boxes : tuple
        Padded (layers, rows, columns) of each channel.
    bare, scipy : Timing
        Times of the transforms of the boxes and back.
    default, paper : dict
        Times of "deposit", "convolution" and "gather".
    """

    shape: str
    scheme: str
    boxes: tuple[PaddedSize, ...]
    bare: Timing
    scipy: Timing
    default: dict[str, Timing]
    paper: dict[str, Timing]

    @property
    def ratios(self) -> dict[str, float]:
        """Ratios of medians by name."""
        default, paper = self.default["convolution"].median, self.paper["convolution"].median
        return {
            "convolution / bare": default / self.bare.median,
            "scipy / bare": self.scipy.median / self.bare.median,
            "convolution": default / paper,
            "new light": _total(self.default) / _total(self.paper),
        }


class NewLight:
    """A scheme on a target under repeated changes of light, with the times of its stages, ms."""

    def __init__(self, scheme: Scheme, target: Target) -> None:
        self._run, self._target = SchemeRun(scheme, target), target
        self._material, light = materials.lookup(MATERIAL), LIGHTS[LIGHT]
        self._quality = self._run.quality(light, self._material)
        self._placed = self._run.place(self._quality)
        self._flux = self._placed.flux(light, target.occluder, self._material.eta)
        self.times: dict[str, list[float]] = {}

    @property
    def boxes(self) -> tuple[PaddedSize, ...]:
        """Sizes to which `ewald` pads its channels."""
        transport, grid, area = make_transport(self._quality, Kernels()), self._placed.grid, self._target.mesh.area
        shapes = [transport.shape(grid, p, area) for p in dipoles(self._material) if not p.is_black]
        return tuple((s.padded_layers, s.padded_height, s.padded_width) for s in shapes)

    def __call__(self) -> None:
        """Run deposit, convolution and gather for a new light, and record their times."""
        placed, stages = self._placed, self._run.stages
        flux = self._flux.copy()  # a new array, so that stages run again
        stages.begin()
        volume = placed.transport.scatter(placed.entering(self._target.mesh, flux, self._material), stages).volume
        stages.run(Stage.GATHER, [volume], lambda: layers.gather(placed.gather, volume))
        for stage in (Stage.DEPOSIT, Stage.CONVOLUTION, Stage.GATHER):
            self.times.setdefault(stage, []).append(stages.timings[stage])

    def timings(self) -> dict[str, Timing]:
        """Return the times of all runs but the first."""
        return {stage: Timing(tuple(times[1:])) for stage, times in self.times.items()}


def yardstick_rows(
    shapes: Mapping[str, Callable[[], Mesh]], scheme: Scheme, repeats: int, n_points: int = VISIBLE_POINTS
) -> Iterator[YardstickRow]:
    """Yield a row for each shape."""
    for shape, make in shapes.items():
        target = Target.of(make(), n_points, pieces_along=PIECES_ALONG_SIDE)
        default, paper = NewLight(scheme, target), NewLight(PAPER, target)
        boxes = default.boxes
        bare, scipys, _, _ = interleaved([bare_transforms(boxes), scipy_transforms(boxes), default, paper], repeats)
        yield YardstickRow(shape, str(scheme), boxes, bare, scipys, default.timings(), paper.timings())


def bare_transforms(boxes: Sequence[PaddedSize]) -> Callable[[], object]:
    """Return a task of real 3-D transforms of the boxes and back, on all cores."""
    threads = os.cpu_count() or 1
    pool = ThreadPoolExecutor(threads)
    phases = [phase for box in boxes for phase in plan_phases(box, threads)]
    return lambda: [list(pool.map(pyfftw.FFTW.execute, phase)) for phase in phases]


def plan_phases(box: PaddedSize, threads: int) -> list[list[pyfftw.FFTW]]:
    """Return plans of a transform and its inverse, not normalised, in four phases whose plans may run concurrently.

    Threads share the layers for rows and columns, then the rows for the transform across layers, with separate plans,
    for the reason given in `viewer.bench.speed`.
    """
    depth, height, width = box
    real = pyfftw.zeros_aligned(box, "float32")
    spectrum = pyfftw.zeros_aligned((depth, height, width // 2 + 1), "complex64")
    layer_shares = [(real[share], spectrum[share]) for share in _shares(depth, threads)]
    row_shares = [spectrum[:, share] for share in _shares(height, threads)]
    options = {"flags": (EFFORT,)}
    inverse = {"direction": "FFTW_BACKWARD", "normalise_idft": False, **options}
    phases = [
        [pyfftw.FFTW(images, values, axes=(1, 2), **options) for images, values in layer_shares],
        [pyfftw.FFTW(values, values, axes=(0,), **options) for values in row_shares],
        [pyfftw.FFTW(values, values, axes=(0,), **inverse) for values in row_shares],
        [pyfftw.FFTW(values, images, axes=(1, 2), **inverse) for images, values in layer_shares],
    ]
    real[:] = 0.0  # planning leaves arbitrary values, and NaN is slow
    return phases


def _shares(count: int, parts: int) -> list[slice]:
    """Return slices of about equal size of a range."""
    ends = np.linspace(0, count, min(parts, count) + 1).astype(int).tolist()
    return [slice(*pair) for pair in pairwise(ends)]


def scipy_transforms(boxes: Sequence[PaddedSize]) -> Callable[[], object]:
    """Return a task of real 3-D transforms of the boxes and back by scipy.fft, on all cores."""
    threads = os.cpu_count() or 1
    maps = [np.random.default_rng(0).random(box, dtype=np.float32) for box in boxes]
    return lambda: [scipy.fft.irfftn(scipy.fft.rfftn(a, workers=threads), a.shape, workers=threads) for a in maps]


def report_yardsticks(report: BenchReport, rows: Sequence[YardstickRow]) -> None:
    """Report the convolution relative to bare transforms, then both methods."""
    if not rows:
        return
    report.table(
        f"Convolution of {rows[0].scheme} beside transforms of the same padded boxes, {MATERIAL}, ms, median",
        ["shape", "padded boxes", "FFTW alone", "scipy.fft", "convolution", "over FFTW alone"],
        (
            [
                r.shape,
                ", ".join("{} x {} x {}".format(*box) for box in r.boxes),
                f"{r.bare.median:.1f}",
                f"{r.scipy.median:.1f}",
                f"{r.default['convolution'].median:.1f}",
                f"{r.ratios['convolution / bare']:.2f}",
            ]
            for r in rows
        ),
    )
    report.table(
        f"New light by {rows[0].scheme} / by the paper's {PAPER}, {MATERIAL}, ms, median",
        [
            "shape",
            "deposit",
            "FFT + multiply",
            "gather, 100,000 points",
            "ratio of FFT + multiply",
            "ratio of all three",
        ],
        (
            [
                r.shape,
                *(
                    f"{r.default[s].median:.1f} / {r.paper[s].median:.1f}"
                    for s in (Stage.DEPOSIT, Stage.CONVOLUTION, Stage.GATHER)
                ),
                f"{r.ratios['convolution']:.2f}",
                f"{r.ratios['new light']:.2f}",
            ]
            for r in rows
        ),
    )
    report.say("Wanted: {convolution:g} for FFT + multiply, {new light:g} for all three.".format(**TARGET_RATIOS))
    report.csv("yardsticks.csv", [_csv(r) for r in rows])


def _csv(row: YardstickRow) -> dict[str, object]:
    sides = {"default": row.default, "paper": row.paper}
    return {
        "shape": row.shape,
        "scheme": row.scheme,
        "boxes": "; ".join("{} x {} x {}".format(*box) for box in row.boxes),
        "fftw_ms": row.bare.median,
        "scipy_ms": row.scipy.median,
        **{f"{side}_{stage}_ms": t.median for side, shapes in sides.items() for stage, t in shapes.items()},
        **{f"{name.replace(' / ', '_over_').replace(' ', '_')}_ratio": value for name, value in row.ratios.items()},
    }


def _total(times: Mapping[str, Timing]) -> float:
    """Return the median over the repeats of the sum of the stages."""
    return float(np.median(np.sum([t.times for t in times.values()], axis=0)))
