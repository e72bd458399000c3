"""Photons: closed forms, laws of conservation, and the published numbers of another walk."""

import csv

import numpy as np
import pytest
import trimesh

from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.material import fresnel
from milkglass.core.reference.photon_shapes import ClosedMesh, Slab, Sphere, isotropic
from milkglass.core.reference.photons import BATCHES, Tally, walk
from tests.support.shapes import ball, cube, plate, torus_knot
from tests.support.solids import block, mesh_of, sheet

ALBEDOS = (0.8, 0.9, 0.97, 0.99, 0.999)
OTHERS = 6e5  # photons of the tables, at least
DOWN, UP = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)


def deviations(found: np.ndarray, error: np.ndarray, wanted: np.ndarray, photons: float) -> np.ndarray:
    """In standard errors, those of the table included."""
    return (found - wanted) / (error * np.sqrt(1.0 + photons / OTHERS) + 1e-5)  # tables have five digits


def agrees(z: np.ndarray) -> bool:
    return bool(np.abs(z).max() < 4.5)


def rows(path, **wanted):
    with path.open(encoding="utf-8") as file:
        return [row for row in csv.DictReader(file) if all(row[key] == value for key, value in wanted.items())]


def table(data_dir, name: str):
    path = data_dir / "transport" / name
    if not path.is_file():
        pytest.skip(f"{name} is absent")
    return path


def slab_z(path, eta: str, thickness: str, entry: str, photons: int) -> np.ndarray:
    tally = walk(Slab(float(thickness)), 1.0, ALBEDOS, float(eta), DOWN if entry == "normal" else None, photons)
    wanted = rows(path, eta=eta, thickness_mfp=thickness, entry=entry)
    assert [float(row["albedo"]) for row in wanted] == list(ALBEDOS)
    entered = tally.entered.sum()
    sides = np.array([[float(row[side]) for row in wanted] for side in "RT"])
    z = deviations(tally.exitance / entered, tally.standard_error / entered, sides, photons)
    ballistic = tally.ballistic.sum(axis=1) / entered
    through = float(wanted[0]["ballistic"])
    z_ballistic = deviations(ballistic.mean(), ballistic.std(ddof=1) / np.sqrt(BATCHES), through, photons)
    return np.append(z, z_ballistic)


def sphere_z(path, eta: str, radius: str, photons: int) -> np.ndarray:
    tally = walk(Sphere(float(radius)), 1.0, ALBEDOS, float(eta), UP, photons)
    wanted = np.array([float(row["M"]) for row in rows(path, eta=eta, radius_mfp=radius)]).reshape(len(ALBEDOS), -1)
    return deviations(tally.exitance, tally.standard_error, wanted.T, photons).ravel()


@pytest.mark.parametrize("entry", ["normal", "diffuse"])
@pytest.mark.parametrize(("eta", "thickness"), [("1.3", "1"), ("1.5", "4"), ("1.3", "16")])
def test_slab_returns_and_lets_through_what_the_table_says(data_dir, eta, thickness, entry) -> None:
    assert agrees(slab_z(table(data_dir, "slab.csv"), eta, thickness, entry, photons=50_000))


@pytest.mark.parametrize(("eta", "radius"), [("1.3", "8"), ("1.5", "2")])
def test_sphere_glows_as_the_table_says(data_dir, eta, radius) -> None:
    assert agrees(sphere_z(table(data_dir, "sphere.csv"), eta, radius, photons=100_000))


@pytest.mark.slow
def test_whole_tables(data_dir) -> None:
    slabs, spheres = table(data_dir, "slab.csv"), table(data_dir, "sphere.csv")
    cases = sorted({(row["eta"], row["thickness_mfp"], row["entry"]) for row in rows(slabs)})
    z = [slab_z(slabs, *case, photons=40_000) for case in cases]
    cases = sorted({(row["eta"], row["radius_mfp"]) for row in rows(spheres)})
    z += [sphere_z(spheres, *case, photons=80_000) for case in cases]
    together = np.concatenate(z)
    assert agrees(together)
    assert np.mean(together**2) < 1.5  # albedos of a walk err together


@pytest.mark.parametrize("direction", [DOWN, (0.6, 0.0, -0.8), None])
def test_without_absorption_all_that_enters_leaves(direction) -> None:
    tally = walk(Slab(3.0), 1.0, [1.0], 1.4, direction, 30_000)
    left = (tally.scattered[..., 0] + tally.ballistic).sum(axis=1)
    assert tally.lost == 0.0
    assert left.mean() == pytest.approx(tally.entered.sum(), abs=4.0 * left.std(ddof=1) / np.sqrt(BATCHES))
    if direction is not None:  # and what does not enter is reflected
        cosine = -direction[2]
        assert tally.entered.sum() == pytest.approx(cosine * fresnel.transmittance(1.4, cosine), rel=1e-9)
    else:
        assert tally.entered.sum() == pytest.approx(fresnel.hemispherical_transmittance(1.4), rel=5e-3)


