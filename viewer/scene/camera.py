"""The camera: matrices from a scene's orbit angles.

Matrices are pyrr's, for row vectors: (x, y, z, 1) @ M, translation in row 3. Their memory is what OpenGL reads
column by column, so that GLSL writes M * v. View space is right-handed, looks along -z, y up.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from pyrr import matrix33, matrix44

from milkglass.core.arrays import Array, Ints
from milkglass.viewer.scene.settings import CameraSettings

if TYPE_CHECKING:
    from milkglass.core.geometry.mesh import Mesh

FILL = 0.92  # share of the picture that the silhouette's box takes where no zoom is given
CENTRE = (0.0, 0.0, 0.0)  # of the model's box, mm
RATIO = np.array([0.7548776662466927, 0.5698402909980532])  # golden, of two dimensions

Offset = tuple[float, float]


def world_to_probe(rotation_deg: float) -> npt.NDArray[np.float64]:
    """Return the rotation from world to probe, (3, 3), row vectors: one turned by a about +y is read at R_y(-a) d."""
    # pyrr turns row vectors by the negative angle: v @ M = R_y(-a) v.
    return np.asarray(matrix33.create_from_y_rotation(np.radians(rotation_deg), dtype=np.float64))


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera placed in the world, as view and projection matrices.

    Attributes
    ----------
    view : (4, 4) float64
        World to view, row vectors.
    projection : (4, 4) float64
        View to clip.
    eye : (4,) float64
        Homogeneous: (position, 1), or (unit direction towards the eye, 0) if orthographic.
    """

    view: Array
    projection: Array
    eye: Array

    @property
    def rotation(self) -> Array:
        """Rotation from world to view, (3, 3), row vectors."""
        return self.view[:3, :3]

    @property
    def world_to_clip(self) -> Array:
        """Matrix from world to clip space, (4, 4), row vectors."""
        return self.view @ self.projection


def view_rotation(settings: CameraSettings) -> Array:
    """Return the rotation from world to view, (3, 3), row vectors: its columns are right, up and back."""
    azimuth, elevation, roll = np.radians([settings.azimuth_deg, settings.elevation_deg, settings.roll_deg])
    back = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])
    # The derivative of `back` by elevation: never parallel to it, where a fixed up vector would be at the poles.
    upright = np.array([-np.sin(azimuth) * np.sin(elevation), np.cos(elevation), -np.cos(azimuth) * np.sin(elevation)])
    across = np.cross(upright, back)
    up, right = np.cos(roll) * upright + np.sin(roll) * across, np.cos(roll) * across - np.sin(roll) * upright
    return np.stack([right, up, back], axis=1)


def place_camera(settings: CameraSettings, radius: float, image_size: tuple[int, int]) -> Camera:
    """Return the camera that at zoom 1 fills the narrower image side with the sphere of `radius` mm about the target.

    No zoom counts as 1, and no target as the model's centre; `framed` finds those of a silhouette.
    """
    rotation, target = view_rotation(settings), np.array(settings.target_mm or CENTRE, np.float64)
    up, back, zoom = rotation[:, 1], rotation[:, 2], settings.zoom or 1.0
    aspect = image_size[0] / image_size[1]
    half_angle = 0.5 * np.radians(settings.view_angle_deg)
    narrow = np.arctan(np.tan(half_angle) * min(1.0, aspect))
    distance = radius / np.sin(narrow)
    eye = target + distance * back
    view = matrix44.create_look_at(eye, target, up, dtype=np.float64)
    centre_depth = -float(view[3, 2])  # of the object's centre, the origin
    near = max(centre_depth - 1.01 * radius, 1e-3 * distance)
    far = max(centre_depth + 1.01 * radius, 2.0 * near)
    if settings.orthographic:
        height = radius / min(1.0, aspect) / zoom
        projection = matrix44.create_orthogonal_projection(
            -height * aspect,
            height * aspect,
            -height,
            height,
            centre_depth - 1.01 * radius,
            far,
            dtype=np.float64,
        )
        return Camera(view, projection, np.array([*back, 0.0]))
    # Zoom is a longer lens: the eye stays, so that perspective and layers do too.
    height = near * np.tan(half_angle) / zoom
    projection = matrix44.create_perspective_projection_from_bounds(
        -height * aspect, height * aspect, -height, height, near, far, dtype=np.float64
    )
    return Camera(view, projection, np.array([*eye, 1.0]))


