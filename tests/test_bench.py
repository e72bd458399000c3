"""The benchmark, very small: what it writes is finite, complete and right. No time is asserted."""

import builtins
import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core import materials
from core.dipole import dipoles
from core.errors import InputError
from core.reference import direct_exitance
from viewer import bench, bench_window
from viewer.bench_error import (
    EWALD,
    LAYERED,
    LIGHTS,
    PAPER,
    BenchLight,
    Scheme,
    Target,
    error_rows,
)
from viewer.bench_report import scheme_times
from viewer.bench_shapes import SHAPES, ball
from viewer.deviation import Deviation
from viewer.settings import TransportSettings

NOTHING = bench.Plan(
    convolutions=(), frames=(), processes=(), schemes=(), shapes=("plate",), materials=("skim milk",), points=8,
    pictures=(), rivals=(), window=(), repeats=1, frame_repeats=1, process_repeats=1, image_size=(32, 32), side=16,
)  # fmt: skip
SMALL = Scheme("layered", 2, 16)
SETTLING = bench_window.FIRST, bench_window.SETTLED


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def assert_finite(rows: list[dict[str, str]]) -> None:
    """Every field that is a number is a finite one, and each row has some."""
    for row in rows:
        numbers = [float(v) for k, v in row.items() if k.rsplit("_", 1)[-1] in {"ms", "mb", "r", "g", "b", "ratio"}]
        assert numbers
        assert np.isfinite(numbers).all()


@pytest.fixture
def coarse_reference(monkeypatch):
    monkeypatch.setattr("viewer.bench_error.REFERENCE_EDGE", 0.6)
    monkeypatch.setattr("viewer.bench_chain.REFERENCE_EDGE", 0.6)
    of = Target.of.__func__
    monkeypatch.setattr(Target, "of", classmethod(lambda cls, mesh, n: of(cls, mesh, n, edge=0.6)))


@pytest.mark.gl
def test_every_part_writes_finite_numbers(tmp_path, capsys, monkeypatch, coarse_reference):
    monkeypatch.setattr("viewer.bench_chain.IMAGE", 64)
    plan = replace(
        NOTHING, convolutions=(2,), frames=(SMALL,), schemes=(SMALL, EWALD[0]), picture_schemes=(SMALL,),
        pictures=(("plate", "skim milk", "back"),),
    )  # fmt: skip
    bench.run_plan(plan, tmp_path / "new" / "folder")
    found = {path.name: path for path in (tmp_path / "new" / "folder").iterdir()}
    assert found.keys() - {"error.png"} == {"convolution.csv", "frames.csv", "error.csv", "chain.csv", "bench.md"}
    for name in ("convolution.csv", "frames.csv", "error.csv", "chain.csv"):
        rows = rows_of(found[name])
        assert rows
        assert_finite(rows)
    assert len(rows_of(found["error.csv"])) == 2 * 1 * 1 * 3
    # What the terminal shows is what the file keeps, and no line is broken or padded.
    shown = capsys.readouterr().out
    for line in found["bench.md"].read_text().splitlines():
        assert line.removeprefix("### ") in shown
        assert line == line.rstrip()


@pytest.mark.gl
@pytest.mark.slow
def test_first_picture_has_time_and_memory(tmp_path):
    bench.run_plan(replace(NOTHING, processes=(SMALL,)), tmp_path)
    (row,) = rows_of(tmp_path / "processes.csv")
    assert 20.0 < float(row["peak_mb"]) < 4000.0
    assert 0.0 < float(row["run_min_ms"]) <= float(row["run_median_ms"])


@pytest.mark.gl
def test_window_is_measured_and_reported(tmp_path, capsys):
    plan = replace(NOTHING, window=(SMALL,), window_repeats=3, image_size=(96, 64))
    bench.run_plan(plan, tmp_path)
    rows = rows_of(tmp_path / "window.csv")
    assert_finite(rows)
    assert [row["what"] for row in rows] == [
        bench_window.ORBIT, bench_window.ORBIT_DRAFT, bench_window.PLAIN, bench_window.FIRST, bench_window.SETTLED,
        bench_window.EXPOSURE, bench_window.REST, bench_window.PANEL,
    ]  # fmt: skip
    assert len(rows) == bench_window.COUNT
    first, settled = (float(next(r for r in rows if r["what"] == what)["median_ms"]) for what in SETTLING)
    assert 0.0 < first < settled < 1e3 * bench_window.LIMIT
    assert "of the rate without scattering" in capsys.readouterr().out


def test_plans_name_what_exists():
    for plan in (bench.FULL, bench.QUICK):
        assert PAPER in plan.schemes
        assert set(plan.shapes) <= SHAPES.keys()
        assert set(plan.lights) <= LIGHTS.keys()
        for name in plan.materials:
            materials.lookup(name)
        for scheme in (*plan.schemes, *plan.frames, *plan.picture_schemes):
            assert isinstance(scheme.settings, TransportSettings)
    assert [str(s) for s in bench.QUICK.schemes[:5]] == [str(s) for s in LAYERED[:5]]
    assert str(PAPER) == "layered 4 x 256"
    assert str(EWALD[0]) == "ewald 2 %"


