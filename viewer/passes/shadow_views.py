"""Where shadow maps lie: matrices of views from a light that hold the object, row vectors as pyrr's."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pyrr import matrix44
from scipy.spatial import ConvexHull, QhullError

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh
from milkglass.viewer.scene.lights.sub_lights import DIRECTIONAL, SHAPE_CONE, SubLights

CUBE_MARGIN = 1.05  # of the bounding sphere: nearer lights need all six faces of a cube
# Bounding-sphere radii beyond which a point light's rays are parallel to a fifth of a texel; beyond a thousand times as
# many, a frustum's float32 depth no longer tells the object's front from its back.
FAR = 1e4
MAX_CONE_TANGENT = 2.0  # of the half angle of a cone that is a view of its own
MAX_VIEW_TANGENT = 4.0  # of half a view that holds the object: wider ones are a cube's six faces
CUBE_FACES = (  # forward, up
    ((1, 0, 0), (0, 1, 0)),
    ((-1, 0, 0), (0, 1, 0)),
    ((0, 1, 0), (0, 0, 1)),
    ((0, -1, 0), (0, 0, 1)),
    ((0, 0, 1), (0, 1, 0)),
    ((0, 0, -1), (0, 1, 0)),
)


def directional_view(mesh: Mesh, direction: tuple[float, float, float], side: int) -> tuple[list[Array], float]:
    """Return the orthographic view of the object from a direction, and the size of its square texels, mm."""
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
    """Return the frustum around the bounding sphere from a place outside, and its texel (mm per mm of depth)."""
    eye = np.asarray(position, np.float64)
    distance = float(np.linalg.norm(eye))
    axes = _axes(-eye)
    tangent = mesh.radius / np.sqrt(distance**2 - mesh.radius**2) * side / (side - 4)
    near, far = distance - mesh.radius, distance + mesh.radius
    return [_perspective(eye, axes, tangent, 0.99 * near, 1.01 * far)], 2.0 * tangent / side


def cube_views(mesh: Mesh, position: tuple[float, float, float], side: int) -> tuple[list[Array], float]:
    """Return the six views of a cube around a place at or inside the object's bounding sphere, and their texel."""
    eye = np.asarray(position, np.float64)
    far = float(np.linalg.norm(eye)) + mesh.radius
    views = [
        _perspective(eye, _axes(np.array(forward, float), np.array(up, float)), 1.0, 1e-3 * far, 1.01 * far)
        for forward, up in CUBE_FACES
    ]
    return views, 2.0 / side


def _perspective(
    eye: Array, axes: Array, tangent: float, near: float, far: float, middle: npt.ArrayLike = (0.0, 0.0)
) -> Array:
    """Return the matrix of a frustum of slopes up to `tangent` about `middle` (2,)."""
    view = np.eye(4)
    view[:3, :3] = axes
    view[3, :3] = -eye @ axes
    (left, bottom), (right, top) = (near * (np.asarray(middle, np.float64) + side * tangent) for side in (-1, 1))
    projection = matrix44.create_perspective_projection_from_bounds(
        left, right, bottom, top, near, far, dtype=np.float64
    )
    return np.asarray(view @ projection)


def _axes(forward: Array, up: Array | None = None) -> Array:
    """Return the columns right, up, backward of a view along `forward`: world to view rotation, row vectors."""
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
    """Views of all sub-lights of a light, equally wide and with the same depths.

    Attributes
    ----------
    matrices : (n, views, 4, 4) float64
        World to clip space, row vectors; 1 view that holds what is to be seen, or the 6 faces of a cube.
    width : float
        Of a view, mm of a directional light, mm per mm of depth otherwise.
    range : 2 floats
        Depths of the nearest and the farthest; of a directional light 0 and half their distance. mm.
    """

    matrices: Array
    width: float
    range: tuple[float, float]

    def tiles(self, side: int) -> tuple[Array, float]:
        """Return the matrices for tiles of `side` texels, with two of margin all around; and the size of a texel."""
        margin = side / (side - 4)
        return self.matrices / (margin, margin, 1.0, 1.0), self.width * margin / side


