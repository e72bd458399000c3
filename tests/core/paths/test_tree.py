import numpy as np
import pytest
import trimesh

from milkglass.core.light.maps import latlong_to_direction
from milkglass.core.material.fresnel import reflectance
from milkglass.core.paths.events import Rays
from milkglass.core.paths.glow import Glow
from milkglass.core.paths.lamps import BALL, DISC, PANEL, Lamp
from milkglass.core.paths.surface import Surface
from milkglass.core.paths.surroundings import Floor, Surroundings
from milkglass.core.paths.tree import PathsSuperseded, Sight, Tree
from tests.support import solids
from tests.support.counting import rays_cast

CLEAR = np.zeros((1, 3), np.float32)
WHITE = Surroundings.of(np.ones((2, 4, 3), np.float32))
RADIUS = 10.0


def sphere(eta: float) -> Surface:
    return Surface.of(solids.mesh_of(solids.ball(RADIUS, subdivisions=5)), eta)


def egg(eta: float) -> Surface:
    part = solids.ball(RADIUS, subdivisions=5)
    part.apply_scale([1.0, 0.72, 0.56])
    return Surface.of(solids.mesh_of(part), eta)


def torus(eta: float) -> Surface:
    return Surface.of(solids.mesh_of(trimesh.creation.torus(8.0, 3.0, 96, 48)), eta)


def sight(surface: Surface, count: int = 4000, spread: float = RADIUS) -> Sight:
    """Rays along -z that meet the surface, at random in a square."""
    rng = np.random.default_rng(0)
    origins = np.column_stack([rng.uniform(-spread, spread, (count, 2)), np.full(count, 50.0)]).astype(np.float32)
    directions = np.tile(np.array([0.0, 0.0, -1.0], np.float32), (count, 1))
    face, distance, u, v = surface.rays.places(origins, directions)
    met = face >= 0
    corners, weights = surface.faces.corners[face], np.stack([1.0 - u - v, u, v], axis=1)
    normals = np.einsum("ij,ijk->ik", weights, surface.faces.normals[corners]).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = origins + distance[:, None] * directions
    return Sight(points[met], normals[met], directions[met], np.zeros(met.sum(), np.int32))


def sky(radiance) -> Surroundings:
    """Return surroundings with a radiance that is a function of unit directions."""
    height = 256
    u, v = (np.arange(2 * height) + 0.5) / (2 * height), (np.arange(height) + 0.5) / height
    values = radiance(latlong_to_direction(np.stack(np.meshgrid(u, v), axis=-1)))
    return Surroundings.of(np.repeat(values[..., None], 3, axis=-1))


@pytest.mark.parametrize("shape", [sphere, egg, torus])
def test_clear_matter_in_a_white_furnace_is_not_to_be_seen(shape):
    surface = shape(1.33)
    seen = Tree(surface, CLEAR, WHITE).trace(sight(surface))
    np.testing.assert_allclose(seen.mirror + seen.unscattered, 1.0, atol=1e-3)
    assert seen.mirror.min() > 0.015
    assert not seen.scattered.any()


def test_matter_of_the_index_of_air_shows_what_is_behind_it():
    surface = torus(1.0)
    seen = Tree(surface, CLEAR, sky(lambda d: 1.0 + d[..., 0] - 0.5 * d[..., 2])).trace(sight(surface))
    np.testing.assert_allclose(seen.mirror + seen.unscattered, 1.5, atol=1e-3)


def test_light_along_the_axis_of_a_sphere_is_a_geometric_series():
    """From ahead T^2 a (1 + R^2 a^2 + ...), from behind T^2 R a^2 (1 + ...), a what a diameter lets through."""
    surface, extinction = sphere(2.0), np.array([[0.01, 0.03, 0.1]], np.float32)
    seen = Tree(surface, extinction, sky(lambda d: np.where(d[..., 2] < 0.0, 3.0, 1.0))).trace(sight(surface, 200, 0.1))
    r, a = float(reflectance(2.0, 1.0)), np.exp(-2.0 * RADIUS * extinction)
    through = (1.0 - r) ** 2 * (3.0 * a + r * a**2) / (1.0 - r**2 * a**2)
    np.testing.assert_allclose(seen.unscattered, np.broadcast_to(through, seen.unscattered.shape), rtol=0.012)
    np.testing.assert_allclose(seen.mirror, r, rtol=1e-3)


