"""The benchmark, very small: what it writes is finite, complete and right. No time is asserted."""

import builtins
import csv
import dataclasses
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import flaws
from milkglass.core.geometry.normals import vertex_normals
from milkglass.core.geometry.samples import surface_samples
from milkglass.core.light.probe import irradiance_direct
from milkglass.core.material import library as materials
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.reference.deviation import Deviation
from milkglass.core.reference.equation import Occluder, direct_exitance
from milkglass.core.stages import Stage, Stages
from milkglass.viewer.assets import sources
from milkglass.viewer.bench import (
    exchange as bench_exchange,
    opaque_viewers,
    report as bench_report,
    run as bench,
    sight as bench_sight,
    solving as bench_solving,
    speed as bench_speed,
    sweep as bench_sweep,
    window as bench_window,
)
from milkglass.viewer.bench.error import SchemeRun, Target, error_rows, megabytes
from milkglass.viewer.bench.error_report import scheme_times
from milkglass.viewer.bench.lights import LIGHTS, Directional, sky_pixels
from milkglass.viewer.bench.plot import pareto
from milkglass.viewer.bench.reference import graded_exitance
from milkglass.viewer.bench.schemes import DEFAULT, LAYERED, PAPER, Scheme
from milkglass.viewer.bench.shapes import SHAPES, ball, detail, torus
from milkglass.viewer.bench.yardsticks import plan_phases, yardstick_rows
from milkglass.viewer.scene.settings import TransportSettings
from tests.support.benching import NOTHING, assert_finite

SMALL = Scheme("layered", 2, 16)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def coarse_reference(monkeypatch):
    monkeypatch.setattr("milkglass.core.reference.sources.EDGE_OVER_MEAN_FREE_PATH", 0.8)
    monkeypatch.setattr("milkglass.core.reference.sources.EDGE_OVER_DISTANCE", 0.4)
    monkeypatch.setattr("milkglass.viewer.bench.rivals.SAMPLE_EDGE", 0.6)


@pytest.fixture
def small_object(monkeypatch):
    """A ring in place of the sculpture."""
    monkeypatch.setattr(sources, "builtin_model", lambda size_mm, up: torus())
    monkeypatch.setattr(bench, "builtin_model", lambda size_mm: torus())


@pytest.mark.slow
@pytest.mark.gl
def test_every_part_writes_finite_numbers(tmp_path, capsys, monkeypatch, coarse_reference, few_rays, small_object):
    monkeypatch.setattr("milkglass.viewer.bench.chain.IMAGE_SIDE", 64)
    plan = replace(
        NOTHING, convolutions=(2,), frames=(SMALL,), schemes=(SMALL, DEFAULT), picture_schemes=(SMALL,),
        pictures=(("plate", "skim milk", "back"),), photographs=(64,),
    )  # fmt: skip
    bench.run_plan(plan, tmp_path / "new" / "folder")
    found = {path.name: path for path in (tmp_path / "new" / "folder").iterdir()}
    assert found.keys() - {"error.png"} == {"convolution.csv", "frames.csv", "error.csv", "chain.csv", "bench.md"}
    for name in ("convolution.csv", "frames.csv", "error.csv", "chain.csv"):
        rows = rows_of(found[name])
        assert rows
        assert_finite(rows)
    edited = {row["stage"]: float(row["ms"]) for row in rows_of(found["frames.csv"]) if "edit" in row["change"]}
    assert edited["reading"] + edited["depth and surface"] + edited["rendering"] + edited["file"] <= edited["frame"]
    rows = rows_of(found["error.csv"])
    assert len(rows) == 2 * 1 * 1 * 4
    for row in rows:  # what was used, not what was asked for
        assert row["assignment"] in ("tent", "tsc")
        assert (row["predicted_error"] == "") == (row["transport"] == "layered")
        assert int(row["layers"]) >= 2
        assert int(row["resolution"]) >= 16
        assert float(row["memory_mb"]) > 0.0
        assert float(row["rms"]) == max(float(row[f"rms_{c}"]) for c in "rgb")
        for stage in ("weights", "deposit", "spectra", "convolution"):
            assert float(row[f"{stage}_ms"]) > 0.0
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


