"""Photons that meet the shape again from outside: furnaces, a closed cavity, mirrors, and two bodies."""

import numpy as np
import pytest
import trimesh

from milkglass.core.material import fresnel
from milkglass.core.reference.photon_shapes import ClosedMesh, Shape, Slab, Sphere
from milkglass.core.reference.photons import BATCHES, MEETINGS, Tally, walk
from tests.support import solids
from tests.support.shapes import ball, cube
from tests.support.solids import block, mesh_of

UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
PHOTONS = 30_000


def by_part(*parts: trimesh.Trimesh) -> ClosedMesh:
    """Solid with a bin for each part."""
    return ClosedMesh(mesh_of(*parts), np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts]))


def bowl() -> trimesh.Trimesh:
    """Half of a shell of radii 2.4 and 3, turned about z."""
    angle = np.linspace(-0.5 * np.pi, 0.0, 10)
    arcs = [radius * np.stack([np.cos(angle), np.sin(angle)], axis=1) for radius in (3.0, 2.4)]
    profile = np.concatenate([arcs[0], arcs[1][::-1]])
    profile[[0, -1], 0] = 0.0
    return trimesh.creation.revolve(profile, sections=32)


def mean_and_error(batches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of flux (BATCHES, ...)."""
    return batches.mean(axis=0), batches.std(axis=0, ddof=1) / np.sqrt(BATCHES)


def left(tally: Tally) -> np.ndarray:
    """All that leaves, of the first albedo: (BATCHES, n_bins)."""
    return np.asarray(tally.whole[..., 0] + tally.ballistic)


@pytest.mark.parametrize("shape", [Slab(3.0), Sphere(3.0), ClosedMesh(ball(6.0, subdivisions=3)), ClosedMesh(cube())])
def test_a_convex_shape_never_meets_its_light_again(shape: Shape) -> None:
    tally = walk(shape, 1.0, [0.99], 1.4, DOWN, 10_000, between_parts=True)
    assert tally.scattered_again.shape == (MEETINGS, BATCHES, len(shape.areas), 1)
    assert not tally.scattered_again.any()
    assert not tally.entered_again.any()


def test_light_that_is_not_asked_for_is_not_there() -> None:
    tally = walk(by_part(bowl()), 2.0, [0.9], 1.3, UP, 1_000)
    assert len(tally.scattered_again) == len(tally.entered_again) == 0
    np.testing.assert_array_equal(tally.whole, tally.scattered)


def test_first_light_is_that_of_a_walk_without_further_meetings() -> None:
    first, whole = (
        walk(by_part(bowl()), 2.0, [0.9, 0.99], 1.3, UP, PHOTONS, seed, between_parts=bool(seed)) for seed in (0, 1)
    )
    error = np.hypot(first.standard_error, whole.standard_error)
    assert (np.abs(first.exitance - whole.exitance) < 4.0 * error).all()
    assert whole.scattered_again.sum() > 0.1 * whole.scattered.sum()


@pytest.mark.parametrize("eta", [1.0, 1.5])
@pytest.mark.parametrize("shape", [bowl, lambda: trimesh.creation.torus(2.0, 1.2, 48, 24)])
def test_as_much_enters_and_leaves_everywhere_in_white_surroundings(shape, eta) -> None:
    """A white furnace: radiance is 1 / pi in all directions at all places, so F_t of it passes each way."""
    part = shape()
    height = part.triangles_center[:, 2]
    inner = np.einsum("ij,ij->i", part.face_normals, part.triangles_center) < 0.0
    bins = 2 * (height > np.median(height)) + inner
    solid = ClosedMesh(mesh_of(part), np.unique(bins, return_inverse=True)[1])
    tally = walk(solid, 2.0, [1.0], eta, None, PHOTONS, between_parts=True)
    wanted = solid.areas * fresnel.hemispherical_transmittance(eta)
    leaving, error = mean_and_error(left(tally))
    assert np.abs((leaving - wanted) / error).max() < 4.5
    assert (error < 0.03 * wanted).all()
    again, error = mean_and_error(tally.entered_again.sum(axis=0)[..., 0])
    assert (np.abs(tally.entered + again - wanted) < 4.5 * error + 0.01 * wanted).all()
    assert (tally.entered < 0.95 * wanted).any()


def cavity(eta: float, photons: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flux out of and into the wall of a closed cavity, (meetings, batches) each, and ballistic (batches,)."""
    shell = by_part(solids.ball(2.5, subdivisions=4), solids.ball(1.5, subdivisions=4, inverted=True))
    tally = walk(shell, 5.0, [1.0], eta, None, photons, between_parts=True)
    out = np.concatenate([tally.scattered[None], tally.scattered_again])[:, :, 1, 0]
    return out, tally.entered_again[:, :, 1, 0], tally.ballistic[:, 1]


@pytest.mark.slow
def test_a_closed_cavity_takes_back_all_that_it_lets_out() -> None:
    """At once what cosine-distributed light transmits, the rest after one, two, ... mirrors: (F_t, F_r F_t, ...)."""
    eta = 1.33
    out, back, ballistic = cavity(eta, 100_000)
    assert back.sum(axis=0).mean() == pytest.approx(out.sum(axis=0).mean() + ballistic.mean(), rel=0.01)
    mu = (np.arange(20_000) + 0.5) / 20_000
    through, mirrored = fresnel.transmittance(eta, mu), fresnel.reflectance(eta, mu)
    shares = [np.sum(mu * through * mirrored**k * through) / np.sum(mu * through) for k in range(2)]
    assert np.cumsum(shares) == pytest.approx([0.94457, 0.99124], abs=1e-5)
    assert back[0].mean() == pytest.approx(shares[0] * out[0].mean() + ballistic.mean(), rel=0.01)
    residual, error = mean_and_error(back[1] - shares[0] * out[1] - shares[1] * out[0])
    assert abs(residual) < 4.5 * error
    assert error < 0.01 * back[1].mean()


@pytest.mark.slow
def test_bounces_in_a_cavity_are_a_geometric_series() -> None:
    """Without an interface, in white surroundings: M_0 (1 + R + R^2 + ...) is 1 on the wall."""
    out, _, ballistic = cavity(1.0, 300_000)
    area = solids.ball(1.5, subdivisions=4).area
    flux = out.mean(axis=1)
    assert flux.sum() + ballistic.mean() == pytest.approx(area, rel=0.02)
    ratio = 1.0 - (flux[0] + ballistic.mean()) / area
    first = (flux[0] + ballistic.mean()) * ratio
    wanted = first * np.array([1.0, ratio, ratio**2, ratio**3 / (1.0 - ratio)])
    assert flux[1:] == pytest.approx(wanted, rel=0.05)


def test_a_mirrored_lamp_lights_the_wall_beside_the_floor() -> None:
    """At 45 degrees: F_r of the floor's light meets the wall and F_t of that enters, as far up as the floor is long."""
    eta, width, length, height = 1.5, 2.0, 3.0, 2.5
    floor = block((length, width, 1.0), (0.5 * length, 0.0, -0.5))
    wall = block((1.0, width, height), (-0.501, 0.0, 0.5 * height))
    tally = walk(by_part(floor, wall), 60.0, [0.0], eta, (1.0, 0.0, 1.0), 400_000, between_parts=True)
    cosine = np.sqrt(0.5)
    mirrored, entering = (float(f(eta, cosine)) for f in (fresnel.reflectance, fresnel.transmittance))
    wanted = cosine * width * min(length, height) * mirrored * entering
    found, error = mean_and_error(tally.entered_again[0, :, :, 0])
    assert found == pytest.approx(wanted, abs=4.5 * error.max())
    assert error.max() < 0.02 * wanted
    lit = np.array([length, height]) + 1.0  # and the far end of the floor, the top of the wall
    assert tally.entered == pytest.approx(cosine * width * entering * lit, rel=0.01)


def view_factor(side: float, gap: float) -> float:
    """Share of diffuse light from one of two facing squares that reaches the other."""
    x = side / gap
    root = np.sqrt(1.0 + x * x)
    logarithm = 0.5 * np.log((1.0 + x * x) ** 2 / (1.0 + 2.0 * x * x))
    return float(2.0 / (np.pi * x * x) * (logarithm + 2.0 * x * root * np.arctan(x / root) - 2.0 * x * np.arctan(x)))


def test_a_lit_body_lights_the_one_in_its_shadow() -> None:
    side, gap, eta = 6.0, 0.1, 1.3
    mesh = mesh_of(*(block((side, side, 2.0), (0.0, 0.0, z)) for z in (0.5 * gap + 1.0, -0.5 * gap - 1.0)))
    place, normal = mesh.vertices[mesh.faces].mean(axis=1), mesh.normals[mesh.faces[:, 0]]
    lower = place[:, 2] < 0.0
    facing = np.where(lower, normal[:, 2] > 0.5, normal[:, 2] < -0.5)
    solid = ClosedMesh(mesh, 2 * lower + facing)
    tally = walk(solid, 4.0, [0.999], eta, UP, 3 * PHOTONS, between_parts=True)
    dark = slice(2, 4)
    assert not tally.entered[dark].any()
    assert not tally.scattered[:, dark].any()
    mu = (np.arange(20_000) + 0.5) / 20_000
    entering = fresnel.transmittance(eta, mu)
    share = view_factor(side, gap) * np.sum(mu * entering**2) / np.sum(mu * entering)
    exchanged, error = mean_and_error(tally.entered_again[0, :, 3, 0])
    assert exchanged == pytest.approx(share * tally.scattered[:, 1, 0].mean(), rel=0.04)
    assert error < 0.02 * exchanged
    assert tally.scattered_again[0, :, dark].sum() > 0.0


@pytest.mark.parametrize("direction", [(0.3, 0.2, 1.0), None])
def test_without_absorption_all_that_enters_leaves(direction) -> None:
    tally = walk(by_part(bowl()), 2.0, [1.0], 1.4, direction, PHOTONS, between_parts=True)
    balance = left(tally).sum(axis=1) - tally.entered_again.sum(axis=(0, 2, 3))
    mean, error = mean_and_error(balance)
    assert mean == pytest.approx(tally.entered.sum(), abs=4.0 * error)
    assert error < 0.02 * mean
    assert tally.lost < 1e-3


def test_albedos_of_a_walk_are_those_of_walks_of_their_own() -> None:
    together = walk(by_part(bowl()), 2.0, [0.8, 0.97], 1.3, UP, PHOTONS, between_parts=True)
    alone = walk(by_part(bowl()), 2.0, [0.8], 1.3, UP, PHOTONS, seed=1, between_parts=True)
    for name in ("scattered_again", "entered_again"):
        (one, error), (other, other_error) = (
            mean_and_error(getattr(tally, name).sum(axis=(0, 2))[:, 0]) for tally in (together, alone)
        )
        assert one == pytest.approx(other, abs=4.0 * np.hypot(error, other_error))