def test_a_lamp_before_a_sphere_is_seen_through_it_in_the_mirror_of_its_far_side():
    """T^2 R a^2 (1 + R^2 a^2 + ...) of its radiance, and R more where what is left is not parted."""
    surface, extinction = sphere(1.33), np.array([[0.02, 0.03, 0.1]], np.float32)
    lamp = Lamp(DISC, (0.0, 0.0, 1.0), (200.0, 200.0, 100.0), float(np.cos(0.1)))
    seen = Tree(surface, extinction, Surroundings.of(lamps=[lamp])).trace(sight(surface, 200, 0.1))
    r, a = float(reflectance(1.33, 1.0)), np.exp(-2.0 * RADIUS * extinction)
    expected = (1.0 - r) ** 2 * r * a**2 / (1.0 - r**2 * a**2) * lamp.radiance
    np.testing.assert_allclose(seen.unscattered, np.broadcast_to(expected, seen.unscattered.shape), rtol=0.01 + r)
    assert not seen.mirror.any()


@pytest.mark.parametrize(("highlights", "share"), [(0.05, 1.0), (0.1 / 1.5, 0.5), (0.1, 0.0), (np.inf, 0.0)])
def test_a_wide_lamp_is_seen_in_the_first_mirror_unless_it_is_drawn_as_a_highlight(highlights, share):
    surface = sphere(1.33)
    lamp = Lamp(DISC, (0.0, 0.0, 1.0), (200.0, 200.0, 100.0), float(np.cos(0.1)))
    tree = Tree(surface, CLEAR, Surroundings.of(lamps=[lamp]), clear=False)
    seen = tree.find(sight(surface, 200, 0.1), highlights=highlights).seen
    expected = share * float(reflectance(1.33, 1.0)) * np.array(lamp.radiance)
    np.testing.assert_allclose(seen.mirror, np.broadcast_to(expected, seen.mirror.shape), rtol=1e-3)
    assert not tree.find(sight(surface, 200, RADIUS), highlights=highlights).seen.mirror[:, 0].all()


def test_a_lamp_behind_another_part_is_not_seen_in_the_first_mirror():
    front, behind = (solids.ball(RADIUS, at=(0.0, 0.0, z), subdivisions=4) for z in (30.0, 0.0))
    surface = Surface.of(solids.mesh_of(front, behind), 1.33)
    lamp = Lamp(DISC, (0.0, 0.0, 1.0), (200.0, 200.0, 100.0), float(np.cos(0.1)))
    tree = Tree(surface, CLEAR, Surroundings.of(lamps=[lamp]), clear=False)
    seen = tree.find(sight(sphere(1.33), 200, 0.1), highlights=0.05).seen
    second = float(reflectance(1.33, 1.0)) ** 3  # mirrored by the ball in front and once more: what is left of the lamp
    assert seen.mirror.max() <= second * 200.0


def test_uniform_glow_in_a_sphere_is_what_a_chord_gathers():
    """T / eta^2 S (1 - a) / s_t' of the first chord, over 1 - R a of all."""
    surface, extinction = sphere(2.0), np.array([[0.0, 0.03, 1.0]], np.float32)
    box = np.ones((3, 22, 22, 22)) * np.array([0.5, 1.0, 2.0])[:, None, None, None]
    glow = Glow.of(box, (-10.5, -10.5, -10.5), 1.0)
    seen = Tree(surface, extinction, WHITE, (glow,)).trace(sight(surface, 200, 0.1))
    length = 2.0 * RADIUS
    gathered = np.array([length, *(1.0 - np.exp(-length * extinction[0, 1:])) / extinction[0, 1:]])
    r = float(reflectance(2.0, 1.0))
    expected = (1.0 - r) / 4.0 * np.array([0.5, 1.0, 2.0]) * gathered
    expected /= 1.0 - r * np.exp(-length * extinction[0])
    np.testing.assert_allclose(seen.scattered, np.broadcast_to(expected, seen.scattered.shape), rtol=0.015)