@pytest.mark.slow
@pytest.mark.gl
def test_window_is_measured_beside_other_viewers(tmp_path, capsys, monkeypatch, small_object):
    viewer = tmp_path / "stand_in.py"  # of a program that draws at once
    drawn = "print('hello\\ncpu_ms 2.5', flush=True)\n"
    viewer.write_text(f"import sys\n{drawn}for _ in sys.stdin:\n    {drawn}")
    monkeypatch.setattr(opaque_viewers, "installed", lambda: (bench_window.ANCHOR,))
    monkeypatch.setattr(opaque_viewers, "COMMAND", (sys.executable, str(viewer)))
    bench.run_plan(replace(NOTHING, window_repeats=3, image_size=(96, 64)), tmp_path)
    rows = rows_of(tmp_path / "window.csv")
    assert_finite(rows)
    assert list(rows[0]) == ["program", "case", "cpu_ms"]
    of_others = {row["case"]: float(row["cpu_ms"]) for row in rows if row["program"] == bench_window.ANCHOR}
    assert of_others == {bench_window.OPENED: 2.5, bench_window.ORBIT_DRAGGED: 2.5}
    ours = {row["case"]: float(row["cpu_ms"]) for row in rows if row["program"] == bench_window.OURS}
    assert set(ours) == set(bench_window.CASES)
    assert 0.0 < ours[bench_window.FIRST] < ours[bench_window.SETTLED]
    assert f"{ours[bench_window.ORBIT_DRAGGED] / 2.5:.2f}" in capsys.readouterr().out


def test_sweeps_are_measured_beside_commands(tmp_path, monkeypatch):
    calls = []

    def ran(arguments):
        calls.append(arguments)
        is_sweep, two = arguments[0] != "-c", arguments[-1] == "2"
        resident = [2e8] * 5 + [2.02e8] * 5
        return bench_sweep._Run(12.0 if is_sweep else 8.0, 4.0 if two else 7.0, str(resident))

    monkeypatch.setattr(bench_sweep, "_run", ran)
    bench.run_plan(replace(NOTHING, swept=(6, 10), sweep_commands=3), tmp_path)
    assert [arguments[0] == "-c" for arguments in calls] == [False, True, True, True, False, True, True, True, False]
    found = {row["case"]: float(row["sweep_ratio"]) for row in rows_of(tmp_path / "sweep.csv")}
    assert found == {
        bench_sweep.TURN: 12.0 / (6 * 8.0), bench_sweep.MATERIALS: 12.0 / (10 * 8.0),
        bench_sweep.WORKERS: 7.0 / 4.0, bench_sweep.MEMORY: pytest.approx(1.01),
    }  # fmt: skip


def test_without_other_viewers_the_window_is_measured_alone(capsys):
    report = bench_report.BenchReport(None)
    bench_window.report_window(
        report, "a mesh", [bench_window.WindowRow(bench_window.OURS, bench_window.FIRST, bench_speed.Timing((7.0,)))]
    )
    printed = capsys.readouterr().out
    assert "7.0" in printed
    assert "milkglass[rivals]" in printed


def test_a_viewer_that_does_not_start_has_no_row_and_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(opaque_viewers, "installed", lambda: (bench_window.ANCHOR,))
    monkeypatch.setattr(opaque_viewers, "COMMAND", (sys.executable, "-c", "raise SystemExit('no display')"))
    with opaque_viewers.started(tmp_path / "model.ply", 64) as viewers:
        assert viewers == {}
    ours = bench_window.WindowRow(bench_window.OURS, bench_window.FIRST, bench_speed.Timing((7.0,)))
    bench_window.report_window(bench_report.BenchReport(None), "a mesh", [ours])
    assert f"{bench_window.ANCHOR} is installed, but did not draw" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.gl
