"""What the tests of whole frames share: renderers of given meshes, scenes, masks, errors, oracles."""

from dataclasses import replace

import moderngl
import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_erosion

from milkglass.core.arrays import Array
from milkglass.core.geometry.mesh import Mesh, face_cross
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.reference.equation import Occluder
from milkglass.viewer.error.visible import VisiblePoints
from milkglass.viewer.gl.buffers import MeshBuffers
from milkglass.viewer.render.lit_scene import Model
from milkglass.viewer.render.picture import Frame
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.lights import DirectionalLight, Light
from milkglass.viewer.scene.scene import Scene, apply_set

FRONT, BACK = (0.3, 0.4, 1.0), (-0.3, 0.2, -1.0)  # towards the light; the cameras stand near +z
OUTLIERS = 0.0025  # share of the pixels that may differ, as GPUs do at edges


class MeshRenderer(Renderer):
    """Renders one mesh, whatever model a scene names."""

    def __init__(self, context: moderngl.Context, mesh: Mesh) -> None:
        super().__init__(context)
        self.model = Model(mesh, MeshBuffers(context, mesh), ())
        self._lighting._load = lambda settings: self.model


METHODS = {
    "layered": ["transport.method=layered", "transport.layers=8", "transport.resolution=64"],
    "ewald": ["transport.method=ewald", "transport.resolution=40"],
}


def scene_of(
    *assignments: str,
    method: str = "layered",
    lights: tuple[Light, ...] | None = (DirectionalLight(FRONT),),
) -> Scene:
    """A small scene; `assignments` as of ``--set``."""
    small = [
        "display.image_size=[128, 128]",
        "camera.azimuth_deg=20",
        "camera.zoom=1",
        "display.key=0.18",
        "display.transform=photographic",
    ]
    return replace(apply_set(Scene(), [*small, *METHODS[method], *assignments]), lights=lights)


def inside(frame: Frame, by: int = 2) -> npt.NDArray[np.bool_]:
    """Pixels that the object covers wholly, with a margin."""
    return np.asarray(binary_erosion(frame.alpha == 1.0, iterations=by))


def outliers(actual: npt.ArrayLike, expected: npt.ArrayLike, rtol: float, atol: float = 0.0) -> float:
    """Share of the rows with a value that differs by more than rtol of it plus atol."""
    close = np.isclose(actual, expected, rtol=rtol, atol=atol)
    return float(1.0 - close.reshape(len(close), -1).all(axis=1).mean())


def relative_rms(actual: npt.ArrayLike, expected: npt.ArrayLike) -> Array:
    """Rms of the difference over rms of the expected, per channel."""
    actual, expected = np.asarray(actual, np.float64), np.asarray(expected, np.float64)
    return np.sqrt(np.square(actual - expected).mean(axis=0) / np.square(expected).mean(axis=0))


def random_samples(mesh: Mesh, count: int, seed: int = 0) -> tuple[SurfaceSamples, Array]:
    """Area-uniform random points with interpolated normals, and the normals (count, 3) of their faces."""
    rng = np.random.default_rng(seed)
    cross = face_cross(mesh.vertices, mesh.faces)
    area = np.linalg.norm(cross, axis=1)
    face = rng.choice(len(area), count, p=area / area.sum())
    u, v = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    weights = np.stack([1.0 - u, u * (1.0 - v), u * v], axis=1)
    corners = mesh.faces[face]
    normals = (weights * mesh.normals[corners]).sum(axis=1)
    samples = SurfaceSamples(
        points=(weights * mesh.vertices[corners]).sum(axis=1).astype(np.float32),
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        areas=np.full(count, mesh.area / count, np.float32),
    )
    return samples, cross[face] / area[face, None]


def surface_points(mesh: Mesh, count: int, seed: int = 0) -> Array:
    """Random points on faces chosen alike, (count, 3)."""
    rng = np.random.default_rng(seed)
    faces = mesh.faces[rng.choice(len(mesh.faces), count)]
    return np.einsum("ni,nij->nj", rng.dirichlet((1, 1, 1), count), mesh.vertices[faces].astype(np.float64))


def seen_at(points: Array) -> VisiblePoints:
    """Points as a picture that is black there would show them."""
    place = np.arange(len(points))
    return VisiblePoints(place, place, points, np.zeros_like(points))


class RayCaster:
    """Irradiance by rays against a mesh, for every kind of lamp."""

    def __init__(self, mesh: Mesh) -> None:
        self._occluder = Occluder(mesh)

    def irradiance(self, points, normals, face_normals, light: Light, eta: float) -> Array:
        """E that enters at points (n, 3), (2): (n, 3) float64."""
        where = points, normals, face_normals
        if isinstance(light, DirectionalLight):
            return self._occluder.irradiance(*where, light.direction, light.irradiance, eta)
        return self._occluder.point_irradiance(*where, light.position_mm, light.intensity, eta)
