"""Procedural shapes of the benchmark as meshes in world space, mm: thick, thin, concave, and with fine detail.

Tests use them too. Normals are those of the exact surface where it is smooth.
"""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import trimesh

from milkglass.core.arrays import Array
from milkglass.core.geometry.implicit import Coordinates, Primitive, Values, polygonise, smooth_max
from milkglass.core.geometry.mesh import Mesh

Faces = npt.NDArray[np.int64]


def ball(diameter: float = 20.0, subdivisions: int = 5) -> Mesh:
    """Return an icosphere with smooth normals: thick."""
    shape = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.5 * diameter)
    return Mesh.of(shape.vertices, shape.vertices / (0.5 * diameter), shape.faces)


def detail(size: float = 20.0, bump: float = 1.5, height: float = 0.5, subdivisions: int = 6) -> Mesh:
    """Return a ball with bumps about `bump` mm apart and `height` mm high, and smooth normals: fine detail."""
    radius = 0.5 * size - height
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0)
    u = np.asarray(sphere.vertices, np.float64)
    bumps = _spread(round(4.0 * np.pi * (radius / bump) ** 2 / (0.5 * np.sqrt(3.0))))
    sharpness = (radius / (0.27 * bump)) ** 2  # Gaussians of a standard deviation of 0.27 of their distance
    r, slope = np.empty((len(u), 1)), np.empty_like(u)
    for rows in np.array_split(np.arange(len(u)), 1 + len(u) // 4096):
        rise = height * np.exp(sharpness * (u[rows] @ bumps.T - 1.0))
        r[rows] = radius + rise.sum(axis=1, keepdims=True)
        slope[rows] = sharpness * rise @ bumps
    slope -= np.einsum("ij,ij->i", slope, u)[:, None] * u
    normals = r * u - slope  # of a surface r(u) u
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    vertices = r * u
    return Mesh.of(vertices * size / np.ptp(vertices, axis=0).max(), normals, sphere.faces)


def plate(side: float = 20.0, thickness: float = 1.0, n: int = 96) -> Mesh:
    """Return a square plate across z, its faces divided n x n, with flat shading: thin."""
    rows, columns = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    corner = (rows * (n + 1) + columns).ravel()
    triangles = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + n + 2], axis=1),
            np.stack([corner, corner + n + 2, corner + n + 1], axis=1),
        ]
    )
    u = np.linspace(-0.5, 0.5, n + 1)
    y, x = np.meshgrid(u, u, indexing="ij")
    top = np.stack([side * x.ravel(), side * y.ravel(), np.full(x.size, 0.5 * thickness)], axis=1)
    box = trimesh.creation.box((side, side, thickness))
    sides = box.faces[np.abs(box.face_normals[:, 2]) < 0.5]
    parts = [
        (top, triangles),
        (top * [1, 1, -1], triangles[:, ::-1]),
        (box.vertices, sides),
    ]
    return flat_shaded(*_joined(parts))


def torus_knot(size: float = 20.0, n_along: int = 480, n_around: int = 48) -> Mesh:
    """Return a (2, 3) torus knot with a round tube and smooth normals: concave, with self-shadowing."""
    t = np.linspace(0.0, 2.0 * np.pi, n_along, endpoint=False)

    def curve(t: Array) -> Array:
        radius = 2.0 + np.cos(3.0 * t)
        return np.stack([radius * np.cos(2.0 * t), radius * np.sin(2.0 * t), np.sin(3.0 * t)], axis=-1)

    centre = curve(t)
    tangent = curve(t + 1e-4) - curve(t - 1e-4)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent, centre)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    binormal = np.cross(tangent, side)
    angle = np.linspace(0.0, 2.0 * np.pi, n_around, endpoint=False)[None, :, None]
    normals = (np.cos(angle) * side[:, None] + np.sin(angle) * binormal[:, None]).reshape(-1, 3)
    vertices = (centre[:, None] + 0.55 * normals.reshape(n_along, n_around, 3)).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n_along), np.arange(n_around), indexing="ij")
    a, b = i * n_around + j, (i + 1) % n_along * n_around + j
    c, d = (i + 1) % n_along * n_around + (j + 1) % n_around, i * n_around + (j + 1) % n_around
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if np.einsum("ij,ij->i", cross, normals[faces].mean(axis=1)).mean() < 0:
        faces = faces[:, ::-1]
    vertices -= 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    return Mesh.of(vertices * size / np.ptp(vertices, axis=0).max(), normals, faces)