def test_light_between_parts_is_measured_beside_none(tmp_path, monkeypatch, few_rays, small_object):
    one = "a step of a slider"
    monkeypatch.setattr(bench_exchange, "CHANGES", {one: bench_exchange.CHANGES[one]})
    bench.run_plan(replace(NOTHING, exchange_repeats=1, image_size=(24, 24)), tmp_path)
    changes, rays = rows_of(tmp_path / "exchange.csv"), rows_of(tmp_path / "exchange_rays.csv")
    assert_finite(changes)
    assert [row["until"] for row in changes] == ["first shown", "solved", "drawn"]
    assert all(0 < int(row[f"products_{setting}"]) < 120 for row in changes for setting in ("off", "on"))
    shown, solved, drawn = (float(row["on_ms"]) for row in changes)
    assert 0.0 < shown <= solved < drawn
    assert float(rays[0]["bake_ratio"]) == 1.0
    assert all(float(row["seconds"]) > 0.0 for row in rays)


def test_parts_can_be_run_alone():
    alone = bench.of_parts(bench.QUICK, ["window", "rivals"])
    assert alone.window_repeats == bench.FULL.window_repeats  # which the small selection lacks
    assert alone.rivals == bench.QUICK.rivals
    fields = {field for of_part in bench.PARTS.values() for field in of_part}
    assert fields < {field.name for field in dataclasses.fields(bench.Plan)}
    assert not any(getattr(alone, field) for field in fields - {"window_repeats", "rivals"})
    assert bench.of_parts(bench.QUICK, bench.PARTS) is bench.QUICK
    for names in (["windows"], ["window", ""], []):
        with pytest.raises(InputError, match=r"choose parts of the benchmark from convolution, .*, window, "):
            bench.of_parts(bench.FULL, names)


def test_plans_name_what_exists():
    for plan in (bench.FULL, bench.QUICK):
        assert PAPER in plan.schemes
        assert set(plan.shapes) <= SHAPES.keys()
        assert set(plan.lights) <= LIGHTS.keys()
        for name in (*plan.materials, bench_sight.CLEAR, bench_sight.MURKY, bench_sight.DENSE):
            materials.lookup(name)
        for scheme in (*plan.schemes, *plan.frames, *plan.picture_schemes):
            assert isinstance(scheme.settings, TransportSettings)
    assert [str(s) for s in bench.QUICK.schemes[:3]] == [str(s) for s in LAYERED[:3]]
    assert bench.FULL.materials == ("marble", "skim milk", "whole milk", "ketchup", "skin1", "jade")
    assert set(bench.FULL.shapes) == {"ball", "plate", "knot", "detail"}
    assert set(bench.FULL.lights) == {"front", "back", "sharp shadow", "environment"}
    assert {s.assignment for s in bench.FULL.schemes} == {None, "tent", "tsc"}
    assert Scheme("layered", 4, 256) == PAPER
    assert str(PAPER) == "layered 4 x 256"
    assert str(DEFAULT) == "ewald default"
    assert str(Scheme("ewald", None, 40, assignment="tent")) == "ewald 40 tent"


@pytest.mark.slow
def test_error_falls_with_layers_and_the_split_beats_the_paper(coarse_reference):
    schemes = (Scheme("layered", 2, 64), Scheme("layered", 32, 64), Scheme("ewald", None, 40))
    rows = list(error_rows(schemes, {"plate": SHAPES["plate"]}, ["skim milk"], ["back"], 60))
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
    assert methods[-1] == str(DEFAULT)
    errors = [float(row["rms_g"]) for row in rows]
    assert errors[0] == 0.0
    assert errors[-2] < errors[1] / 3.0  # the tolerances fall
    assert errors[-1] < 0.02


def test_points_are_visible():
    target = Target.of(ball(subdivisions=3), 40)
    towards = target.rotation[:, 2]  # +z of view space points to the eye
    assert ((target.points.normals @ towards) > -1e-3).all()


