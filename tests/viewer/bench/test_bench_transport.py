"""Error against transport in the benchmark: its shapes, its two errors, what it writes. No time is asserted."""

import csv
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from milkglass.core.geometry.mesh import face_cross, flaws
from milkglass.core.reference.regions import find_regions
from milkglass.core.reference.transport_error import TransportError
from milkglass.core.transport.diffusion.boundary import is_closed, row_sums
from milkglass.viewer.bench import run as bench
from milkglass.viewer.bench.report import BenchReport
from milkglass.viewer.bench.schemes import Scheme
from milkglass.viewer.bench.shapes import ball, bolt, bowl, gear, gyroid
from milkglass.viewer.bench.transport import (
    ALBEDOS,
    ALL,
    LIGHT,
    LIGHTS,
    MATERIAL,
    METHODS,
    SHAPES,
    TransportRow,
    is_in_sample,
    material_of,
    numerical_error,
    transport_rows,
)
from milkglass.viewer.bench.transport_report import report_transport, rms_text
from tests.support.benching import NOTHING, assert_finite

SMALL = Scheme("layered", 8, 64), Scheme("diffusion", resolution=24)


@pytest.fixture(scope="module", autouse=True)
def fine_enough():
    """The default's nodes stand for twice as many, which take ten times as long."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench.bench_transport, "FINER", 1)
        yield


@pytest.fixture(scope="module")
def rows(fine_enough) -> list[TransportRow]:
    shapes = {"ball": lambda: ball(8.0, subdivisions=3)}
    return list(transport_rows(SMALL, shapes, ["albedos", "skim milk"], 20_000))


@pytest.mark.slow
def test_diffusion_is_near_photons_and_the_paper_is_not(rows):
    for row in rows:
        if row.scheme.method == "diffusion":
            assert max(row.error.rms) < 0.08
            assert max(np.abs(row.error.dark)) < 0.12
        else:
            assert min(row.error.rms) > 0.1
            assert max(row.error.dark) < -0.2


@pytest.mark.slow
def test_numbers_and_model_err_apart(rows):
    for row in rows:
        if row.scheme.method == "diffusion":
            assert 0.0 < min(row.numerical) <= max(row.numerical) < 0.03
            assert 3 <= row.products <= 20
            assert 0.0 < row.residual <= 3e-4
        else:
            assert row.numerical == (0.0, 0.0, 0.0)
            assert row.products == 0


@pytest.mark.slow
def test_either_light_or_material_changes(rows):
    for scheme in SMALL:
        own = [r for r in rows if r.scheme == scheme]
        assert [r.changed for r in own] == [ALL, LIGHT, MATERIAL, LIGHT]
        assert [r.light for r in own] == ["front", "back", "back", "front"]
        assert all(r.ms > 0.0 for r in own)


def test_a_finer_grid_of_the_same_has_no_numerical_error():
    surface = find_regions(ball(8.0, subdivisions=3), 10).samples

    def evaluate(factor):
        return lambda points, normals: factor * (2.0 + normals)

    assert numerical_error(evaluate(1.0), evaluate(1.0), surface) == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(numerical_error(evaluate(1.1), evaluate(1.0), surface), 0.1)


@pytest.mark.slow
def test_shapes_are_closed_solids():
    for make in SHAPES.values():
        assert is_closed(row_sums(make()))


def test_a_bowl_is_half_a_shell():
    mesh = bowl(20.0, 3.0)
    assert flaws(mesh).solid
    # Between two half balls, and half a ring of half a disc, by Pappus.
    expected = 2.0 / 3.0 * np.pi * (10.0**3 - 7.0**3) + 0.5 * np.pi * 1.5**2 * 2.0 * np.pi * 8.5
    assert mesh.volume == pytest.approx(expected, rel=0.002)
    cross = face_cross(mesh.vertices, mesh.faces)
    cross /= np.linalg.norm(cross, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", cross, mesh.normals[mesh.faces].mean(axis=1)).min() > 0.99


def test_kept_out_shapes_have_the_volumes_of_their_closed_forms():
    hexagon, circle = 0.5 * np.sqrt(3.0) * 10.0**2, 0.5 * 48 * 3.0**2 * np.sin(2.0 * np.pi / 48)
    assert bolt().volume == pytest.approx(5.0 * hexagon + 10.0 * circle, rel=1e-5)
    steps = 2.0 * np.pi / 10 * np.array([0.4, 0.15, 0.3, 0.15])
    outline = np.array([6.5 * 6.5, 6.5 * 9.0, 9.0 * 9.0, 9.0 * 6.5]) - 3.0**2
    assert gear().volume == pytest.approx(5.0 * 10 * 0.5 * np.sum(outline * np.sin(steps)), rel=1e-5)
    mesh = gyroid()
    assert 2.0 * mesh.volume / mesh.area == pytest.approx(3.0, rel=0.25)  # rims and saddles are thinner
    for mesh in (bolt(), gear(), gyroid()):
        assert flaws(mesh).solid


def test_shapes_kept_out_are_in_no_fit():
    kept_out = [name for name in SHAPES if not is_in_sample(name)]
    assert kept_out == ["gyroid, 3 mm", "bolt, 15 mm", "gear, 5 mm"]
    assert is_in_sample("dragon_100k, 100 mm")
    assert not is_in_sample("teapot, 100 mm")


def test_both_means_are_told(capsys):
    nothing = (0.0, 0.0, 0.0)

    def row(shape, light, rms):
        return TransportRow(
            SMALL[1], shape, "marble", light, TransportError((rms,) * 3, *[nothing] * 6), ALL, 1.0, 64, 9
        )

    rms = {"ball, 4 mm": (0.01, 0.02), "cube, 8 mm": (0.03, 0.05), "gear, 5 mm": (0.06, 0.08)}
    rows = [row(shape, *pair) for shape, both in rms.items() for pair in zip(LIGHTS, both, strict=True)]
    report_transport(BenchReport(None), rows)
    lines = [[cell.strip() for cell in line.split("|")] for line in capsys.readouterr().out.splitlines()]
    assert ["", "cube, 8 mm; marble", "yes", "3.0 / 5.0", "0.00 / 0.00", ""] in lines
    assert ["", "mean of 2 shapes in the fit", "yes", "2.0 / 3.5", "0.00 / 0.00", ""] in lines
    assert ["", "mean of 1 shapes kept out of it", "no", "6.0 / 8.0", "0.00 / 0.00", ""] in lines
    assert sum(line[1:2] == ["boundary_condition.anisotropy"] for line in lines) == 1


@pytest.mark.slow
def test_a_model_is_compared_with_photons_where_it_is_closed(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bench.bench_transport, "N_REGIONS", 12)
    monkeypatch.setitem(SHAPES, "ball, 4 mm", lambda: ball(4.0, subdivisions=2))
    plan = replace(NOTHING, methods=SMALL[1:], solids=(), media=("albedos",), photons=500)
    block = trimesh.creation.box()
    block.export(tmp_path / "brick.ply")
    bench.run_plan(plan, None, tmp_path / "brick.ply")
    assert "| brick, 100 mm; albedo 0.99 " in capsys.readouterr().out
    block.update_faces(np.arange(4))  # of twelve: no hole to close, but a sheet
    block.export(tmp_path / "crate.ply")
    bench.run_plan(replace(plan, solids=("ball, 4 mm",)), None, tmp_path / "crate.ply")
    told = capsys.readouterr().out
    assert "crate, 100 mm is not closed, so no photons walk in it." in told
    assert "| crate" not in told


def test_albedos_share_a_mean_free_path():
    np.testing.assert_allclose(material_of("albedos").sigma_t_prime, 1.0)
    np.testing.assert_allclose(ALBEDOS.alpha_prime, [0.9, 0.99, 0.999])
    assert material_of("marble").name == "Marble"


def test_below_the_noise_there_is_an_upper_limit():
    nothing = (0.0, 0.0, 0.0)
    error = TransportError((0.05, 0.001, 0.0), (0.004, 0.004, 0.004), *[nothing] * 5)
    row = TransportRow(SMALL[0], "ball", "marble", "front", error, ALL, 1.0, 64)
    assert [rms_text(row, channel) for channel in range(3)] == ["5.0", "< 0.4", "< 0.4"]


@pytest.mark.slow
def test_tables_and_file_are_written(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bench.bench_transport, "N_REGIONS", 12)
    monkeypatch.setitem(SHAPES, "ball, 4 mm", lambda: ball(4.0, subdivisions=2))
    plan = replace(NOTHING, methods=SMALL, solids=("ball, 4 mm",), media=("albedos", "skim milk"), photons=500)
    bench.run_plan(plan, tmp_path)
    with (tmp_path / "transport.csv").open(newline="") as file:
        found = list(csv.DictReader(file))
    assert len(found) == len(SMALL) * 2 * len(LIGHTS)
    assert {row["in_fit"] for row in found} == {"1"}
    assert_finite(found)
    text = (tmp_path / "bench.md").read_text()
    assert "| ball, 4 mm; albedo 0.99 " in text
    assert "| ball, 4 mm; skim milk " in text
    assert "diffusion 24 against 2 x its nodes" in text
    assert capsys.readouterr().out.count("Error against photons: ") == 2


def test_plans_have_all_methods():
    assert {scheme.method for scheme in METHODS} == {"layered", "ewald", "diffusion"}
    for plan in (bench.FULL, bench.QUICK):
        assert plan.methods == METHODS
        assert set(plan.solids) <= SHAPES.keys()
        for name in plan.media:
            material_of(name)
