"""Profiles as curves: where they are sampled, as tables, in a worker, and on axes."""

import threading

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.material import library as materials
from milkglass.core.material.library import Material
from milkglass.core.profiles.choose import profiles
from milkglass.core.profiles.curves import curve_radii, reach, table_text
from milkglass.core.profiles.registry import PROFILES
from milkglass.core.profiles.table import parse_table
from milkglass.viewer.scene.settings import MaterialSettings
from milkglass.viewer.window.curves.axes import Axes, axes_for, dashes, plotted, round_down, round_up
from milkglass.viewer.window.curves.curves import CurvesJob, Wish, curves_of
from milkglass.viewer.window.curves.marks import Mark
from tests.support.waiting import DEADLINE

TABLE = "0,0.1,0.08,0\n1,0.05,0.04,0\n2,0.01,0.01,0\n3,0,0,0\n"
NAMES = [*PROFILES][:-1]


def unread(path):
    raise AssertionError(f"{path} is not asked for")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("material", ["marble", "skin1", "ketchup"])
def test_a_table_of_the_curves_is_the_same_profile(name, material):
    own = profiles(materials.lookup(material), name)
    read = parse_table(table_text(own, "a\nremark"), "curves.csv")
    for ours, back in zip(own, read, strict=True):
        assert float(back.total(0.0)) == pytest.approx(float(ours.total(0.0)), rel=3e-4)
        # between the radii of the table, as far as all but a millionth of the light reaches
        radii = curve_radii(own)
        between = np.sqrt(radii[1:] * radii[:-1])
        between = between[ours.total(between) > 1e-6 * ours.total(0.0)]
        np.testing.assert_allclose(back.radial(between), ours.radial(between), rtol=1e-4)


def test_a_table_of_a_table_and_of_black_channels():
    own = parse_table(TABLE, "own.csv")
    back = parse_table(table_text(own), "back.csv")
    assert back[2].is_black
    for ours, again in zip(own[:2], back[:2], strict=True):
        assert again == ours
    black = profiles(Material("", (0.0,) * 3, (1.0,) * 3))
    assert all(one.is_black for one in parse_table(table_text(black), "black.csv"))


def test_what_returns_more_than_it_gets_is_no_table():
    text = table_text(profiles(materials.lookup("spectralon"), "photon_beam"))
    with pytest.raises(InputError, match=r"R returns 1\.0\d times"):
        parse_table(text, "spectralon.csv")


@pytest.mark.parametrize("name", NAMES)
def test_curves_are_the_profile(name):
    material = MaterialSettings(name="skin1", profile=name)
    curves = curves_of(material, unread)
    own = profiles(material.resolve(), name)
    np.testing.assert_array_equal(curves.values, [p.radial(curves.radii) for p in own])
    np.testing.assert_array_equal(curves.totals, [float(p.total(0.0)) for p in own])
    rest = [float(p.total(curves.reach) / p.total(0.0)) for p in own]
    assert max(rest) == pytest.approx(0.01, rel=1e-6)
    assert curves.reach == reach(own, 0.01)
    assert np.all(np.diff(curves.radii) > 0.0)
    np.testing.assert_array_equal(plotted(curves, per_radius=False), curves.values)
    # the area below 2 pi r R_d is the reflectance
    areas = np.trapezoid(plotted(curves, per_radius=True), curves.radii, axis=1)
    np.testing.assert_allclose(areas, curves.totals, rtol=2e-3)


def test_a_black_channel_is_zero_and_a_colour_out_of_reach_is_told():
    material = MaterialSettings(sigma_s_prime=(1.0, 0.0, 1.0), sigma_a=(0.1, 1.0, 0.1))
    curves = curves_of(material, unread)
    assert not curves.values[1].any()
    assert curves.totals[1] == 0.0
    bad = MaterialSettings(name="skin1", profile="table", profile_table="/nowhere/none.csv")
    curves = curves_of(bad, lambda path: (_ for _ in ()).throw(InputError(f"{path} is not there")))
    assert "none.csv is not there" in curves.problem
    assert curves.profiles == ()


def test_the_worker_makes_each_once_and_the_newest_last():
    woken = threading.Event()
    job = CurvesJob(woken.set)
    first, second = (Wish(MaterialSettings(name=name)) for name in ("marble", "jade"))
    try:
        assert job.follow((first, second), unread) == [None, None]
        assert job.busy
        job.wait(DEADLINE)
        assert woken.wait(DEADLINE)
        made = job.follow((first, second), unread)
        assert [one.totals.tolist() for one in made] == [
            [float(p.total(0.0)) for p in profiles(wish.material.resolve())] for wish in (first, second)
        ]
        assert not job.busy
        assert job.follow((second, first), unread) == made[::-1]  # the very same
        assert job.follow((Wish(first.material, (1, 0)),), unread) == [None]  # a table that was read anew
    finally:
        job.close()


def test_axes_span_what_is_shown():
    curves = curves_of(MaterialSettings(name="jade"), unread)
    marks = [Mark("node", 0.05), Mark("object", 100.0)]
    axes = axes_for([curves], marks, log_radius=True, per_radius=False)
    assert axes.x == (0.01, 200.0)
    assert axes.y[0] < curves.values[:, 0].max() < axes.y[1] <= 10.0 * curves.values[:, 0].max()
    linear = axes_for([curves], marks, log_radius=False, per_radius=True)
    assert linear.x[0] == linear.y[0] == 0.0
    assert curves.reach <= linear.x[1] <= 2.5 * curves.reach
    assert plotted(curves, per_radius=True).max() < linear.y[1]
    # black, or nothing at all, has axes too
    for shown in ([], [curves_of(MaterialSettings(sigma_s_prime=(0,) * 3, sigma_a=(1,) * 3), unread)]):
        for log_radius in (True, False):
            found = axes_for(shown, marks, log_radius=log_radius, per_radius=not log_radius)
            assert np.isfinite([*found.x, *found.y]).all()
            assert found.x[0] < found.x[1]
            assert found.y[0] < found.y[1]


def test_round_ends():
    for value in np.geomspace(1e-7, 1e7, 200):
        assert round_down(value) <= 1.00001 * value < 2.6 * round_down(value)
        assert 0.99999 * value <= round_up(value) < 2.6 * value
    assert (round_up(100.0), round_down(0.2), round_up(0.11)) == (100.0, 0.2, 0.2)


def test_dashes_lie_on_the_curve_and_are_even():
    axes = Axes((0.01, 100.0), (1e-6, 1.0), True, True)
    x = np.geomspace(0.01, 100.0, 500)
    y = np.exp(-x / 8.0)
    along, up = dashes(x, y, axes, (600.0, 200.0))
    np.testing.assert_allclose(np.log(up), -along / 8.0, atol=0.02)
    across, height = axes.share(along, up)
    lengths = np.hypot(np.diff(across)[::2] * 600.0, np.diff(height)[::2] * 200.0)
    np.testing.assert_allclose(lengths[:-1], 7.0, rtol=0.02)