@pytest.mark.slow
def test_the_reference_is_the_direct_sum_of_every_material_and_light():
    """Against an even cover by `core.reference.equation.direct_exitance`."""
    mesh = ball(diameter=4.0, subdivisions=3)
    target, lights = Target.of(mesh, 12), list(LIGHTS.values())
    several = [materials.lookup(name) for name in ("whole milk", "ketchup")]
    sources, points = surface_samples(mesh, 0.05), target.points.points
    found = target.references(lights, several)
    for material, by_light in zip(several, found, strict=True):
        for light, M in zip(lights, by_light, strict=True):
            flux = light.irradiance(target.occluder, sources, material.eta) * sources.areas[:, None]
            expected = direct_exitance(points, sources.points, flux, dipoles(material))
            assert max(Deviation.of(M, expected).rms) < 0.003


def test_black_has_no_reference():
    black = materials.Material("black", (0.0,) * 3, (1.0,) * 3)
    assert not graded_exitance(ball(subdivisions=1), np.zeros((1, 3)), list(LIGHTS.values()), [black]).any()


def test_stripes_are_bars_and_gaps_of_one_width():
    mesh = ball(subdivisions=4)
    occluder, samples = Occluder(mesh), surface_samples(mesh, 0.3)
    striped, plain = (LIGHTS[name].irradiance(occluder, samples, 1.5) for name in ("sharp shadow", "front"))
    lit = plain[:, 0] > 0.0
    share = (striped[lit, 0] > 0.0).mean()
    assert 0.4 < share < 0.6
    np.testing.assert_array_equal(striped[striped > 0.0], plain[striped > 0.0])


def test_the_sky_lights_by_normals_and_not_the_ground_side():
    mesh, sky = ball(subdivisions=3), LIGHTS["environment"]
    assert not sky.sharp
    samples = surface_samples(mesh, 2.0)
    found = sky.irradiance(Occluder(mesh), samples, 1.3)
    few = slice(None, None, 50)
    expected = irradiance_direct(sky_pixels(), samples.normals[few], 1.3)
    np.testing.assert_allclose(found[few], expected, rtol=0.01)
    up = samples.normals[:, 1]
    assert found[up > 0.9].mean() > 3.0 * found[up < -0.9].mean()
    thickness, other_side = sky.far_irradiance(Target.of(mesh, 1).rays, samples, 1.3, 1.0)
    assert not thickness.any()
    assert not other_side.any()


def test_the_sky_is_no_sharp_light_for_the_error_target(coarse_reference):
    run = SchemeRun(DEFAULT, Target.of(SHAPES["plate"](), 5))
    soft, sharp = (run.quality(LIGHTS[name], materials.lookup("jade")) for name in ("environment", "front"))
    assert soft.resolution < sharp.resolution


def test_detail_is_a_closed_solid_of_fine_bumps():
    mesh = detail()
    assert flaws(mesh).solid
    assert np.ptp(mesh.bounds, axis=0).max() == pytest.approx(20.0, rel=1e-5)
    height = np.linalg.norm(mesh.vertices, axis=1)
    assert 0.4 < np.ptp(height) < 0.7
    of_faces = vertex_normals(mesh.vertices.astype(np.float64), mesh.faces)
    assert np.einsum("ij,ij->i", of_faces, mesh.normals).min() > 0.99


def test_memory_counts_each_array_once_and_views_by_what_they_show():
    stages = Stages()
    base = np.zeros(250_000, np.float32)
    stages.run(Stage.DEPOSIT, [base], lambda: [base[10:20], base.reshape(500, 500)])
    stages.run(Stage.FLUX, [], lambda: {"own": np.zeros(500_000)})
    assert megabytes(stages) == pytest.approx(5.0)
    assert megabytes(stages, excluded=[base]) == pytest.approx(4.0)


def test_pareto_front_is_what_nothing_beats():
    points = [(1.0, 5.0), (2.0, 6.0), (2.0, 3.0), (3.0, 3.0), (4.0, 1.0), (0.5, 9.0)]
    assert pareto(points) == [5, 0, 2, 4]


