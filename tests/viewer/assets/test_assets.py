from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.light.maps import PROJECTIONS
from milkglass.core.light.presets import preset
from milkglass.core.light.probe import Probe
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import BodiesOf, DetailOf, RowSumsOf, SamplesOf, model_source, probe_source
from milkglass.viewer.files.images import write_exr
from milkglass.viewer.scene.settings import PROBE_PROJECTIONS, DetailSettings, EnvironmentSettings, ModelSettings
from tests.support.driving import write_knot


def test_meshes_are_kept_and_the_oldest_goes(tmp_path):
    models = [ModelSettings(path=write_knot(tmp_path / f"{i}.ply")) for i in range(3)]
    assets = Assets(keep=2)
    first, _ = assets.mesh(models[0])
    assert assets.mesh(models[0])[0] is first
    assets.mesh(models[1])
    models[0].path.unlink()
    assert assets.mesh(models[0])[0] is first  # deleted, yet still here
    assets.mesh(models[2])
    assert assets.has(model_source(models[0]))
    assert not assets.has(model_source(models[1]))
    assets.forget(models[0].path)
    with pytest.raises(InputError):
        assets.mesh(models[0])


def test_finer_samples_may_stand_in_only_when_asked_for(tmp_path):
    assets = Assets(keep=3)
    mesh, _ = assets.mesh(ModelSettings(path=write_knot(tmp_path / "a.ply")))
    fine = assets.samples(mesh, 2.0)
    assert assets.samples(mesh, 5.0, accept_finer=True) is fine
    assert not assets.has(SamplesOf(mesh, 5.0))
    coarse = assets.samples(mesh, 5.0)
    assert len(coarse) < len(fine)
    assert assets.samples(mesh, 4.0, accept_finer=True) is fine
    assert assets.samples(mesh, 1.0, accept_finer=True) is not fine  # none is fine enough


def test_an_asset_is_kept_under_its_source_until_its_file_is_forgotten(tmp_path):
    assets, path = Assets(), write_knot(tmp_path / "a.ply")
    detail = DetailOf.asked(ModelSettings(path=path), DetailSettings())
    assert not assets.has(detail)
    assert assets.get(detail) is assets.get(
        DetailOf.asked(ModelSettings(path=path, bodies="separate"), DetailSettings())
    )
    mesh = assets.get(detail.model).mesh
    bodies = assets.get(BodiesOf(mesh))
    assets.forget(path)
    assert not assets.has(detail)
    assert not assets.has(detail.model)
    assert assets.get(BodiesOf(mesh)) is bodies


def test_a_mesh_and_a_probe_in_memory_take_the_place_of_files(tmp_path):
    assets = Assets()
    knot, _ = assets.mesh(ModelSettings(path=write_knot(tmp_path / "a.ply")))
    probe = Probe.from_pixels(preset("studio"))
    settings, environment = ModelSettings(mesh=knot), EnvironmentSettings(probe=probe, extract=False)
    assert assets.get(model_source(settings)).mesh is knot
    assert settings.builtin_name is None
    assert assets.surround(environment) == ((), probe)
    assert environment.given
    assert model_source(ModelSettings(mesh=replace(knot))) != model_source(settings)
    assets.keep_probes()
    assert assets.has(probe_source(environment))
    assert not assets.has(model_source(settings))


def test_nobody_measures_a_mesh_that_is_closed_by_construction(tmp_path):
    assets = Assets(keep=2)
    knot, _ = assets.mesh(ModelSettings(path=write_knot(tmp_path / "a.ply")))
    measured, known = (assets.get(RowSumsOf(mesh, separate=False)) for mesh in (knot, replace(knot, closed=True)))
    assert len(measured) > len(known)
    np.testing.assert_array_equal(known, [-0.5])


def test_a_probe_of_a_file_follows_its_projection_and_keeps_what_was_said(tmp_path):
    assert ("auto", *PROJECTIONS) == PROBE_PROJECTIONS
    path = tmp_path / "square.exr"
    y, x = np.mgrid[:32, :32] / 16.0 - 1.0
    write_exr(path, dict.fromkeys("RGB", (np.hypot(x, y) < 1.0).astype(np.float32) * (2.0 + x).astype(np.float32)))
    found = {
        name: Assets().get(probe_source(EnvironmentSettings(path=path, projection=name)))
        for name in ("auto", "angular", "mirrorball")
    }
    np.testing.assert_array_equal(found["auto"].latlong, found["angular"].latlong)
    assert np.abs(found["mirrorball"].latlong - found["angular"].latlong).max() > 0.5
    assert found["auto"].said == ()  # of every usual probe there would be a sentence
    assert found["angular"].said == ()
    with pytest.raises(InputError, match=r"square\.exr.*32x32.*strip"):
        Assets().get(probe_source(EnvironmentSettings(path=path, projection="strip")))