@pytest.mark.parametrize("direction", [DOWN, (0.6, 0.0, -0.8)])
def test_without_scattering_light_leaves_in_a_beam(direction) -> None:
    """Snell's and Beer's laws, and the geometric series of reflections between two planes."""
    tally = walk(Slab(1.0), 1.0, [0.0], 1.5, direction, 100_000)
    assert not tally.scattered.any()
    cosine = -direction[2]
    passed = np.exp(-1.0 / np.sqrt(1.0 - (1.0 - cosine**2) / 1.5**2))
    reflected = fresnel.reflectance(1.5, cosine)
    wanted = cosine * (1.0 - reflected) ** 2 * passed / (1.0 - (reflected * passed) ** 2)
    assert tally.ballistic.mean(axis=0)[1] == pytest.approx(wanted, rel=0.02)
    assert tally.ballistic.mean(axis=0)[0] == pytest.approx(wanted * reflected * passed, rel=0.1)


def plane_albedo(albedo: float, mu: float = 1.0) -> float:
    """Of a half space without an interface, scattering every way alike: 1 - H(mu) sqrt(1 - a') (Chandrasekhar 1960)."""
    x, w = np.polynomial.legendre.leggauss(64)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    h = np.ones_like(x)
    root = np.sqrt(1.0 - albedo)
    for _ in range(200):
        h = 1.0 / (root + 0.5 * albedo * (w * x * h / (x[:, None] + x)).sum(axis=1))
    return float(1.0 - root / (root + 0.5 * albedo * np.sum(w * x * h / (mu + x))))


def test_half_space_at_index_one_is_chandrasekhars() -> None:
    albedos = [0.5, 0.9, 0.99]
    tally = walk(Slab(40.0), 1.0, albedos, 1.0, DOWN, 50_000)
    assert tally.entered.sum() == pytest.approx(1.0)
    wanted = np.array([plane_albedo(albedo) for albedo in albedos])
    assert agrees((tally.exitance[0] - wanted) / tally.standard_error[0])


def test_several_albedos_of_a_walk_are_those_of_walks_of_their_own() -> None:
    together = walk(Slab(4.0), 1.0, [0.9, 0.97], 1.3, DOWN, 50_000)
    alone = walk(Slab(4.0), 1.0, [0.9], 1.3, DOWN, 50_000, seed=1)
    error = np.hypot(together.standard_error[:, 0], alone.standard_error[:, 0])
    assert (np.abs(together.exitance[:, 0] - alone.exitance[:, 0]) < 4.0 * error).all()


def test_object_and_mean_free_path_scale_together() -> None:
    small, large = (walk(Sphere(4.0 * s), 1.0 / s, [0.95], 1.3, UP, 5_000) for s in (1.0, 8.0))
    np.testing.assert_allclose(small.exitance, large.exitance, rtol=1e-9)


def test_same_seed_same_bits() -> None:
    def exitance(seed: int) -> np.ndarray:
        return walk(Sphere(2.0), 1.0, [0.9], 1.3, UP, 2_000, seed).exitance

    np.testing.assert_array_equal(exitance(3), exitance(3))
    assert (exitance(3) != exitance(4)).any()


def zones(mesh: Mesh, n: int = 16) -> np.ndarray:
    """Bin each face of a ball as `Sphere` does."""
    centre = mesh.vertices[mesh.faces].astype(np.float64).mean(axis=1)
    mu = centre[:, 2] / np.linalg.norm(centre, axis=1)
    return np.minimum((0.5 * n * (1.0 - mu)).astype(int), n - 1)


def z_of(one: Tally, other: Tally) -> np.ndarray:
    return (one.exitance - other.exitance) / np.hypot(one.standard_error, other.standard_error)


@pytest.mark.parametrize("direction", [UP, None])
def test_ball_of_triangles_glows_like_the_sphere(direction) -> None:
    mesh = ball(10.0, subdivisions=5)
    of_mesh = walk(ClosedMesh(mesh, zones(mesh)), 1.0, [0.9, 0.99], 1.3, direction, 40_000)
    of_sphere = walk(Sphere(5.0), 1.0, [0.9, 0.99], 1.3, direction, 40_000, seed=1)
    assert of_mesh.lost < 1e-3
    assert of_mesh.entered.sum() == pytest.approx(of_sphere.entered.sum(), rel=0.01)
    assert agrees(z_of(of_mesh, of_sphere))


