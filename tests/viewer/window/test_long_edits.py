"""Many edits in a window: memory and threads stay what they were.

MILKGLASS_LONG_USE=1000 makes so many edits in place of those that every run has time for.
"""

import gc
import os
import threading
from pathlib import Path

import pytest

from milkglass.viewer.render import memory
from tests.support.driving import driven

EDITS = (
    ("material", {"name": "marble"}), ("display", {"key": 0.3}), ("camera", {"azimuth_deg": 70.0}),
    ("material", {"name": "skim milk"}), ("environment", {"builtin": "studio"}), ("specular", {"shininess": 80.0}),
    ("transport", {"method": "ewald"}), ("camera", {"azimuth_deg": 10.0}), ("environment", {"builtin": None}),
    ("transport", {"method": "diffusion"}), ("model", {"size_mm": 20.0}), ("model", {"size_mm": 100.0}),
)  # fmt: skip
ROUNDS = max(4, int(os.environ.get("MILKGLASS_LONG_USE", "0")) // len(EDITS))
WARM = 2  # rounds until what is kept for undoing an edit is all there
GROWTH = 30 << 20  # bytes


def resident_bytes():
    gc.collect()
    memory.give_back()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory as Linux tells it")
def test_many_edits_leave_nothing_behind(context, model, tmp_path, few_rays):
    with driven(model, (320, 240), tmp_path) as driver:
        seen = []
        for _ in range(ROUNDS):
            for table, values in EDITS:
                driver.session.edit(table, **values)
                driver.frames(2)
            driver.settle()
            seen.append((threading.active_count(), resident_bytes()))
        threads, heap = zip(*seen[WARM:], strict=True)
        assert len(set(threads)) == 1
        assert max(heap) - heap[0] < GROWTH, heap
