"""A picture beside one that Mitsuba 3 traces paths for: `milkglass render --path-traced FILE.exr`.

The same mesh, camera and material: a homogeneous medium of the reduced coefficients that scatters into all directions
alike, behind a smooth dielectric boundary. Paths from the eye can hit a light through such a boundary only if it has
a size, so directional lights are discs of `SUN` degrees about their direction. Faces are flat, as photons have them.
What never scattered (highlights, light straight through) is traced once more without scattering; pixels that have any
are left out.

What remains even of an exact exitance M:

* Pictures have (7), L = F_t M / pi, whose flux is M times the mean F_t of diffuse light, 0.94 for eta = 1.3 and 0.91
  for 1.5, while all of M leaves in traced paths.
* Light that has left, or was reflected, meets concave objects again. Pictures and photons know nothing of it, so that
  in bright hollows they show half of the light or less. Convex objects compare transport alone.
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

SUN = 6.0  # degrees, half the angle of a light's disc: smaller is noisier
FAR = 50.0  # radii of the object, to the discs
BLOCKS = 12  # along the shorter side of the picture, whose means are compared: single pixels are too noisy
EDGE_PIXELS = 2  # left out along outlines
VARIANT = "scalar_rgb"  # needs no GPU and no LLVM


@dataclass(frozen=True)
class Comparison:
    """Subsurface radiance of a picture over that of traced paths, R, G and B.

    Attributes
    ----------
    ratio : mean over mean
    rms : of blocks of pixels, over the traced rms; the noise of the paths taken off
    noise : that noise, in the same unit
    """

    ratio: tuple[float, ...]
    rms: tuple[float, ...]
    noise: tuple[float, ...]

    def __str__(self) -> str:
        rms, noise = (", ".join(f"{100.0 * value:.1f}" for value in values) for values in (self.rms, self.noise))
        ratio = ", ".join(f"{value:.3f}" for value in self.ratio)
        return f"Subsurface light against traced paths: rms {rms} % (noise {noise} %), mean ratio {ratio} (R, G, B)."


def check(scene: Scene, path: Path, outputs: Sequence[str]) -> None:
    """Refuse what cannot be traced or written, before any work.

    Raises
    ------
    InputError
        Without Mitsuba, for a path that is no .exr or one of the outputs, and for what is no directional light.
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


def run(scene: Scene, path: Path, paths: int, seed: int = 0) -> Comparison:
    """Render a scene and trace it; see `trace`."""
    renderer = Renderer(headless_context())
    lit = renderer.light(scene)
    if lit.detail is not None:
        off = "--set detail.albedo=off --set detail.normal_strength=0"
        raise InputError(f"--path-traced does not know the colours and relief of a surface; add {off}")
    mesh = lit.model.mesh
    if not is_closed(row_sums(mesh)):
        raise InputError("--path-traced needs a closed mesh that is wound outwards")
    return trace(scene, mesh, renderer.render(scene, seed=seed), path, paths, seed)