def test_glow_is_read_between_its_nodes_and_nowhere_else():
    """A linear volume is read exactly; a ball of glass without a surface shows half of it."""
    surface = sphere(1.0)
    z, y, x = np.meshgrid(*[np.arange(12.0)] * 3, indexing="ij")
    glow = Glow.of(np.stack([x + 2.0 * y, z, np.ones_like(z)]), (-11.0, -12.0, -13.0), 2.0)
    rays = sight(surface, 300, 4.0)
    seen = Tree(surface, CLEAR, WHITE, (glow,)).trace(rays)
    chord = 2.0 * rays.points[:, 2]
    at = (rays.points[:, 0] + 11.0) / 2.0 + (rays.points[:, 1] + 12.0)
    np.testing.assert_allclose(seen.scattered[:, 0], chord * at, rtol=2e-3)
    np.testing.assert_allclose(seen.scattered[:, 1], chord * 6.5, rtol=2e-3)


def test_an_opaque_object_that_lets_out_what_surrounds_it_is_as_bright_in_its_own_mirror():
    surface = torus(1.5)
    rays = sight(surface)
    seen = Tree(surface, CLEAR, WHITE, leaving=lambda of: np.ones((len(of), 3), np.float32), clear=False).trace(rays)
    facing = -np.einsum("ij,ij->i", rays.normals, rays.directions)
    assert seen.mirror.std() > 0.05
    assert not seen.unscattered.any()
    assert not seen.scattered.any()
    expected = np.broadcast_to(reflectance(1.5, facing)[:, None], seen.mirror.shape)
    np.testing.assert_allclose(seen.mirror, expected, atol=0.003)


@pytest.mark.parametrize("eta", [1.0, 1.33, 1.8])
def test_what_collides_in_a_plate_is_a_geometric_series(eta):
    """At any slant: of what is refracted a share collides on every way across, and F_r of the rest crosses again."""
    surface = Surface.of(solids.mesh_of(solids.block((200.0, 200.0, 2.0))), eta)
    extinction, facing = np.array([[0.01, 0.5, 20.0]], np.float32), np.linspace(0.2, 1.0, 50)
    directions = np.stack([np.sqrt(1.0 - facing**2), np.zeros(50), -facing], axis=1).astype(np.float32)
    points, up = np.tile(np.array([0.0, 0.0, 1.0], np.float32), (50, 1)), np.array([0.0, 0.0, 1.0], np.float32)
    seen = Tree(surface, extinction, WHITE).trace(
        Sight(points, np.tile(up, (50, 1)), directions, np.zeros(50, np.int32))
    )
    mirrored = reflectance(eta, facing)[:, None]
    kept = np.exp(-2.0 * extinction / np.sqrt(1.0 - (1.0 - facing[:, None] ** 2) / eta**2))
    np.testing.assert_allclose(seen.collided, (1.0 - mirrored) * (1.0 - kept) / (1.0 - mirrored * kept), atol=3e-3)
    np.testing.assert_allclose(seen.mirror + seen.unscattered + seen.collided, 1.0, atol=1e-5)


@pytest.mark.parametrize("shape", [sphere, egg, torus])
def test_matter_of_any_density_that_sends_out_what_surrounds_it_is_not_to_be_seen(shape):
    """Wherever light collides, on the first way through or where it has left and entered again."""
    surface, extinction = shape(1.33), np.array([[0.02, 0.2, 5.0]], np.float32)
    seen = Tree(surface, extinction, WHITE, leaving=lambda of: np.ones((len(of), 3), np.float32)).trace(sight(surface))
    np.testing.assert_allclose(seen.mirror + seen.unscattered + seen.scattered + seen.collided, 1.0, atol=1e-3)
    assert seen.collided[:, 2].mean() > 0.8