def bowl(diameter: float = 20.0, thickness: float = 3.0, n_along: int = 160, n_around: int = 160) -> Mesh:
    """Return half a spherical shell with a round rim, open towards +z, with smooth normals: concave and thin."""
    outer, inner, rim = 0.5 * diameter, 0.5 * diameter - thickness, 0.5 * thickness
    arcs = 0.5 * np.pi * np.array([outer, 2.0 * rim, inner])  # lengths of the outer side, the rim and the inner side
    s = np.linspace(0.0, arcs.sum(), n_along + 1)
    ends = np.cumsum(arcs)
    outer_angle, rim_angle, inner_angle = s / outer, (s - ends[0]) / rim, (ends[2] - s) / inner
    cases = [s <= ends[0], s <= ends[1]]
    radius = np.select(
        cases, [outer * np.sin(outer_angle), outer - rim + rim * np.cos(rim_angle)], inner * np.sin(inner_angle)
    )
    z = np.select(cases, [-outer * np.cos(outer_angle), rim * np.sin(rim_angle)], -inner * np.cos(inner_angle))
    outwards = np.select(cases, [np.sin(outer_angle), np.cos(rim_angle)], -np.sin(inner_angle))
    upwards = np.select(cases, [-np.cos(outer_angle), np.sin(rim_angle)], np.cos(inner_angle))
    angle = 2.0 * np.pi * np.arange(n_around) / n_around

    def turned(across: Array, along: Array) -> Array:
        """Return points of the profile revolved about z: rings, then the two poles."""
        ring = across[1:-1, None]
        round_z = np.broadcast_to(along[1:-1, None], (len(ring), n_around))
        rings = np.stack([ring * np.cos(angle), ring * np.sin(angle), round_z], axis=-1)
        return np.concatenate([rings.reshape(-1, 3), [[0.0, 0.0, along[0]], [0.0, 0.0, along[-1]]]])

    i, j = np.meshgrid(np.arange(n_along - 2), np.arange(n_around), indexing="ij")
    a, b = i * n_around + j, i * n_around + (j + 1) % n_around
    c, d = a + n_around, b + n_around
    first, last = np.arange(n_around), (n_along - 2) * n_around + np.arange(n_around)
    pole = np.full(n_around, (n_along - 1) * n_around)
    parts = [(a, b, d), (a, d, c), (pole, np.roll(first, -1), first), (pole + 1, last, np.roll(last, -1))]
    faces = np.concatenate([np.stack([corner.ravel() for corner in corners], axis=1) for corners in parts])
    return Mesh.of(turned(radius, z + 0.5 * (outer - rim)), turned(outwards, upwards), faces)


def torus(radius: float = 10.0, tube: float = 4.0, n_along: int = 128, n_around: int = 64) -> Mesh:
    """Return a torus with smooth normals: a hole."""
    shape = trimesh.creation.torus(radius, tube, major_sections=n_along, minor_sections=n_around)
    vertices = np.asarray(shape.vertices, np.float64)
    ring = vertices * [1.0, 1.0, 0.0]
    return Mesh.of(
        vertices, (vertices - radius * ring / np.linalg.norm(ring, axis=1, keepdims=True)) / tube, shape.faces
    )


def washer(outer: float = 16.0, inner: float = 6.0, height: float = 10.0, edge: float = 0.7) -> Mesh:
    """Return a cylinder with a hole along z, in triangles of at most `edge` mm, with flat shading: square edges."""
    return faceted(trimesh.creation.annulus(inner, outer, height, sections=64), edge)


def turned(outline: Sequence[tuple[float, float]], edge: float = 0.7) -> Mesh:
    """Return an outline of (radius, z) revolved about z, in triangles of at most `edge` mm, with flat shading."""
    return faceted(trimesh.creation.revolve(np.array(outline, np.float64), sections=64), edge)


def dish(thickness: float = 3.0) -> Mesh:
    """Return a dish of 20 mm with a wall of 8 mm around a flat floor: convex edges and a concave one."""
    inner, floor = 10.0 - thickness, thickness - 4.0
    return turned([(0.0, -4.0), (10.0, -4.0), (10.0, 4.0), (inner, 4.0), (inner, floor), (0.0, floor)])


def box(side: float = 8.0, edge: float = 0.7) -> Mesh:
    """Return a cube, in triangles of at most `edge` mm, with flat shading."""
    return faceted(trimesh.creation.box((side, side, side)), edge)