def test_error_falls_with_layers_and_the_split_beats_the_paper(coarse_reference):
    schemes = (Scheme("layered", 2, 64), Scheme("layered", 32, 64), Scheme("ewald", None, 40))
    rows = list(error_rows(schemes, ["plate"], ["skim milk"], ["back"], 60))
    few, many, split = (max(r.deviation.rms) for r in rows)
    assert many < 0.5 * few
    assert split < 0.05 < few
    times = scheme_times(rows)
    assert list(times) == list(schemes)
    assert all(0.0 < light <= everything for light, everything in times.values())


def test_rivals_are_the_same_sum(tmp_path, coarse_reference):
    bench.run_plan(replace(NOTHING, rivals=(("plate", "skim milk", "back"),), points=20), tmp_path)
    rows = rows_of(tmp_path / "rivals.csv")
    assert_finite(rows)
    methods = [row["method"] for row in rows]
    assert methods[0] == "direct sum"
    assert methods[-1] == str(EWALD[0])
    errors = [float(row["rms_g"]) for row in rows]
    assert errors[0] == 0.0
    assert errors[-2] < errors[1] / 3.0  # the tolerances fall
    assert errors[-1] < 0.02


def test_points_are_visible_and_the_reference_is_the_direct_sum():
    target = Target.of(ball(subdivisions=3), 40, edge=1.0)
    towards = target.rotation[:, 2]  # +z of view space points to the eye
    assert ((target.points.normals @ towards) > -1e-3).all()
    material, light = materials.lookup("marble"), LIGHTS["stripes"]
    flux = light.irradiance(target.occluder, target.sources, material.eta) * target.sources.areas[:, None]
    expected = direct_exitance(target.points.points, target.sources.points, flux, dipoles(material))
    np.testing.assert_allclose(target.reference(light, material), expected, rtol=1e-12)


def test_stripes_are_bars_and_gaps_of_one_width():
    target = Target.of(ball(subdivisions=4), 1, edge=0.3)
    striped, plain = (LIGHTS[name].irradiance(target.occluder, target.sources, 1.5) for name in ("stripes", "front"))
    lit = plain[:, 0] > 0.0
    share = (striped[lit, 0] > 0.0).mean()
    assert 0.4 < share < 0.6
    np.testing.assert_array_equal(striped[striped > 0.0], plain[striped > 0.0])


def test_light_across_a_plate_has_its_thickness_and_the_irradiance_of_the_other_side():
    target = Target.of(SHAPES["plate"](), 30, edge=0.6)
    light = BenchLight("behind", (0.2, 0.1, -1.0))
    reach = 4.0
    # farther from the rim than the rays that look whether the sheet goes on
    inner = np.abs(target.points.points[:, :2]).max(axis=1) < 8.5
    front = (target.points.normals[:, 2] > 0.5) & inner
    assert front.sum() > 15
    thickness, other_side = light.across(target.rays, target.points, 1.5, reach)
    np.testing.assert_allclose(thickness[front], 1.0, rtol=1e-4)
    lit = light.irradiance(target.occluder, target.sources, 1.5)[target.sources.normals[:, 2] < -0.5]
    np.testing.assert_allclose(other_side[front], np.broadcast_to(lit[0], (front.sum(), 3)), rtol=1e-5)


def test_the_far_side_of_a_ball_is_no_sheet():
    """At the edge of the light both sides are close, but not parallel."""
    target = Target.of(ball(subdivisions=4), 200, edge=1.0)
    _, other_side = BenchLight("behind", (0.2, 0.1, -1.0)).across(target.rays, target.points, 1.5, 4.0)
    assert other_side.max() < 0.01


def test_deviation_of_known_arrays():
    reference = np.array([[3.0, 1.0, 0.0], [4.0, 1.0, 0.0]])
    found = Deviation.of(reference * [1.1, 0.5, 1.0], reference)
    np.testing.assert_allclose(found.rms, [0.1, 0.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.ratio, [1.1, 0.5, 1.0])
    assert found.p99[0] == pytest.approx(0.4 / np.sqrt(12.5), rel=0.01)  # the larger of the two


def test_without_matplotlib_tables_are_written_and_a_sentence_says_so(tmp_path, capsys, monkeypatch, coarse_reference):
    real = builtins.__import__

    def refuse(name, *args, **kwargs):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    bench.run_plan(replace(NOTHING, schemes=(SMALL,), lights=("front",)), tmp_path)
    assert 'pip install "milkglass[bench]"' in capsys.readouterr().out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bench.md", "error.csv"]


def test_plot_is_a_png(tmp_path, coarse_reference):
    pytest.importorskip("matplotlib", reason="the plot is an extra")
    bench.run_plan(replace(NOTHING, schemes=(SMALL,), lights=("front",)), tmp_path)
    assert (tmp_path / "error.png").read_bytes().startswith(b"\x89PNG")


def test_unusable_folder_is_refused_before_any_work(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot make the folder"):
        bench.run(False, tmp_path / "file")