def test_a_floor_is_seen_from_above_and_fades_into_the_surroundings():
    ramp = np.sinh(np.linspace(-1.0, 1.0, 65)[:64] + 1.0 / 64.0) * 3.0 + 2.0  # x of the map's places
    radiance = np.stack([*np.broadcast_arrays(1.0, ramp[None, :], ramp[:, None])], axis=-1).astype(np.float32)
    floor = Floor(radiance, -5.0, np.array([2.0, 2.0], np.float32), np.array([2.0, 3.0], np.float32), 3.0, 1.0)
    ends = np.array([[3.0, -5.0, 1.5], [1.0, -5.0, 2.5], [4.5, -5.0, 2.0], [2.0, -5.0, 6.0], [3.0, 5.0, 1.5]])
    directions = (ends / np.linalg.norm(ends, axis=1, keepdims=True)).astype(np.float32)
    rays = Rays.beginning(np.zeros((5, 3), np.float32), directions, np.ones((5, 3), np.float32), np.arange(5))
    Surroundings.of(np.full((2, 4, 3), 7.0, np.float32)).above(floor).add(rays, seen := np.zeros((5, 3), np.float32), 0)
    shares = np.array([1.0, 1.0, 0.5, 0.0, 0.0])[:, None]
    on_floor = np.stack([np.ones(5), ends[:, 0], ends[:, 2]], axis=1)
    np.testing.assert_allclose(seen, 7.0 + shares * (on_floor - 7.0), rtol=0.01)
    below = np.array([[0.0, -6.0, 0.0]], np.float32)
    rays = Rays.beginning(below, directions[:1], np.ones((1, 3), np.float32), np.zeros(1, np.int32))
    Surroundings.of().above(floor).add(rays, seen := np.zeros((1, 3), np.float32), 0)
    assert not seen.any()


@pytest.mark.parametrize(
    ("lamp", "solid_angle"),
    [
        (Lamp(DISC, (0.0, 0.0, -1.0), (2.0, 1.0, 0.5), float(np.cos(0.1))), 2.0 * np.pi * (1.0 - np.cos(0.1))),
        (Lamp(BALL, (0.0, 0.0, -100.0), (2.0, 1.0, 0.5), 10.0), 2.0 * np.pi * (1.0 - np.sqrt(0.99))),
        (
            Lamp(
                PANEL,
                (0.0, 0.0, -100.0),
                (2.0, 1.0, 0.5),
                width=(5.0, 0.0, 0.0),
                height=(0.0, 8.0, 0.0),
                forward=(0.0, 0.0, 1.0),
            ),
            160.0 / 1e4,
        ),
    ],
)
def test_lamps_are_as_large_as_they_are(lamp, solid_angle):
    rng, count, cap = np.random.default_rng(0), 200_000, 0.02
    cosine, angle = 1.0 - cap * rng.random(count), 2.0 * np.pi * rng.random(count)
    sine = np.sqrt(1.0 - cosine**2)
    directions = np.column_stack([sine * np.cos(angle), sine * np.sin(angle), -cosine]).astype(np.float32)
    number = np.zeros(count, np.int32)
    rays = Rays.beginning(np.zeros_like(directions), directions, np.ones((count, 3), np.float32), number)
    radiance = np.zeros((1, 3), np.float32)
    Surroundings.of(lamps=[lamp]).add(rays, radiance, 0)
    expected = solid_angle / (2.0 * np.pi * cap) * count
    np.testing.assert_allclose(radiance[0], expected * np.array(lamp.radiance), rtol=0.02)
    Surroundings.of(lamps=[lamp]).add(rays, radiance := np.zeros((1, 3), np.float32), 1)
    assert not radiance.any()


def test_paths_that_are_superseded_end_and_those_that_wait_begin_none():
    surface = sphere(1.33)
    rays = sight(surface, 20_000)

    def superseded() -> None:
        with pytest.raises(PathsSuperseded):
            Tree(surface, CLEAR, WHITE).find(rays, lambda: False)

    assert rays_cast(superseded) == 0
