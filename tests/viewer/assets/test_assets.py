import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.scene.settings import ModelSettings
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
    assert assets.has_mesh(models[0])
    assert not assets.has_mesh(models[1])
    assets.forget(models[0].path)
    with pytest.raises(InputError):
        assets.mesh(models[0])


def test_finer_samples_may_stand_in_only_when_asked_for(tmp_path):
    assets = Assets(keep=3)
    mesh, _ = assets.mesh(ModelSettings(path=write_knot(tmp_path / "a.ply")))
    fine = assets.samples(mesh, 2.0)
    assert assets.samples(mesh, 5.0, accept_finer=True) is fine
    assert not assets.has_samples(mesh, 5.0)
    coarse = assets.samples(mesh, 5.0)
    assert len(coarse) < len(fine)
    assert assets.samples(mesh, 4.0, accept_finer=True) is fine
    assert assets.samples(mesh, 1.0, accept_finer=True) is not fine  # none is fine enough