def soft_views(mesh: Mesh, lights: SubLights) -> SoftViews:
    """Return the views from sub-lights: one of each wherever one can hold the object or the cone, else a cube's six."""
    if lights.kind == DIRECTIONAL:
        return _directions(mesh, lights)
    corners = _corners(mesh)
    distance = np.linalg.norm(lights.vectors, axis=1)
    far = 1.01 * (float(distance.max()) + mesh.radius)
    min_depth = 1e-3 * far
    cone = _cone_tangent(lights) if lights.shape == SHAPE_CONE else np.inf
    views = [_around_object(corners, eye, min_depth) for eye in lights.vectors]
    widest = max(np.inf if view is None else view.tangent for view in views)
    if cone < min(widest, MAX_CONE_TANGENT):
        near = max(0.99 * (float(distance.min()) - mesh.radius), min_depth)
        axes = _axes(np.array(lights.axis))
        matrices = [_perspective(eye, axes, cone, near, far) for eye in lights.vectors]
        return SoftViews(np.array(matrices)[:, None], 2.0 * cone, (near, far))
    if widest > MAX_VIEW_TANGENT:
        cubes = [
            [_perspective(eye, _axes(np.array(forward, float), np.array(up, float)), 1.0, min_depth, far)
             for forward, up in CUBE_FACES]
            for eye in lights.vectors
        ]  # fmt: skip
        return SoftViews(np.array(cubes), 2.0, (min_depth, far))
    framed = [view for view in views if view is not None]
    near = max(0.99 * min(view.nearest for view in framed), min_depth)
    matrices = [
        _perspective(eye, view.axes, widest, near, far, view.middle)
        for eye, view in zip(lights.vectors, framed, strict=True)
    ]
    return SoftViews(np.array(matrices)[:, None], 2.0 * widest, (near, far))


@dataclass(frozen=True, eq=False)
class _View:
    """What a view must show: `axes` as of `_axes`; slopes from `middle` (2,) - `tangent` to `middle` + `tangent`."""

    axes: Array
    middle: Array
    tangent: float
    nearest: float  # mm along the view


def _corners(mesh: Mesh) -> Array:
    """Vertices that bound the object from wherever it is seen: (n, 3), of its convex hull."""
    try:
        hull = ConvexHull(mesh.vertices).vertices
    except QhullError:  # it is flat, or a line
        hull = np.arange(len(mesh.vertices))
    return np.asarray(mesh.vertices[hull], np.float64)


def _around_object(corners: Array, eye: Array, min_depth: float) -> _View | None:
    """Aim a view from a place at the object and fit it; None where it is all around, or nearer than `min_depth` mm."""
    offsets = corners - eye
    aim = np.mean(offsets / np.maximum(np.linalg.norm(offsets, axis=1), min_depth)[:, None], axis=0)
    for _ in range(2):  # the second time at the middle of what the first one saw
        if np.linalg.norm(aim) < 1e-6:
            return None
        axes = _axes(aim)
        x, y, z = np.einsum("nc,ck->kn", offsets, axes)
        nearest = -float(z.max())
        if nearest < min_depth:
            return None
        slopes = np.stack([x, y]) / -z
        low, high = slopes.min(axis=1), slopes.max(axis=1)
        aside = np.tan(0.5 * (np.arctan(low) + np.arctan(high)))
        aim = axes @ (*aside, -1.0)
    half = max(0.5 * float((high - low).max()), 1e-6)
    return _View(axes, 0.5 * (low + high), half, nearest)


def _cone_tangent(lights: SubLights) -> float:
    return float(np.sqrt(1.0 - lights.cone[0] ** 2) / max(lights.cone[0], 1e-6))


def _directions(mesh: Mesh, lights: SubLights) -> SoftViews:
    corners, frames = _corners(mesh), [_axes(-towards) for towards in lights.vectors]
    extents = [_extent(np.einsum("nc,ck->nk", corners, frame)) for frame in frames]
    half = 0.5 * max(float((high - low)[:2].max()) for low, high in extents)
    deep = max(0.5 * max(float(high[2] - low[2]) for low, high in extents), 1e-3 * half) * 1.01
    scale = np.array([1.0 / half, 1.0 / half, -1.0 / deep])
    matrices = np.tile(np.eye(4), (len(frames), 1, 1, 1))
    for matrix, frame, (low, high) in zip(matrices[:, 0], frames, extents, strict=True):
        matrix[:3, :3] = frame * scale
        matrix[3, :3] = -0.5 * (low + high) * scale
    return SoftViews(matrices, 2.0 * half, (0.0, deep))
