"""Depth of a photographed object, and the closed surface made of it."""

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree
from scipy.stats import spearmanr

from milkglass.core.geometry.mesh import flaws
from milkglass.core.photograph.depth import (
    SMOOTHING,
    bilateral,
    estimate_height,
    harmonic,
    inflated,
    inscribed_radius,
)
from milkglass.core.photograph.light import ShadingFit, _normals, shading_residual
from milkglass.core.photograph.surface import find_outline, height_surface
from milkglass.viewer.files.photograph import load_photo
from milkglass.viewer.photograph.framing import frame_object
from milkglass.viewer.photograph.geometry import make_geometry


def disc(size: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[:size, :size] - 0.5 * (size - 1)
    r = np.hypot(x, y)
    return r < radius, r


def test_a_disc_is_inflated_to_a_hemisphere() -> None:
    inside, r = disc(141, 60.0)
    hemisphere = np.sqrt(np.maximum(60.0**2 - r**2, 0.0))
    error = inflated(inside) - hemisphere
    assert np.sqrt(np.square(error[inside]).mean()) < 0.025 * 60.0
    assert inflated(inside).max() == pytest.approx(inscribed_radius(inside))


def test_an_even_object_is_its_inflated_outline() -> None:
    inside, _ = disc(61, 25.0)
    base = inflated(inside)
    height = estimate_height(np.full(inside.shape, 0.4), inside, base, strength=0.5)
    np.testing.assert_allclose(height, 0.5 * base, atol=1e-6 * 25.0)


def test_what_is_dark_is_deep() -> None:
    inside, r = disc(101, 45.0)
    light = np.where(r < 12.0, 0.2, 0.5)
    base = inflated(inside)
    height = estimate_height(light, inside, base)
    middle, around = height[r < 4.0].mean(), height[(r > 15.0) & (r < 19.0)].mean()
    assert middle < around
    assert base[r < 4.0].mean() > base[(r > 15.0) & (r < 19.0)].mean()


@pytest.mark.parametrize("tilt", [(0.0, 0.9), (-0.7, 0.5)])
def test_in_light_from_a_side_bumps_are_bumps_though_dark_would_be_deep(tilt: tuple[float, float]) -> None:
    inside, r = disc(141, 60.0)
    base = inflated(inside)
    y, x = np.mgrid[:141, :141]
    bumps = np.sin(2.0 * np.pi * x / 14.0) * np.sin(2.0 * np.pi * y / 14.0) * np.where(r < 45.0, 1.0, 0.0)
    normal = _normals(base + bumps)
    gradient = np.array([*tilt, 0.3])
    paint = np.where(bumps > 0.5, 0.9, 1.0)  # what sticks out is worn
    lit = 1.0 + np.einsum("ijk,k->ij", normal - normal[inside].mean(axis=0), gradient)
    light = paint * np.maximum(lit, 0.0)
    shading = ShadingFit(float(light[inside].mean()), gradient, normal[inside][::50])
    more = shading_residual(light, base, inside, shading)
    fine = estimate_height(light, inside, base, residual=more, gradient=gradient)
    dark = estimate_height(light, inside, base)
    there = r < 42.0
    told, deep = (np.corrcoef((h - gaussian_filter(h, 5.0))[there], bumps[there])[0, 1] for h in (fine, dark))
    assert told > 0.6
    assert deep < 0.2
    assert not shading_residual(light, base, inside, shading)[~inside].any()


def test_the_bilateral_filter_keeps_edges_and_drops_noise() -> None:
    rng = np.random.default_rng(1)
    step = np.where(np.arange(80) < 40, 0.2, 0.7) * np.ones((60, 1))
    noisy = step + 0.02 * rng.standard_normal(step.shape)
    smooth = bilateral(noisy, np.ones_like(step), 4.0, 0.1)
    assert np.abs(smooth - step).mean() < 0.5 * np.abs(noisy - step).mean()
    assert np.abs((smooth[:, 41] - smooth[:, 38]).mean() - 0.5) < 0.05


def test_harmonic_continuation_of_a_plane_is_the_plane() -> None:
    y, x = np.mgrid[:50, :70].astype(np.float64)
    plane = 0.3 * x - 0.2 * y
    known = np.ones(plane.shape, bool)
    known[10:40, 15:60] = False
    assert np.abs(harmonic(np.where(known, plane, 0.0), known) - plane).max() < 0.02 * np.ptp(plane)


def test_surfaces_of_all_sorts_of_masks_are_solid() -> None:
    rng = np.random.default_rng(2)
    for _ in range(12):
        noise = gaussian_filter(rng.standard_normal(rng.integers(12, 60, 2)), rng.uniform(0.5, 4.0))
        outline = find_outline(noise > np.quantile(noise, rng.uniform(0.3, 0.9)))
        if not outline.inner.any():
            continue
        base = inflated(outline.inner)
        mesh = height_surface(outline, rng.uniform(0.2, 3.0) * base, base, 0.5)
        assert flaws(mesh).solid
        assert np.isfinite(mesh.normals).all()


def test_the_back_has_few_triangles_and_the_volume_it_would_have_with_all() -> None:
    inside, _ = disc(81, 36.0)
    outline = find_outline(inside)
    base = inflated(outline.inner)
    mesh = height_surface(outline, 0.7 * base, base, 1.0)
    assert flaws(mesh).solid
    before = mesh.vertices[mesh.faces][..., 2].mean(axis=1) > 0.0
    assert (~before).sum() < 0.4 * before.sum()
    volume = 1.7 * base.sum()  # of columns from front to back
    assert mesh.volume == pytest.approx(volume, rel=0.01)


def test_a_hollow_front_stays_before_its_back() -> None:
    inside, r = disc(41, 16.0)
    outline = find_outline(inside)
    mesh = height_surface(outline, np.where(inside, 0.02 * r**2, 0.0), inflated(outline.inner), 1.0)
    assert flaws(mesh).solid
    assert mesh.volume > 0.0


def test_a_real_head_has_depth_where_photogrammetry_found_it(data_dir: Path) -> None:
    folder = data_dir / "image"
    photo = load_photo(folder / "buddha_head.png", folder / "buddha_head_mask.png")
    geometry = make_geometry(photo, frame_object(photo, 100.0), 3.0, strength=1.0, smoothing=SMOOTHING)
    x, y, depth = np.genfromtxt(folder / "buddha_head_points.csv", delimiter=",", skip_header=1).T
    height = map_coordinates(geometry.depth_mm(photo.full_region), [y - 0.5, x - 0.5], order=1)
    assert spearmanr(height, -depth)[0] > 0.9
    # What is near a point, and what of it is nearer: the relief, which the outline knows nothing of.
    tree = cKDTree(np.stack([x, y], axis=1))
    around = tree.query_ball_point(tree.data, 50.0)
    fine, found = (np.array([z[i] - z[near].mean() for i, near in enumerate(around)]) for z in (height, -depth))
    assert spearmanr(fine, found)[0] > 0.6
