"""The camera: matrices from a scene's orbit angles.

Matrices are pyrr's, for row vectors: (x, y, z, 1) @ M, translation in row 3. Their memory is what OpenGL reads
column by column, so that GLSL writes M * v. View space is right-handed, looks along -z, y up.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pyrr import matrix33, matrix44

from milkglass.core.arrays import Array
from milkglass.viewer.scene.settings import CameraSettings


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


def place_camera(settings: CameraSettings, radius: float, image_size: tuple[int, int]) -> Camera:
    """Place the camera so that at zoom 1 the sphere of `radius` mm about the target fills the narrower image side."""
    azimuth, elevation, roll = np.radians([settings.azimuth_deg, settings.elevation_deg, settings.roll_deg])
    target = np.array(settings.target_mm, np.float64)
    back = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])
    # The derivative of `back` by elevation: never parallel to it, where a fixed up vector would be at the poles.
    upright = np.array([-np.sin(azimuth) * np.sin(elevation), np.cos(elevation), -np.cos(azimuth) * np.sin(elevation)])
    up = np.cos(roll) * upright + np.sin(roll) * np.cross(upright, back)
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
        height = radius / min(1.0, aspect) / settings.zoom
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
    height = near * np.tan(half_angle) / settings.zoom
    projection = matrix44.create_perspective_projection_from_bounds(
        -height * aspect, height * aspect, -height, height, near, far, dtype=np.float64
    )
    return Camera(view, projection, np.array([*eye, 1.0]))


def jittered(camera: Camera, offset: tuple[float, float], image_size: tuple[int, int]) -> Array:
    """Return the matrix from world to clip with the image moved by `offset` pixels: samples off the pixels' centres."""
    shift = np.eye(4)
    shift[3, :2] = 2.0 * np.asarray(offset) / np.asarray(image_size)
    return camera.world_to_clip @ shift


def pixel_offsets(samples: int, seed: int = 0) -> tuple[tuple[float, float], ...]:
    """Return offsets from a pixel's centre in [-1/2, 1/2): one sample sits in the centre, more follow an R2 sequence.

    R2 (Roberts 2018) is the two-dimensional golden ratio: any number of samples covers the pixel evenly. `seed`
    rotates the pattern.
    """
    if samples == 1:
        return ((0.0, 0.0),)
    ratio = np.array([0.7548776662466927, 0.5698402909980532])
    shift = np.random.default_rng(seed).random(2)
    pattern = (shift + ratio * np.arange(1, samples + 1)[:, None]) % 1.0 - 0.5
    return tuple((float(x), float(y)) for x, y in pattern)
