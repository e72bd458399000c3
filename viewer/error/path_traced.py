"""Comparison of a picture with path tracing by Mitsuba 3: `milkglass render --path-traced FILE.exr`.

Mesh, camera and material are the same: a homogeneous, isotropically scattering medium of the reduced coefficients,
behind a smooth dielectric boundary. Paths from the eye can hit a light through such a boundary only if it has
a size, so directional lights are discs of `HALF_ANGLE_DEG` degrees about their direction. Faces are flat, as
for photons. Light that never scatters (highlights, light straight through) is traced separately; pixels with any of it
are excluded.

What remains even of an exact exitance M:

* `ewald` and `layered` have (7), L = F_t M / pi, whose flux is M times the mean F_t of diffuse light, 0.94 for
  eta = 1.3 and 0.91 for 1.5, while all of M leaves in traced paths.
* Light that has left, or was reflected, meets concave objects again, in traced paths alone: in bright hollows pictures
  and photons have half of the light or less. On convex objects transport alone is compared.
"""

import importlib.util
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation, binary_erosion

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.transport.diffusion.boundary import is_closed, row_sums
from milkglass.viewer.files.images import check_output, write_exr
from milkglass.viewer.gl.context import headless_context
from milkglass.viewer.render.picture import Frame
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.camera import place_camera
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.scene import Scene

HALF_ANGLE_DEG = 6.0  # of the disc of a light: smaller discs are noisier
DISC_DISTANCE = 50.0  # of the discs, in radii of the object
BLOCKS_ACROSS = 12  # along the shorter side: means over blocks are compared, since single pixels are too noisy
EDGE_PIXELS = 2  # excluded along outlines
VARIANT = "scalar_rgb"  # needs no GPU and no LLVM


@dataclass(frozen=True)
class PathTracedComparison:
    """Subsurface radiance of a picture relative to that of traced paths, R, G and B.

    Attributes
    ----------
    ratio : (3,) tuple
        Mean over mean.
    rms : (3,) tuple
        Root mean square difference of blocks of pixels over the traced rms, with the variance of the paths subtracted.
    noise : (3,) tuple
        Standard error of the blocks by that variance, over the same.
    """

    ratio: tuple[float, ...]
    rms: tuple[float, ...]
    noise: tuple[float, ...]

    def __str__(self) -> str:
        rms, noise = (", ".join(f"{100.0 * value:.1f}" for value in values) for values in (self.rms, self.noise))
        ratio = ", ".join(f"{value:.3f}" for value in self.ratio)
        return f"Subsurface light against traced paths: rms {rms} % (noise {noise} %), mean ratio {ratio} (R, G, B)."


def check(scene: Scene, path: Path, outputs: Sequence[str]) -> None:
    """Raise InputError for a scene that cannot be traced or a file that cannot be written, before any work.

    Raises
    ------
    InputError
        Without Mitsuba, for a path that is not .exr or that is an output, and for lights that are not directional.
    """
    check_output(path, (".exr",))
    if any(os.path.realpath(output) == os.path.realpath(path) for output in outputs):
        raise InputError(f"--path-traced {path} would write over --output; choose another name")
    if scene.environment.given or not scene.effective_lights():
        raise InputError("--path-traced knows directional lights only; give the scene one, and no environment")
    for light in scene.effective_lights():
        if not light.DISTANT:
            raise InputError(f"--path-traced knows directional lights only; remove the {light.KIND} lights")
        if not light.is_sharp:
            raise InputError("--path-traced knows sharp lights only; set angle_deg of the directional ones to 0")
    if scene.camera.orthographic:
        raise InputError("--path-traced knows perspective cameras only; leave out --orthographic")
    if importlib.util.find_spec("mitsuba") is None:
        raise InputError('--path-traced needs Mitsuba 3: pip install "milkglass[mitsuba]"')


