"""What a sweep costs beside a command for each picture, what a second worker gains, and whether memory stays flat.

Costs are processor time of whole processes, from their start; commands are measured a few times and scaled.
"""

import json
import resource
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from milkglass.core.errors import InputError
from milkglass.viewer.bench.report import BenchReport
from milkglass.viewer.bench.speed import program_environment
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.sweep.sweep import Sweep

TURN, MATERIALS, WORKERS, MEMORY = "a turntable", "materials", "two workers", "memory"
SIDES = {TURN: 256, MATERIALS: 128}  # pixels
WANTED = {TURN: "at most 0.12", MATERIALS: "at most 0.2", WORKERS: "at least 1.7", MEMORY: "0.95 to 1.05"}
N_ROWS = len(WANTED)
SETTLED = 0.1  # of the pictures, after which a worker's memory is what it stays at
_RENDER = "import sys; from milkglass.viewer.commands.cli import main; sys.exit(main(sys.argv[1:]))"
_SWEEP = """
import json, os, sys
from pathlib import Path
from milkglass.viewer.sweep import pools, run, sweep
resident = []
def tell(_):
    resident.append(int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE"))
if __name__ == "__main__":
    run.run(sweep.Sweep.load(sys.argv[1]), Path(sys.argv[2]), pools.in_processes(int(sys.argv[3])), tell=tell)
    print(json.dumps(resident))
"""


@dataclass(frozen=True)
class SweepRow:
    """A figure of a sweep, and what it is measured by.

    Attributes
    ----------
    case : str
    pictures : int
    measured, beside : float
        Seconds, or MB.
    """

    case: str
    pictures: int
    measured: float
    beside: float

    @property
    def ratio(self) -> float:
        """The one over the other."""
        return self.measured / self.beside


@dataclass(frozen=True)
class _Run:
    processor: float  # s
    wall: float
    text: str


def sweep_rows(scene: Scene, frames: int, draws: int, commands: int, folder: Path) -> Iterator[SweepRow]:
    """Yield figures of a turntable and of random materials of a scene's object; files go to `folder`.

    Parameters
    ----------
    scene : Scene
    frames, draws : int
        Pictures of the turntable, and materials.
    commands : int
        Single commands of each, whose rays the sweep before has cast and kept.
    folder : Path
    """
    draw = '"material.sigma_s_prime" = {low = 1, high = 4}\n"material.sigma_a" = {low = 0.001, high = 0.05}\n'
    turning = _written(scene, TURN, f"[turntable]\nframes = {frames}\n", folder)
    varied = _written(scene, MATERIALS, f"[random]\ncount = {draws}\n{draw}", folder)
    turned, single = _swept(turning, folder), _single(turning, commands, folder)
    yield SweepRow(TURN, frames, turned.processor, single * frames)
    drawn, single = _swept(varied, folder), _single(varied, commands, folder)
    yield SweepRow(MATERIALS, draws, drawn.processor, single * draws)
    yield SweepRow(WORKERS, draws, drawn.wall, _swept(varied, folder, workers=2).wall)
    resident = [size / 1e6 for size in json.loads(drawn.text)]
    yield SweepRow(MEMORY, draws, resident[-1], resident[int(SETTLED * draws)])


def report_sweep(report: BenchReport, rows: Sequence[SweepRow], commands: int) -> None:
    """Report what sweeps cost, and write it to `sweep.csv`."""
    beside = {
        TURN: "commands, scaled",
        MATERIALS: "commands, scaled",
        WORKERS: "wall of two, of one before",
        MEMORY: "settled",
    }
    report.table(
        "Many pictures: processor seconds of a sweep, wall seconds of its workers, and MB at its end",
        ["case", "pictures", "sweep", "beside", "of", "ratio", "wanted"],
        (
            [
                row.case,
                str(row.pictures),
                f"{row.measured:.1f}",
                f"{row.beside:.1f}",
                beside[row.case],
                f"{row.ratio:.3f}",
                WANTED[row.case],
            ]
            for row in rows
        ),
    )
    report.say(f"Commands: the mean of {commands}, times the number of pictures.")
    report.csv(
        "sweep.csv",
        [
            {"case": row.case, "pictures": row.pictures, "measured": row.measured, "beside": row.beside}
            | {"sweep_ratio": row.ratio}
            for row in rows
        ],
    )


def _written(scene: Scene, case: str, varies: str, folder: Path) -> Path:
    side = SIDES[case]
    path = folder / f"{case.rpartition(' ')[2]}.toml"
    base = path.with_suffix(".scene.toml")
    replace(scene, display=replace(scene.display, image_size=(side, side))).save(base)
    path.write_text(f'scene = "{base.name}"\n{varies}[output]\nsheet = false\n', encoding="utf-8")
    return path


def _swept(path: Path, folder: Path, workers: int = 1) -> _Run:
    program = folder / "sweep_program.py"  # a file, which spawned workers import
    program.write_text(_SWEEP, encoding="utf-8")
    return _run([str(program), str(path), str(folder / f"{path.stem}-{workers}"), str(workers)])


def _single(path: Path, commands: int, folder: Path) -> float:
    """Return processor seconds of a command that makes one picture of a sweep, the mean of some."""
    many, picture, times = Sweep.load(path), folder / "single.png", []
    for i in range(commands):
        scene = folder / "single.toml"
        many.row(i).scene.save(scene)
        times.append(_run(["-c", _RENDER, "render", "--scene", str(scene), "--output", str(picture)]).processor)
    return sum(times) / len(times)


def _run(arguments: Sequence[str]) -> _Run:
    start, before = time.perf_counter(), _processor()
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, check=False, env=program_environment()
    )
    if done.returncode != 0:
        raise InputError(f"a command of the benchmark failed: {done.stderr.strip().rpartition(chr(10))[2]}")
    return _Run(_processor() - before, time.perf_counter() - start, done.stdout)


def _processor() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
