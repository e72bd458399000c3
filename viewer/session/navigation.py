"""Camera and lights moved by the mouse: scenes in, scenes out."""

from dataclasses import replace

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.stages import Part
from milkglass.viewer.scene.camera import CENTRE, view_rotation
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import CameraSettings

DEGREES_A_PIXEL = 0.35  # of drag at 1000 pixels of view height: three quarters of a turn across the view
ZOOM_A_NOTCH = 1.12  # factor
TARGET_RANGE = 1e6  # mm, range of camera.target_mm


def orbited(camera: CameraSettings, dx: float, dy: float, height: float) -> CameraSettings:
    """Return the camera turned about its target by a drag of (dx, dy) pixels in a view of `height` pixels."""
    step = DEGREES_A_PIXEL * 1000.0 / max(height, 1.0)
    elevation = min(90.0, max(-90.0, camera.elevation_deg + step * dy))
    return replace(camera, azimuth_deg=wrapped(camera.azimuth_deg - step * dx), elevation_deg=elevation)


def panned(camera: CameraSettings, radius: float, dx: float, dy: float, size: tuple[int, int]) -> CameraSettings:
    """Return the camera panned so that the point under the pointer, at the target's depth, stays under it."""
    rotation = view_rotation(camera)
    step = pixel_size(camera, radius, size)
    target = np.array(camera.target_mm or CENTRE) - step * (dx * rotation[:, 0] - dy * rotation[:, 1])
    x, y, z = np.clip(target, -TARGET_RANGE, TARGET_RANGE).tolist()
    return replace(camera, target_mm=(x, y, z))


def pixel_size(camera: CameraSettings, radius: float, size: tuple[int, int]) -> float:
    """Return the size of a pixel at the target's depth, mm."""
    narrow = min(1.0, size[0] / size[1])
    half = np.radians(0.5 * camera.view_angle_deg)
    if camera.orthographic:
        half_height = radius / narrow
    else:  # the distance that `place_camera` chooses
        half_height = np.tan(half) * radius / np.sin(np.arctan(np.tan(half) * narrow))
    return float(2.0 * half_height / (camera.zoom or 1.0) / size[1])


def zoomed(camera: CameraSettings, notches: float) -> CameraSettings:
    """Return the camera zoomed in by notches of the wheel; one that has no zoom yet stays."""
    if camera.zoom is None:
        return camera
    return replace(camera, zoom=min(100.0, max(0.01, camera.zoom * ZOOM_A_NOTCH**notches)))


def seen_from(camera: CameraSettings, azimuth_deg: float, elevation_deg: float) -> CameraSettings:
    """Return the camera at an azimuth and an elevation, upright."""
    return replace(camera, azimuth_deg=azimuth_deg, elevation_deg=elevation_deg, roll_deg=0.0)


def following(before: Scene, after: Scene) -> Scene:
    """Return a changed scene with the camera kept on its model, unless the change moved the camera itself.

    A larger model is seen as the smaller one was; another one, or one that stands another way, is framed.
    """
    if after.camera != before.camera or after.moving(Part.SHAPE) == before.moving(Part.SHAPE):
        return after
    camera, zoom, target = before.camera, None, None
    if replace(before.model, size_mm=after.model.size_mm) == after.model:
        zoom = camera.zoom
        if camera.target_mm is not None:
            sizes = after.model.size_mm, before.model.size_mm
            if isinstance(sizes[0], str) or isinstance(sizes[1], str):
                return replace(after, camera=replace(camera, zoom=None, target_mm=None))
            x, y, z = (np.array(camera.target_mm) * (sizes[0] / sizes[1])).tolist()
            target = (x, y, z)
    return replace(after, camera=replace(camera, zoom=zoom, target_mm=target))


def lights_turned(scene: Scene, dx: float, dy: float, height: float) -> Scene:
    """Return the scene with lights and probe turned by a drag.

    Both turn about the up axis, the lights about the horizontal axis of the view too.
    """
    step = DEGREES_A_PIXEL * 1000.0 / max(height, 1.0)
    about_up = turn_matrix(np.array([0.0, 1.0, 0.0]), step * dx)
    rotation = view_rotation(scene.camera)
    turn = about_up @ turn_matrix(rotation[:, 0], step * dy)
    lights = scene.all_lights()
    if lights:
        of_camera = rotation.T @ turn @ rotation  # the same, of vectors in its axes
        turns = {"world": turn, "camera": of_camera}
        scene = replace(scene, lights=tuple(light.turned(turns[light.fixed_to]) for light in lights))
    if scene.environment.given:
        degrees = wrapped(scene.environment.rotation_deg + step * dx)
        scene = replace(scene, environment=replace(scene.environment, rotation_deg=degrees))
    return scene


def turn_matrix(axis: Array, degrees: float) -> Array:
    """Return the matrix (3, 3) that turns row vectors, v @ M, about a unit axis, right-handed (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.radians(degrees)
    turn = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return np.asarray(turn.T)


def direction_angles(direction: tuple[float, float, float]) -> tuple[float, float]:
    """Return azimuth and elevation of a direction, degrees, counted as the camera's."""
    x, y, z = direction
    return float(np.degrees(np.arctan2(x, z))), float(np.degrees(np.arctan2(y, np.hypot(x, z))))


def direction_of(azimuth_deg: float, elevation_deg: float) -> tuple[float, float, float]:
    """Return the unit direction of an azimuth and elevation; the inverse of `direction_angles`."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    x, y, z = np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)
    return float(x), float(y), float(z)


def wrapped(degrees: float) -> float:
    """Return an angle, degrees, in [-180, 180)."""
    return (degrees + 180.0) % 360.0 - 180.0
