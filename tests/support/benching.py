"""A plan of the benchmark with nothing in it, and what every table must be."""

import numpy as np

from milkglass.viewer.bench import run as bench

NOTHING = bench.Plan(
    convolutions=(), frames=(), processes=(), schemes=(), shapes=("plate",), materials=("skim milk",), points=8,
    pictures=(), rivals=(), window_repeats=0, sight_repeats=0, swept=(), yardsticks=(), solved=(), methods=(),
    occluded_points=0, exchange_repeats=0, exchange_processes=0, photographs=(),
    repeats=1, frame_repeats=1, process_repeats=1, image_size=(32, 32), side=16,
)  # fmt: skip


def assert_finite(rows: list[dict[str, str]]) -> None:
    """Every field that is a number is a finite one, and each row has some."""
    for row in rows:
        numbers = [float(v) for k, v in row.items() if k.rsplit("_", 1)[-1] in {"ms", "mb", "r", "g", "b", "ratio"}]
        assert numbers
        assert np.isfinite(numbers).all()