def run(scene: Scene, path: Path, paths: int, seed: int = 0) -> PathTracedComparison:
    """Render a scene and return its comparison with traced paths; see `trace`."""
    renderer = Renderer(headless_context())
    lit = renderer.light(scene)
    if lit.detail is not None:
        off = "--set detail.albedo=off --set detail.normal_strength=0"
        raise InputError(f"--path-traced does not know the colours and relief of a surface; add {off}")
    mesh = lit.model.mesh
    if not is_closed(row_sums(mesh)):
        raise InputError("--path-traced needs a closed mesh that is wound outwards")
    return trace(scene, mesh, renderer.render(scene, seed=seed), path, paths, seed)


def trace(scene: Scene, mesh: Mesh, frame: Frame, path: Path, paths: int, seed: int = 0) -> PathTracedComparison:
    """Trace a picture, write it and the difference (layer `difference`), and return the comparison.

    Parameters
    ----------
    scene : Scene
        With a perspective camera and directional lights only.
    mesh : Mesh
        Closed.
    frame : Frame
        Picture of the scene.
    path : Path
        EXR file of the traced radiance.
    paths : int
        Number of paths a pixel, >= 2.
    seed : int
    """
    material = scene.material.resolve()
    albedo, sigma_t = material.alpha_prime, material.sigma_t_prime
    # Two independent halves, whose difference estimates the noise.
    halves = np.stack([_traced(scene, mesh, albedo, sigma_t, paths // 2, 2 * seed + i) for i in range(2)])
    unscattered = _traced(scene, mesh, np.zeros(3), sigma_t, max(16, paths // 16), 2 * seed)
    traced = halves.mean(axis=0)
    difference = frame.subsurface - traced
    layers = {"": traced, "difference.": difference}
    write_exr(
        path, {f"{n}{c}": layer[..., i].astype(np.float32) for n, layer in layers.items() for i, c in enumerate("RGB")}
    )
    inside = binary_erosion(frame.alpha == 1.0, iterations=EDGE_PIXELS)
    return compare(frame.subsurface, halves, inside & ~binary_dilation(unscattered.any(axis=-1)))


def compare(picture: npt.ArrayLike, halves: Array, used: npt.NDArray[np.bool_]) -> PathTracedComparison:
    """Return the comparison of a picture (h, w, 3) with two estimates (2, h, w, 3) in the pixels `used`, (h, w)."""
    radiance = np.asarray(picture, np.float64)
    first, second, picture_means = (_block_means(image, used) for image in (*halves, radiance))
    traced = 0.5 * (first + second)
    noise2 = 0.25 * np.mean((first - second) ** 2, axis=0)
    traced_rms = np.sqrt(np.maximum(np.mean(traced**2, axis=0) - noise2, np.finfo(np.float64).tiny))
    rms2 = np.mean((picture_means - traced) ** 2, axis=0) - noise2
    ratio = radiance[used].sum(axis=0) / np.maximum(halves.mean(axis=0)[used].sum(axis=0), np.finfo(np.float64).tiny)
    values = ratio, np.sqrt(np.maximum(rms2, 0.0)) / traced_rms, np.sqrt(noise2) / traced_rms
    return PathTracedComparison(*(tuple(value.tolist()) for value in values))


def _block_means(image: npt.NDArray[np.floating], used: npt.NDArray[np.bool_]) -> Array:
    """Return means over the blocks at least half of whose pixels are used, (n, 3)."""
    side = max(1, min(used.shape) // BLOCKS_ACROSS)
    h, w = (n // side for n in used.shape)
    covered = slice(h * side), slice(w * side)
    count = used[covered].reshape(h, side, w, side).sum(axis=(1, 3))
    sums = (image * used[..., None])[covered].reshape(h, side, w, side, 3).sum(axis=(1, 3))
    used_blocks = 2 * count >= side * side
    if not used_blocks.any():
        raise InputError("the picture shows too little of the object to compare; enlarge it")
    return np.asarray(sums[used_blocks] / count[used_blocks][:, None], np.float64)


def _traced(scene: Scene, mesh: Mesh, albedo: Array, sigma_t: Array, paths: int, seed: int) -> Array:
    """Return traced radiance, (h, w, 3) float64, without that of the lights themselves."""
    import mitsuba as mi

    mi.set_variant(VARIANT)
    image = mi.render(mi.load_dict(_description(mi, scene, mesh, albedo, sigma_t)), spp=max(paths, 1), seed=seed)
    return np.asarray(image, np.float64)[..., :3]


def _description(mi: Any, scene: Scene, mesh: Mesh, albedo: Array, sigma_t: Array) -> dict[str, Any]:
    width, height = scene.display.image_size
    camera = place_camera(scene.camera, mesh.radius, (width, height))
    eye, rotation = camera.eye[:3], camera.rotation  # columns: right, up and back
    half = np.tan(0.5 * np.radians(scene.camera.view_angle_deg)) / scene.camera.zoom
    look = mi.ScalarTransform4f().look_at(
        origin=eye.tolist(), target=(eye - rotation[:, 2]).tolist(), up=rotation[:, 1].tolist()
    )
    film = {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    sensor = {"type": "perspective", "to_world": look, "film": film, "sampler": {"type": "independent"}}
    sensor |= {"fov_axis": "y", "fov": float(2.0 * np.degrees(np.arctan(half))), "near_clip": 1e-3 * mesh.radius}
    discs = {f"sun {i}": _disc(mi, light, mesh.radius) for i, light in enumerate(scene.effective_lights())}
    return {
        "type": "scene",
        "integrator": {"type": "volpathmis", "max_depth": -1, "rr_depth": 64, "hide_emitters": True},
        "sensor": sensor,
        "object": _object(mi, mesh, albedo, sigma_t, scene.material.resolve().eta),
        **discs,
    }


def _disc(mi: Any, light: Light, radius: float) -> dict[str, Any]:
    """Return a distant disc of constant radiance with the irradiance of a directional light."""
    towards = np.asarray(light.vector, np.float64) / np.linalg.norm(light.vector)
    up = np.eye(3)[np.abs(towards).argmin()]
    distance, angle = DISC_DISTANCE * radius, np.radians(HALF_ANGLE_DEG)
    to_world = mi.ScalarTransform4f().look_at(origin=(distance * towards).tolist(), target=[0, 0, 0], up=up.tolist())
    radiance = np.asarray(light.brightness) / (np.pi * np.sin(angle) ** 2)
    emitter = {"type": "area", "radiance": {"type": "rgb", "value": radiance.tolist()}}
    return {
        "type": "disk",
        "to_world": to_world @ mi.ScalarTransform4f().scale(float(distance * np.tan(angle))),
        "emitter": emitter,
    }


def _object(mi: Any, mesh: Mesh, albedo: Array, sigma_t: Array, eta: float) -> Any:
    properties = mi.Properties()
    properties["face_normals"] = True
    properties["bsdf"] = mi.load_dict({"type": "dielectric", "int_ior": eta, "ext_ior": 1.0})
    scale = float(sigma_t.max()) or 1.0  # colours are not above 1
    colours = {"albedo": albedo, "sigma_t": sigma_t / scale}
    properties["interior"] = mi.load_dict(
        {
            "type": "homogeneous",
            "phase": {"type": "isotropic"},
            "scale": scale,
            **{name: {"type": "rgb", "value": value.tolist()} for name, value in colours.items()},
        }
    )
    shape = mi.Mesh("object", len(mesh.vertices), len(mesh.faces), props=properties)
    arrays = mi.traverse(shape)
    arrays["vertex_positions"] = np.ascontiguousarray(mesh.vertices, np.float32).ravel()
    arrays["faces"] = np.ascontiguousarray(mesh.faces, np.uint32).ravel()
    arrays.update()
    return shape
