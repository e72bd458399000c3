"""Error of the whole renderer against equation (1): model file, shadow maps, transport, gather, every pass."""

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

IMAGE = 512
EDGE_PIXELS = 2  # left out along outlines, where a pixel's mean position is no surface point


@dataclass(frozen=True)
class ChainRow:
    """One picture compared with the reference at random pixels."""

    scheme: Scheme
    shape: str
    material: str
    light: str
    deviation: Deviation


def chain_rows(
    schemes: Sequence[Scheme], cases: Sequence[tuple[str, str, str]], n_points: int, seed: int = 0
) -> Iterator[ChainRow]:
    """Render each case (shape, material, light) by each scheme; rows come as they are ready."""
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
                if pixels is None:  # the first picture chooses them; all show the same surface
                    pixels = _pixels(frame, n_points, seed)
                    reference = _reference(mesh, frame.position[pixels], material, light)
                assert reference is not None
                deviation = Deviation.of(frame.exitance[pixels], reference)
                yield ChainRow(scheme, shape, material, light, deviation)


def _scene(path: Path, mesh: Mesh, material: str, light: str, scheme: Scheme) -> Scene:
    lamp = LIGHTS[light]
    assert isinstance(lamp, Directional)  # pictures know no slats, and probes come from files
    assert lamp.stripe == 0.0
    return Scene(
        model=ModelSettings(path=path, size_mm=float(np.ptp(mesh.bounds, axis=0).max())),
        camera=replace(CAMERA, orthographic=False),
        material=MaterialSettings(name=material),
        lights=(DirectionalLight(lamp.direction, (1.0, 1.0, 1.0)),),
        transport=scheme.settings,
        display=DisplaySettings(image_size=(IMAGE, IMAGE)),
    )


def _pixels(frame: Frame, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of n random pixels inside the outline."""
    inside = np.argwhere(binary_erosion(frame.alpha > 0.0, iterations=EDGE_PIXELS))
    chosen = np.random.default_rng(seed).choice(len(inside), n, replace=False)
    return inside[chosen, 0], inside[chosen, 1]


def _reference(mesh: Mesh, points: np.ndarray, material: str, light: str) -> np.ndarray:
    found = graded_exitance(mesh, points, [LIGHTS[light]], [materials.lookup(material)])
    return np.asarray(found[0, 0])