def trace(scene: Scene, mesh: Mesh, frame: Frame, path: Path, paths: int, seed: int = 0) -> Comparison:
    """Trace a picture, write it with the difference (layer `difference`), and compare.

    Parameters
    ----------
    scene, mesh
        Perspective camera and directional lights only; a closed mesh.
    frame : Frame
        Of the same scene.
    path : where the traced radiance goes
    paths : int
        A pixel, >= 2.
    seed : int
    """
    material = scene.material.resolve()
    albedo, sigma_t = material.alpha_prime, material.sigma_t_prime
    # Two halves, whose difference is the noise.
    halves = np.stack([_traced(scene, mesh, albedo, sigma_t, paths // 2, 2 * seed + i) for i in range(2)])
    straight = _traced(scene, mesh, np.zeros(3), sigma_t, max(16, paths // 16), 2 * seed)
    traced = halves.mean(axis=0)
    difference = frame.subsurface - traced
    layers = {"": traced, "difference.": difference}
    write_exr(
        path, {f"{n}{c}": part[..., i].astype(np.float32) for n, part in layers.items() for i, c in enumerate("RGB")}
    )
    inside = binary_erosion(frame.alpha == 1.0, iterations=EDGE_PIXELS)
    return compare(frame.subsurface, halves, inside & ~binary_dilation(straight.any(axis=-1)))


def compare(picture: npt.ArrayLike, halves: Array, used: npt.NDArray[np.bool_]) -> Comparison:
    """Compare a picture (h, w, 3) with two independent estimates (2, h, w, 3) in the pixels `used`, (h, w)."""
    own = np.asarray(picture, np.float64)
    first, second, mine = (_block_means(image, used) for image in (*halves, own))
    traced = 0.5 * (first + second)
    noise2 = 0.25 * np.mean((first - second) ** 2, axis=0)
    size = np.sqrt(np.maximum(np.mean(traced**2, axis=0) - noise2, np.finfo(np.float64).tiny))
    rms2 = np.mean((mine - traced) ** 2, axis=0) - noise2
    ratio = own[used].sum(axis=0) / np.maximum(halves.mean(axis=0)[used].sum(axis=0), np.finfo(np.float64).tiny)
    values = ratio, np.sqrt(np.maximum(rms2, 0.0)) / size, np.sqrt(noise2) / size
    return Comparison(*(tuple(value.tolist()) for value in values))


def _block_means(image: npt.NDArray[np.floating], used: npt.NDArray[np.bool_]) -> Array:
    """Means over blocks with at least half of their pixels used, (n, 3)."""
    side = max(1, min(used.shape) // BLOCKS)
    h, w = (n // side for n in used.shape)
    cut = slice(h * side), slice(w * side)
    count = used[cut].reshape(h, side, w, side).sum(axis=(1, 3))
    sums = (image * used[..., None])[cut].reshape(h, side, w, side, 3).sum(axis=(1, 3))
    full = 2 * count >= side * side
    if not full.any():
        raise InputError("the picture shows too little of the object to compare; enlarge it")
    return np.asarray(sums[full] / count[full][:, None], np.float64)


def _traced(scene: Scene, mesh: Mesh, albedo: Array, sigma_t: Array, paths: int, seed: int) -> Array:
    """Radiance, (h, w, 3) float64, without the lights' own."""
    import mitsuba as mi

    mi.set_variant(VARIANT)
    found = mi.render(mi.load_dict(_description(mi, scene, mesh, albedo, sigma_t)), spp=max(paths, 1), seed=seed)
    return np.asarray(found, np.float64)[..., :3]


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
    suns = {f"sun {i}": _sun(mi, light, mesh.radius) for i, light in enumerate(scene.effective_lights())}
    return {
        "type": "scene",
        "integrator": {"type": "volpathmis", "max_depth": -1, "rr_depth": 64, "hide_emitters": True},
        "sensor": sensor,
        "object": _object(mi, mesh, albedo, sigma_t, scene.material.resolve().eta),
        **suns,
    }


def _sun(mi: Any, light: Light, radius: float) -> dict[str, Any]:
    """Return a disc of even radiance that gives the light's irradiance."""
    towards = np.asarray(light.vector, np.float64) / np.linalg.norm(light.vector)
    up = np.eye(3)[np.abs(towards).argmin()]
    distance, angle = FAR * radius, np.radians(SUN)
    place = mi.ScalarTransform4f().look_at(origin=(distance * towards).tolist(), target=[0, 0, 0], up=up.tolist())
    radiance = np.asarray(light.brightness) / (np.pi * np.sin(angle) ** 2)
    emitter = {"type": "area", "radiance": {"type": "rgb", "value": radiance.tolist()}}
    return {
        "type": "disk",
        "to_world": place @ mi.ScalarTransform4f().scale(float(distance * np.tan(angle))),
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
