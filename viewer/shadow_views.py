"""Where shadow maps lie: matrices of views from a light that hold the object, row vectors as pyrr's."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pyrr import matrix44

from core.mesh import Mesh
from viewer.sub_lights import CONE, DIRECTIONAL, SubLights

Array = npt.NDArray[np.float64]

CUBE_MARGIN = 1.05  # of the bounding sphere: nearer lights need all six faces of a cube
# Bounding-sphere radii beyond which a point light's rays are parallel to a fifth of a texel; beyond a thousand times as
# many, a frustum's float32 depth no longer tells the object's front from its back.
FAR = 1e4
WIDE = 2.0  # tangent of a cone's half angle from which on it is no view of its own
CUBE_FACES = (  # forward, up
    ((1, 0, 0), (0, 1, 0)),
    ((-1, 0, 0), (0, 1, 0)),
    ((0, 1, 0), (0, 0, 1)),
    ((0, -1, 0), (0, 0, 1)),
    ((0, 0, 1), (0, 1, 0)),
    ((0, 0, -1), (0, 1, 0)),
)


def directional_view(mesh: Mesh, direction: tuple[float, float, float], side: int) -> tuple[list[Array], float]:
    """Orthographic box around the object seen from a direction, square texels."""
    axes = _axes(-np.asarray(direction, np.float64))
    low, high = _extent(mesh.vertices @ axes)
    half = 0.5 * float((high - low)[:2].max()) * side / (side - 4)  # two texels of margin all around
    centre = 0.5 * (low + high)
    # A flat object seen face-on has no depth; any small positive range will do.
    half_depth = max(0.5 * float(high[2] - low[2]), 1e-3 * half) * 1.01
    scale = np.array([1.0 / half, 1.0 / half, -1.0 / half_depth])  # depth grows along -z of the light's view
    matrix = np.eye(4)
    matrix[:3, :3] = axes * scale
    matrix[3, :3] = -centre * scale
    return [matrix], 2.0 * half / side


def frustum_view(mesh: Mesh, position: tuple[float, float, float], side: int) -> tuple[list[Array], float]:
    """One frustum around the bounding sphere of the object, from outside it."""
    eye = np.asarray(position, np.float64)
    distance = float(np.linalg.norm(eye))
    axes = _axes(-eye)
    tangent = mesh.radius / np.sqrt(distance**2 - mesh.radius**2) * side / (side - 4)
    near, far = distance - mesh.radius, distance + mesh.radius
    return [_perspective(eye, axes, tangent, 0.99 * near, 1.01 * far)], 2.0 * tangent / side


def cube_views(mesh: Mesh, position: tuple[float, float, float], side: int) -> tuple[list[Array], float]:
    """Six faces of a cube around a light at or inside the object's bounding sphere."""
    eye = np.asarray(position, np.float64)
    far = float(np.linalg.norm(eye)) + mesh.radius
    views = [
        _perspective(eye, _axes(np.array(forward, float), np.array(up, float)), 1.0, 1e-3 * far, 1.01 * far)
        for forward, up in CUBE_FACES
    ]
    return views, 2.0 / side


def _perspective(eye: Array, axes: Array, tangent: float, near: float, far: float) -> Array:
    view = np.eye(4)
    view[:3, :3] = axes
    view[3, :3] = -eye @ axes
    half = near * tangent
    projection = matrix44.create_perspective_projection_from_bounds(
        -half, half, -half, half, near, far, dtype=np.float64
    )
    return np.asarray(view @ projection)


def _axes(forward: Array, up: Array | None = None) -> Array:
    """Columns right, up, backward of a view along `forward`: world to view rotation, row vectors."""
    back = -forward / np.linalg.norm(forward)
    if up is None:  # the world axis least parallel to the view
        up = np.eye(3)[np.abs(back).argmin()]
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back], axis=1)


def _extent(points: npt.NDArray[np.floating]) -> tuple[Array, Array]:
    return points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)


@dataclass(frozen=True, eq=False)
class SoftViews:
    """Views of all sub-lights of a light, with the same texel and depths.

    Attributes
    ----------
    matrices : (n, views, 4, 4) float64
        World to clip space, row vectors.
    texel : float
        mm of a directional light, mm per mm of distance otherwise.
    range : 2 floats
        Depths of the nearest and the farthest; of a directional light 0 and half their distance. mm.
    """

    matrices: Array
    texel: float
    range: tuple[float, float]


def soft_view_count(mesh: Mesh, lights: SubLights) -> int:
    """1, or 6 where a sub-light is too near the object for one."""
    if lights.kind == DIRECTIONAL or (lights.shape == CONE and _cone_tangent(lights) < WIDE):
        return 1
    return 1 if np.linalg.norm(lights.vectors, axis=1).min() > CUBE_MARGIN * mesh.radius else 6


def soft_views(mesh: Mesh, lights: SubLights, side: int) -> SoftViews:
    """Views from sub-lights for tiles of `side` texels."""
    margin = side / (side - 4)  # two texels all around
    if lights.kind == DIRECTIONAL:
        return _directions(mesh, lights, margin, side)
    distance = np.linalg.norm(lights.vectors, axis=1)
    far = 1.01 * (float(distance.max()) + mesh.radius)
    if soft_view_count(mesh, lights) == 6:
        near = 1e-3 * far
        cubes = [
            [
                _perspective(eye, _axes(np.array(forward, float), np.array(up, float)), margin, near, far)
                for forward, up in CUBE_FACES
            ]
            for eye in lights.vectors
        ]
        return SoftViews(np.array(cubes), 2.0 * margin / side, (near, far))
    near = max(0.99 * (float(distance.min()) - mesh.radius), 1e-3 * far)
    apart = float(distance.min()) ** 2 - mesh.radius**2
    tangent = mesh.radius / np.sqrt(apart) if apart > 0.0 else np.inf
    ways = -lights.vectors
    if lights.shape == CONE and _cone_tangent(lights) < tangent:
        tangent, ways = _cone_tangent(lights), np.array([lights.axis])
    frusta = [
        [_perspective(eye, _axes(way), tangent * margin, near, far)]
        for eye, way in zip(lights.vectors, ways, strict=True)
    ]
    return SoftViews(np.array(frusta), 2.0 * tangent * margin / side, (near, far))


def _cone_tangent(lights: SubLights) -> float:
    return float(np.sqrt(1.0 - lights.cone[0] ** 2) / max(lights.cone[0], 1e-6))


def _directions(mesh: Mesh, lights: SubLights, margin: float, side: int) -> SoftViews:
    frames = [_axes(-towards) for towards in lights.vectors]
    extents = [_extent(mesh.vertices @ frame.astype(np.float32)) for frame in frames]
    half = 0.5 * max(float((high - low)[:2].max()) for low, high in extents) * margin
    deep = max(0.5 * max(float(high[2] - low[2]) for low, high in extents), 1e-3 * half) * 1.01
    scale = np.array([1.0 / half, 1.0 / half, -1.0 / deep])
    matrices = np.tile(np.eye(4), (len(frames), 1, 1, 1))
    for matrix, frame, (low, high) in zip(matrices[:, 0], frames, extents, strict=True):
        matrix[:3, :3] = frame * scale
        matrix[3, :3] = -0.5 * (low + high) * scale
    return SoftViews(matrices, 2.0 * half / side, (0.0, deep))
