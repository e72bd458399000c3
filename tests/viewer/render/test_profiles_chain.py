"""Whole pictures with every profile: close to equation (1) of the same profile, and cheap to switch."""

import numpy as np
import pytest

from milkglass.core.profiles.registry import PROFILES
from milkglass.viewer.error.report import error_report
from tests.support.rendering import MeshRenderer, scene_of
from tests.support.shapes import ball

pytestmark = pytest.mark.gl


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "skin.csv"
    radii = np.linspace(0.0, 8.0, 33)
    rows = "\n".join(
        f"{r},{0.05 * np.exp(-r / 1.2)},{0.05 * np.exp(-r / 0.8)},{0.05 * np.exp(-r / 0.6)}" for r in radii
    )
    path.write_text(f"radius_mm,R,G,B\n{rows}\n")
    return path


def chosen(name, table, *more, method="ewald"):
    return scene_of(
        "material.name=skin1", f"material.profile={name}", f"material.profile_table={table}", *more, method=method
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", PROFILES)
def test_ewald_is_close_to_the_profiles_own_integral(context, table, name):
    renderer = MeshRenderer(context, ball(subdivisions=4))
    scene = chosen(name, table, "transport.resolution=60")
    report = error_report(renderer, scene, points=60, photons=0)
    assert max(report.content["error"]["rms"]) < 0.015


@pytest.mark.slow
def test_profiles_differ_and_diffusion_has_none(context, table):
    renderer = MeshRenderer(context, ball(subdivisions=4))
    for method, kinds in (("layered", 6), ("ewald", 6)):
        found = [renderer.render(chosen(name, table, method=method)).exitance for name in PROFILES]
        assert all(np.isfinite(M).all() and (M >= 0.0).all() for M in found)
        assert len({M.tobytes() for M in found}) == kinds
    solved = []
    for name in [*PROFILES][:4]:
        scene = chosen(name, table, "transport.method=diffusion", "transport.resolution=32")
        solved.append(renderer.render(scene).exitance)
    assert all(np.array_equal(M, solved[0]) for M in solved[1:])


@pytest.mark.slow
def test_switching_costs_the_spectra_and_the_convolution(context, table):
    renderer = MeshRenderer(context, ball(subdivisions=4))
    fine = ["transport.layers=8", "transport.resolution=128"]
    renderer.render(chosen("dipole", table, *fine, method="layered"))
    for name in [*PROFILES][1:]:
        renderer.render(chosen(name, table, *fine, method="layered"))
        ran = set(renderer.timings)
        assert {"spectra", "convolution"} <= ran
        assert not {"samples", "weights", "deposit", "irradiance of light 1", "shadow of light 1", "model"} & ran