def test_solutions_of_diffusion_are_timed_to_their_end(tmp_path, monkeypatch):
    monkeypatch.setattr("milkglass.viewer.bench.solving.NODES", (16,))
    monkeypatch.setattr("milkglass.viewer.bench.solving.MIN_SAMPLES", 500)
    bench.run_plan(replace(NOTHING, solved=("ball",), solved_repeats=1), tmp_path)
    rows = rows_of(tmp_path / "solving.csv")
    assert_finite(rows)
    assert [row["changed"] for row in rows] == list(bench_solving.CHANGES)
    for row in rows:
        assert 0.0 < float(row["first_ms"]) <= float(row["solved_ms"])
        assert int(row["products"]) > 1


@pytest.mark.slow
def test_yardsticks_transform_the_boxes_of_the_default(tmp_path):
    shapes = {"ball": lambda: ball(subdivisions=2)}
    (row,) = yardstick_rows(shapes, DEFAULT, 2, 500)
    assert len(row.boxes) == 3
    assert min(row.ratios.values()) > 0.0
    for found in (row.bare, row.scipy, *row.default.values(), *row.paper.values()):
        assert len(found.times) == 2
    assert row.default.keys() == row.paper.keys() == {"deposit", "convolution", "gather"}


def test_bare_transforms_are_whole_ones():
    """There and back is the number of nodes times what went in, and halfway lies the spectrum."""
    phases = plan_phases((6, 8, 10), 3)
    box = np.random.default_rng(0).random((6, 8, 10), dtype=np.float32)
    for plan, part in zip(phases[0], np.array_split(box, 3), strict=True):
        plan.input_array[:] = part
    for plan in (*phases[0], *phases[1]):
        plan.execute()
    spectrum = np.concatenate([plan.output_array for plan in phases[1]], axis=1)
    np.testing.assert_allclose(spectrum, np.fft.rfftn(box), rtol=0.0, atol=1e-4)
    for plan in (*phases[2], *phases[3]):
        plan.execute()
    found = np.concatenate([plan.output_array for plan in phases[3]])
    np.testing.assert_allclose(found, box.size * box, rtol=1e-4)


@pytest.mark.slow
def test_a_model_joins_the_error_sweep(tmp_path, coarse_reference):
    mesh = ball(diameter=1.0, subdivisions=2)
    trimesh.Trimesh(mesh.vertices, mesh.faces).export(tmp_path / "egg.ply")
    plan = replace(NOTHING, schemes=(SMALL,), lights=("front",), materials=("jade",))
    bench.run_plan(plan, tmp_path / "out", tmp_path / "egg.ply")
    rows = rows_of(tmp_path / "out" / "error.csv")
    assert [row["shape"] for row in rows] == ["plate", "egg, 100 mm"]
    assert_finite(rows)


def test_light_across_a_plate_has_its_thickness_and_the_irradiance_of_the_other_side():
    target = Target.of(SHAPES["plate"](), 30)
    light = Directional("behind", (0.2, 0.1, -1.0))
    reach = 4.0
    # farther from the rim than the rays that look whether the sheet goes on
    inner = np.abs(target.points.points[:, :2]).max(axis=1) < 8.5
    front = (target.points.normals[:, 2] > 0.5) & inner
    assert front.sum() > 15
    thickness, other_side = light.far_irradiance(target.rays, target.points, 1.5, reach)
    np.testing.assert_allclose(thickness[front], 1.0, rtol=1e-4)
    sources = surface_samples(target.mesh, 0.6)
    lit = light.irradiance(target.occluder, sources, 1.5)[sources.normals[:, 2] < -0.5]
    np.testing.assert_allclose(other_side[front], np.broadcast_to(lit[0], (front.sum(), 3)), rtol=1e-5)


def test_the_far_side_of_a_ball_is_no_sheet():
    """At the edge of the light both sides are close, but not parallel."""
    target = Target.of(ball(subdivisions=4), 200)
    _, other_side = Directional("behind", (0.2, 0.1, -1.0)).far_irradiance(target.rays, target.points, 1.5, 4.0)
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
        bench.run(tmp_path / "file", quick=False)