def framed(settings: CameraSettings, mesh: "Mesh", image_size: tuple[int, int]) -> CameraSettings:
    """Return the camera with a zoom and a target: those given, else those by which the silhouette fills the picture.

    Without a zoom, the box of the projected vertices takes `FILL` of the side that it meets first; without a target
    either, it stands in the middle. The eye keeps its distance, so that perspective is that of any zoom.
    """
    target = settings.target_mm or CENTRE
    if settings.zoom is not None:
        return replace(settings, target_mm=target)
    camera = place_camera(replace(settings, target_mm=target), mesh.radius, image_size)
    places = mesh.vertices.astype(np.float64) @ camera.rotation + camera.view[3, :3]
    if settings.orthographic:
        depth = np.ones(len(places))
    else:
        places = places[places[:, 2] < 0.0]  # before the eye, which a target of one's own may have moved into the model
        depth = -places[:, 2]
    if not len(places):
        return replace(settings, zoom=1.0, target_mm=target)
    across = places[:, :2]
    if settings.target_mm is None:
        shift = np.array([_middle(across[:, i], depth) for i in (0, 1)])
        across = across - shift
        x, y, z = (np.array(target) + camera.rotation[:, :2] @ shift).tolist()
        target = (x, y, z)
    reach = np.abs(across / depth[:, None]).max(axis=0) * camera.projection[(0, 1), (0, 1)]
    return replace(settings, zoom=float(np.clip(FILL / max(reach.max(), 1e-9), 0.01, 100.0)), target_mm=target)


def model_camera(settings: CameraSettings, mesh: "Mesh", image_size: tuple[int, int]) -> Camera:
    """Return the camera of a scene in front of its model."""
    return place_camera(framed(settings, mesh, image_size), mesh.radius, image_size)


def _middle(across: Array, depth: Array) -> float:
    """Return the shift t of the camera for which (across - t) / depth reach as far to one side as to the other."""
    shift = 0.0
    for _ in range(16):  # Newton's method, of a function of straight pieces
        slopes = (across - shift) / depth
        last, first = int(slopes.argmax()), int(slopes.argmin())
        step = (slopes[last] + slopes[first]) / (1.0 / depth[last] + 1.0 / depth[first])
        if abs(step) <= 1e-12 * (depth[last] + abs(shift)):
            break
        shift += float(step)
    return shift


def jittered(camera: Camera, offset: Offset, image_size: tuple[int, int]) -> Array:
    """Return the matrix from world to clip with the image moved by `offset` pixels: samples off the pixels' centres."""
    shift = np.eye(4)
    shift[3, :2] = 2.0 * np.asarray(offset) / np.asarray(image_size)
    return camera.world_to_clip @ shift


def pixel_offsets(samples: int, seed: int = 0) -> tuple[Offset, ...]:
    """Return offsets from a pixel's centre in [-1/2, 1/2): one sample sits in the centre, more follow an R2 sequence.

    R2 (Roberts 2018) is the two-dimensional golden ratio: any number of samples covers the pixel evenly. `seed`
    rotates the pattern.
    """
    if samples == 1:
        return ((0.0, 0.0),)
    shift = np.random.default_rng(seed).random(2)
    return _sequence(shift, np.arange(1, samples + 1))


def further_offsets(offset: Offset, samples: int, count: int) -> tuple[Offset, ...]:
    """Return `count` offsets at which the sequence goes on from one of `samples`, the others' places left out."""
    return _sequence(np.asarray(offset) + 0.5, samples * np.arange(1, count + 1))


def _sequence(start: Array, numbers: Ints) -> tuple[Offset, ...]:
    return tuple((float(x), float(y)) for x, y in (start + RATIO * numbers[:, None]) % 1.0 - 0.5)