def test_wide_plate_is_a_slab() -> None:
    """The rim of 40 mean free paths of 400 a side takes light from a tenth of the plate: the middle is a slab."""
    mesh = plate(400.0, 2.0, 10)
    centre = mesh.vertices[mesh.faces].mean(axis=1)
    middle = (np.abs(centre[:, :2]) < 160.0).all(axis=1)
    bins = np.where(middle, np.where(centre[:, 2] < 0.0, 0, 1), 2)
    of_mesh = walk(ClosedMesh(mesh, bins), 1.0, [0.99], 1.5, DOWN, 60_000)
    of_slab = walk(Slab(2.0), 1.0, [0.99], 1.5, DOWN, 60_000, seed=1)
    assert of_mesh.lost < 1e-3
    error = np.hypot(of_mesh.standard_error[:2], of_slab.standard_error)
    assert (np.abs(of_mesh.exitance[:2] - of_slab.exitance) < 4.0 * error).all()


@pytest.mark.parametrize("shape", [cube, torus_knot])
def test_nothing_is_lost_in_meshes(shape) -> None:
    """Sharp edges, thin and long; without absorption all that enters must leave."""
    tally = walk(ClosedMesh(shape()), 2.0, [1.0], 1.5, (0.3, 0.4, 1.0), 20_000)
    left = (tally.scattered[..., 0] + tally.ballistic).sum(axis=1)
    assert tally.lost < 1e-3
    assert left.mean() == pytest.approx(tally.entered.sum(), abs=4.0 * left.std(ddof=1) / np.sqrt(BATCHES))


def test_what_lies_in_shadow_gets_no_light() -> None:
    """A block before another: the light that enters is that of the front, and all the hidden one sends out is none."""
    mesh = mesh_of(block((4.0, 4.0, 1.0), (0.0, 0.0, 3.0)), block((2.0, 2.0, 1.0), (0.0, 0.0, -3.0)))
    behind = mesh.vertices[mesh.faces].mean(axis=1)[:, 2] < 0.0
    tally = walk(ClosedMesh(mesh, behind.astype(int)), 1.0, [0.9], 1.3, UP, 10_000)
    assert tally.entered[0] == pytest.approx(16.0 * fresnel.transmittance(1.3, 1.0), rel=0.05)
    assert tally.entered[1] == 0.0
    assert not tally.scattered[:, 1].any()


def test_directions_are_spread_evenly() -> None:
    directions = isotropic(np.random.default_rng(0), 200_000)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=0), 1.0, rtol=1e-12)
    np.testing.assert_allclose(directions @ directions.T / 200_000, np.eye(3) / 3.0, atol=5e-3)


def test_progress_rises_to_one_and_may_stop_the_walk() -> None:
    shares: list[float] = []
    walk(Sphere(2.0), 1.0, [0.9], 1.3, UP, 40_000, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert 0.0 <= shares[0] < 0.5

    def stop(share: float) -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        walk(Sphere(2.0), 1.0, [0.9], 1.3, UP, 2_000, progress=stop)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"sigma_t_prime": 0.0}, "nearly clear"),
        ({"sigma_t_prime": np.nan}, "nearly clear"),
        ({"albedos": [1.1]}, "albedos"),
        ({"albedos": [np.nan]}, "albedos"),
        ({"albedos": []}, "albedos"),
        ({"eta": 0.9}, "eta"),
        ({"direction": (0.0, 0.0, 0.0)}, "direction"),
        ({"direction": (0.0, np.inf, 0.0)}, "direction"),
        ({"n_photons": 0}, "photons"),
        ({"shape": Slab(1.0), "direction": UP}, "z < 0"),
        ({"shape": ClosedMesh(cube()), "sigma_t_prime": 1e3}, "skin"),
    ],
)
def test_bad_input_is_one_sentence(arguments, problem) -> None:
    usual = {"shape": Sphere(1.0), "sigma_t_prime": 1.0, "albedos": [0.9], "eta": 1.3, "direction": UP, "n_photons": 9}
    with pytest.raises(InputError, match=problem):
        walk(**(usual | arguments))


@pytest.mark.parametrize("shape", [Slab, Sphere])
@pytest.mark.parametrize("size", [0.0, -1.0, np.inf, np.nan])
def test_shapes_have_a_size(shape, size) -> None:
    with pytest.raises(InputError, match="above 0"):
        shape(size)


def test_open_and_inverted_meshes_are_refused() -> None:
    inverted = trimesh.creation.icosphere(2)
    inverted.invert()
    for mesh in (mesh_of(sheet(0.0)), mesh_of(inverted)):
        with pytest.raises(InputError, match="closed"):
            ClosedMesh(mesh)


def test_holes_that_cancel_are_found_by_the_light_they_lose() -> None:
    box = cube()
    across = np.abs(box.normals[box.faces[:, 0], 0]) > 0.5
    tube = Mesh(box.vertices, box.normals, box.faces[~across])
    with pytest.raises(InputError, match="holes"):
        walk(ClosedMesh(tube), 0.5, [0.9], 1.3, UP, 2_000)
