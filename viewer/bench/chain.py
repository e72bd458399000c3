"""Error of the whole renderer relative to (1): model file, shadow maps, transport, gather and all passes."""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from scipy.ndimage import binary_erosion

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.material import library as materials
from milkglass.core.reference.deviation import Deviation
from milkglass.viewer.bench.error import CAMERA
from milkglass.viewer.bench.lights import LIGHTS, Directional
from milkglass.viewer.bench.reference import graded_exitance
from milkglass.viewer.bench.schemes import Scheme
from milkglass.viewer.bench.shapes import SHAPES
from milkglass.viewer.gl.context import headless_context
from milkglass.viewer.render.picture import Frame
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.lights import DirectionalLight
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import DisplaySettings, MaterialSettings, ModelSettings

IMAGE_SIDE = 512
EDGE_PIXELS = 2  # excluded along outlines, where the mean position of a pixel is not on the surface


@dataclass(frozen=True)
class ChainRow:
    """Deviation of one picture from the reference at random pixels."""

    scheme: Scheme
    shape: str
    material: str
    light: str
    deviation: Deviation


def chain_rows(
    schemes: Sequence[Scheme], cases: Sequence[tuple[str, str, str]], n_points: int, seed: int = 0
) -> Iterator[ChainRow]:
    """Yield a row for each case (shape, material, light) and scheme, as rendered."""
    renderer = Renderer(headless_context())
    with tempfile.TemporaryDirectory() as folder:
        for shape, material, light in cases:
            mesh = SHAPES[shape]()
            path = Path(folder) / f"{shape}.ply"
            corners = {"vertex_normals": mesh.normals, "process": False}
            trimesh.Trimesh(mesh.vertices, mesh.faces, **corners).export(path)
            pixels = reference = None
            for scheme in schemes:
                frame = renderer.render(_scene(path, mesh, material, light, scheme), samples=1)
                if pixels is None:  # chosen on the first picture: all show the same surface
                    pixels = _pixels(frame, n_points, seed)
                    reference = _reference(mesh, frame.position[pixels], material, light)
                assert reference is not None
                deviation = Deviation.of(frame.exitance[pixels], reference)
                yield ChainRow(scheme, shape, material, light, deviation)


def _scene(path: Path, mesh: Mesh, material: str, light: str, scheme: Scheme) -> Scene:
    lamp = LIGHTS[light]
    assert isinstance(lamp, Directional)  # scenes have no slats, and their probes are files
    assert lamp.stripe == 0.0
    return Scene(
        model=ModelSettings(path=path, size_mm=float(np.ptp(mesh.bounds, axis=0).max())),
        camera=replace(CAMERA, orthographic=False),
        material=MaterialSettings(name=material),
        lights=(DirectionalLight(lamp.direction, (1.0, 1.0, 1.0)),),
        transport=scheme.settings,
        display=DisplaySettings(image_size=(IMAGE_SIDE, IMAGE_SIDE)),
    )


def _pixels(frame: Frame, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows and columns of n random pixels inside the outline."""
    inside = np.argwhere(binary_erosion(frame.alpha > 0.0, iterations=EDGE_PIXELS))
    chosen = np.random.default_rng(seed).choice(len(inside), n, replace=False)
    return inside[chosen, 0], inside[chosen, 1]


def _reference(mesh: Mesh, points: np.ndarray, material: str, light: str) -> np.ndarray:
    exitance = graded_exitance(mesh, points, [LIGHTS[light]], [materials.lookup(material)])
    return np.asarray(exitance[0, 0])