def gyroid(diameter: float = 20.0, period: float = 16.0, thickness: float = 3.0, spacing: float = 0.4) -> Mesh:
    """Return a ball cut from a gyroid (Schoen 1970), a wall between two labyrinths; smooth normals but for its rims.

    g = sin kx cos ky + sin ky cos kz + sin kz cos kx, k = 2 pi / period; the wall is where |g| < 3/4 k thickness, as
    |grad g| is 3/2 k on g = 0 in the mean. Lengths in mm.
    """
    k = np.float32(2.0 * np.pi / period)

    def distance(points: Coordinates) -> Values:
        sines, cosines = np.sin(k * points), np.cos(k * points)
        g = (sines * np.roll(cosines, -1, axis=0)).sum(axis=0)
        wall = np.abs(g) / (np.float32(1.5) * k) - np.float32(0.5 * thickness)
        return smooth_max(wall, np.linalg.norm(points, axis=0) - np.float32(0.5 * diameter), 0.4)

    size = 0.5 * diameter + 2.0 * spacing
    vertices, faces, normals = polygonise([Primitive(distance, spacing)], [-size] * 3, [size] * 3, spacing)
    return Mesh.of(vertices, normals, faces)


def bolt(edge: float = 0.7) -> Mesh:
    """Return a bolt of 15 mm: a hexagonal head, 10 mm across its flats, on a shank of 6 mm; flat shading."""
    angle = 2.0 * np.pi * np.arange(48) / 48
    head = 5.0 / np.cos((angle + np.pi / 6.0) % (np.pi / 3.0) - np.pi / 6.0)
    rings = [_ring(head, angle, -7.5), _ring(head, angle, -2.5), _ring(3.0, angle, -2.5), _ring(3.0, angle, 7.5)]
    poles = np.full((1, 48, 3), [0.0, 0.0, -7.5]), np.full((1, 48, 3), [0.0, 0.0, 7.5])
    return _lofted(np.concatenate([poles[0], rings, poles[1]]), edge)


def gear(teeth: int = 10, height: float = 5.0, edge: float = 0.7) -> Mesh:
    """Return a spur gear of 18 mm around z with trapezoidal teeth and a hole of 6 mm, `height` mm; flat shading."""
    pitch = 2.0 * np.pi / teeth
    angle = (pitch * np.arange(teeth)[:, None] + pitch * np.array([0.0, 0.4, 0.55, 0.85])).ravel()
    radius = np.tile([6.5, 6.5, 9.0, 9.0], teeth)
    low, high = -0.5 * height, 0.5 * height
    rings = [_ring(radius, angle, low), _ring(radius, angle, high), _ring(3.0, angle, high), _ring(3.0, angle, low)]
    return _lofted(np.array([*rings, rings[0]]), edge)


def _ring(radius: npt.ArrayLike, angle: Array, z: float) -> Array:
    """Return points (n, 3) of cylindrical coordinates about z."""
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(len(angle), z)], axis=1)


def _lofted(rings: Array, edge: float) -> Mesh:
    """Return the surface through rings (k, n, 3) that wind around z, the outer ones from below to above; flat shading.

    It is closed if the first and the last ring are equal, or points.
    """
    k, n, _ = rings.shape
    lower = (np.arange(k - 1)[:, None] * n + np.arange(n)).ravel()
    neighbour = (np.arange(k - 1)[:, None] * n + np.roll(np.arange(n), -1)).ravel()
    faces = np.concatenate(
        [np.stack([lower, neighbour, neighbour + n], 1), np.stack([lower, neighbour + n, lower + n], 1)]
    )
    shape = trimesh.Trimesh(rings.reshape(-1, 3), faces, process=False)
    shape.merge_vertices()
    shape.update_faces(shape.nondegenerate_faces())
    return faceted(shape, edge)


def faceted(shape: trimesh.Trimesh, edge: float) -> Mesh:
    """Return a shape divided into triangles of at most `edge` mm, with flat shading."""
    return flat_shaded(*trimesh.remesh.subdivide_to_size(shape.vertices, shape.faces, edge))


def flat_shaded(vertices: Array, faces: Faces) -> Mesh:
    """Return a mesh whose faces share no vertices and have their face normals."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    split = np.arange(3 * len(faces)).reshape(-1, 3)
    return Mesh.of(corners.reshape(-1, 3), np.repeat(normals, 3, axis=0), split)


def _spread(n: int) -> Array:
    """Return n unit directions evenly over the sphere along a spiral, (n, 3)."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n)
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


def _joined(parts: list[tuple[Array, Faces]]) -> tuple[Array, Faces]:
    offsets = np.cumsum([0, *(len(v) for v, _ in parts)])
    vertices = np.concatenate([v for v, _ in parts])
    return vertices, np.concatenate([f + o for (_, f), o in zip(parts, offsets, strict=False)])


SHAPES: dict[str, Callable[[], Mesh]] = {
    "ball": ball,
    "plate": plate,
    "knot": torus_knot,
    "detail": detail,
}
