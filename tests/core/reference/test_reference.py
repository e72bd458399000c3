"""The reference itself: closed forms where there are any."""

import numpy as np
import pytest

from milkglass.core.geometry.samples import surface_samples
from milkglass.core.material import fresnel, library as materials
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.reference.equation import Occluder, direct_exitance
from tests.support.shapes import ball, cube, plate


def test_exitance_in_the_middle_of_a_wide_uniform_plane_is_the_reflectance() -> None:
    profile = dipoles(materials.lookup("ketchup"))[0]
    x = (np.arange(400) - 199.5) * 0.25
    sources = np.stack([*np.meshgrid(x, x), np.zeros((400, 400))], axis=-1).reshape(-1, 3)
    flux = np.full((len(sources), 3), 0.25**2)
    finished: list[float] = []
    exitance = direct_exitance([[0.1, 0.05, 0.0]], sources, flux, (profile,) * 3, finished.append)
    np.testing.assert_allclose(exitance, float(profile.total(0.0)), rtol=2e-3)
    assert finished[-1] == 1.0


def test_visibility_on_a_ball_is_the_sign_of_the_cosine() -> None:
    mesh = ball(subdivisions=4)
    samples = surface_samples(mesh, 10.0)
    towards = np.array([0.3, 0.4, 1.0])
    cosine = samples.normals @ (towards / np.linalg.norm(towards))
    clear = np.abs(cosine) > 0.03  # facets are flat: the terminator is theirs
    seen = Occluder(mesh).visible(samples.points, samples.normals, towards)
    np.testing.assert_array_equal(seen[clear], cosine[clear] > 0)


def test_irradiance_of_a_lit_face() -> None:
    mesh = cube()
    samples = surface_samples(mesh, 5.0)
    e = Occluder(mesh).irradiance(samples.points, samples.normals, samples.normals, (0, 0, 9), (1, 2, 3), 1.5)
    front = samples.normals[:, 2] > 0.5
    np.testing.assert_allclose(e[front], np.broadcast_to([0.96, 1.92, 2.88], e[front].shape), rtol=1e-6)
    assert not e[~front].any()
    assert fresnel.transmittance(1.5, 1.0) == pytest.approx(0.96)


def test_plate_area_is_that_of_the_box() -> None:
    assert plate().area == pytest.approx(2 * 400 + 4 * 20, rel=1e-6)
