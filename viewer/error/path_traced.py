"""Comparison of a picture with path tracing by Mitsuba 3: `milkglass render --path-traced FILE.exr`.

Mesh, camera and material are the same: a homogeneous, isotropically scattering medium of the reduced coefficients,
behind a smooth dielectric boundary (`viewer.error.mitsuba_paths`). The picture is drawn so too, without a material's
mean cosine: light that is scattered forward is scattered to a path, and seen straight through in a picture. Paths from
the eye can hit a light through such a boundary only if it has a size, so sharp lights are discs of `HALF_ANGLE_DEG`
degrees about their direction; wide ones and environments are what they are, and less noisy. Faces are flat, as for
photons. Light that never scatters (highlights, light straight through) and the object seen in its mirror are no
subsurface light, and not compared.

Traced paths know whether light has left the object and met it again. So they judge two pictures: all subsurface light,
and transport alone, drawn without light between parts, against paths that never met the object again.
"""

import importlib.util
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_erosion

from milkglass.core.arrays import Array
from milkglass.core.display import srgb
from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.probe import Probe
from milkglass.core.paths.surface import ClearPart, Surface
from milkglass.core.transport.diffusion.boundary import is_closed, row_sums
from milkglass.viewer.error import mitsuba_paths
from milkglass.viewer.error.map import written
from milkglass.viewer.error.mitsuba_paths import Lamp, Subject, Surrounding, View
from milkglass.viewer.files.images import Pixels8, check_output, write_exr, write_png
from milkglass.viewer.files.model import joined
from milkglass.viewer.gl.context import headless_context
from milkglass.viewer.render.picture import Frame
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.camera import model_camera
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.scene import Scene

HALF_ANGLE_DEG = 6.0  # of the disc of a sharp light: smaller discs are noisier
BLOCKS_ACROSS = 12  # along the shorter side: means over blocks are compared, since single pixels are too noisy
EDGE_PIXELS = 2  # excluded along outlines
SIGNIFICANT = 2.0  # standard errors that an rms is above nothing, at least
STRIP_PERCENTILE, STRIP_BRIGHTNESS = 98.0, 0.85  # of traced radiance, shown as that share of white
STRIP_PIXELS = 480  # height at least, by whole factors
CAPTIONS = ("ours", 0.85), ("path traced", 0.85), ("difference (grey: none)", 0.1)  # with the grey of the letters


@dataclass(frozen=True)
class PathTracedComparison:
    """Subsurface radiance of a picture relative to that of traced paths, R, G and B.

    Attributes
    ----------
    ratio : (3,) tuple
        Mean over mean.
    rms : (3,) tuple
        Root mean square difference of blocks of pixels over the traced rms, with the variance of the paths subtracted;
        0 where what is left is not `SIGNIFICANT`.
    noise : (3,) tuple
        Standard error of the blocks by that variance, over the same.
    """

    ratio: tuple[float, ...]
    rms: tuple[float, ...]
    noise: tuple[float, ...]

    def __str__(self) -> str:
        rms = ", ".join(f"{100.0 * value:.1f} %" if value > 0.0 else "below the noise" for value in self.rms)
        noise, ratio = (
            ", ".join(f"{f * v:.{n}f}" for v in values)
            for f, n, values in ((100.0, 1, self.noise), (1.0, 3, self.ratio))
        )
        return f"rms {rms} (noise {noise} %), mean ratio {ratio} (R, G, B)"


@dataclass(frozen=True)
class PathTracedResult:
    """Comparisons of a picture with traced paths.

    Attributes
    ----------
    whole : PathTracedComparison
        Of all subsurface light.
    alone : PathTracedComparison or None
        Of transport alone; None where paths cannot tell light that has met the object again.
    again_share : (3,) tuple or None
        Share of such light in the traced subsurface light.
    """

    whole: PathTracedComparison
    alone: PathTracedComparison | None = None
    again_share: tuple[float, ...] | None = None

    def __str__(self) -> str:
        lines = [f"Subsurface light against traced paths: {self.whole}."]
        if self.alone is None or self.again_share is None:
            lines.append(
                "Light that has met the object again is not told apart, and what the surface mirrors of the object "
                "counts as traced: Mitsuba's llvm_ad_rgb, which can, needs an LLVM of version 16 or later, as 19 "
                "(DRJIT_LIBLLVM_PATH names one)."
            )
        else:
            share = ", ".join(f"{100.0 * value:.1f}" for value in self.again_share)
            lines.append(f"Transport alone, without light between parts ({share} % of it): {self.alone}.")
        return "\n".join(lines)


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
    if not scene.effective_lights() and not (scene.environment.given and scene.environment.intensity > 0.0):
        raise InputError("--path-traced needs light; give the scene a directional light or an environment")
    for light in scene.effective_lights():
        if not light.DISTANT:
            raise InputError(f"--path-traced knows distant lights only; remove the {light.KIND} lights")
    if scene.environment.given and not scene.environment.occluded:
        raise InputError("--path-traced has the object in the way of light; leave environment.occluded on")
    if scene.camera.orthographic:
        raise InputError("--path-traced knows perspective cameras only; leave out --orthographic")
    if importlib.util.find_spec("mitsuba") is None:
        raise InputError('--path-traced needs Mitsuba 3: pip install "milkglass[mitsuba]"')


def run(scene: Scene, path: Path, paths: int, seed: int = 0) -> PathTracedResult:
    """Render a scene and return its comparison with traced paths; see `trace`."""
    parts = tuple((name, material.isotropic()) for name, material in scene.materials)
    scene = replace(scene.floating(), material=scene.material.isotropic(), materials=parts)
    renderer = Renderer(headless_context())
    lit = renderer.light(scene)
    if lit.detail is not None:
        off = "--set detail.albedo=off --set detail.normal_strength=0"
        raise InputError(f"--path-traced does not know the colours and relief of a surface; add {off}")
    mesh = lit.model.mesh
    if not (mesh.closed or is_closed(row_sums(mesh))):
        raise InputError("--path-traced needs a closed mesh that is wound outwards")
    frame = alone = renderer.render(scene, seed=seed)
    if lit.exchange is not None:
        alone = renderer.render(replace(scene, transport=replace(scene.transport, exchange="off")), seed=seed)
    probe = renderer.probe(scene.environment) if scene.environment.given else None
    return trace(scene, subject_of(scene, mesh, probe, lit.model.clear), (frame, alone), path, paths, seed)


def trace(
    scene: Scene, subject: Subject, frames: tuple[Frame, Frame], path: Path, paths: int, seed: int = 0
) -> PathTracedResult:
    """Trace a picture, write it and a strip beside ours, and return the comparison.

    Parameters
    ----------
    scene : Scene
    subject : Subject
        From `subject_of`.
    frames : pair of Frame
        Pictures of the scene: as it is, and without light between parts; they may be the same.
    path : Path
        EXR file of the traced radiance of subsurface light, with layers `difference` and, where it is told apart,
        `again`; a strip, ours, traced, and their difference, goes beside it (`strip_path`).
    paths : int
        Number of paths a pixel, >= 2.
    seed : int
    """
    # Two independent halves, whose difference estimates the noise.
    halves = [mitsuba_paths.trace(subject, paths // 2, 2 * seed + i) for i in range(2)]
    whole = np.stack([half.whole for half in halves])
    traced, (frame, alone) = whole.mean(axis=0), frames
    difference = frame.subsurface - traced
    used = binary_erosion(frame.alpha == 1.0, iterations=EDGE_PIXELS)
    result = PathTracedResult(compare(frame.subsurface, whole, used))
    layers = {"": traced, "difference.": difference}
    again = [half.again for half in halves if half.again is not None]
    if again:
        layers["again."] = np.mean(again, axis=0)
        share = layers["again."][used].sum(axis=0) / np.maximum(traced[used].sum(axis=0), np.finfo(np.float64).tiny)
        first = compare(alone.subsurface, np.stack([half.first for half in halves]), used)
        result = replace(result, alone=first, again_share=tuple(share.tolist()))
    write_exr(
        path, {f"{n}{c}": layer[..., i].astype(np.float32) for n, layer in layers.items() for i, c in enumerate("RGB")}
    )
    write_png(strip_path(path), strip(frame.subsurface, traced))
    return result


def subject_of(scene: Scene, mesh: Mesh, probe: Probe | None, clear: Sequence[Mesh] = ()) -> Subject:
    """Return what is traced of a scene with distant lights and a perspective camera.

    `probe` is its environment's, `clear` are the meshes of its clear parts.
    """
    width, height = scene.display.image_size
    whole, environment = joined(mesh, *clear) if clear else mesh, scene.environment
    camera = model_camera(scene.camera, whole, (width, height))
    half = 1.0 / float(camera.projection[1, 1])
    view = View(camera.eye[:3], camera.rotation, half, (width, height))  # its columns: right, up and back
    surrounding = None
    if probe is not None and environment.intensity > 0.0:
        surrounding = Surrounding(environment.intensity * probe.latlong, environment.rotation_deg)
    lamps = [_lamp(light) for light in scene.effective_lights()]
    scattering = [scene.material.resolve(), *(material.resolve() for _, material in scene.scattering_parts)]
    glasses = [material.resolve() for _, material in scene.clear_parts]
    parts = [ClearPart(part, of.eta, of.sigma_a) for part, of in zip(clear, glasses, strict=True)]
    kinds = range(len(scattering))
    etas = [material.eta for material in scattering]
    surface = Surface.of(mesh, etas, None if mesh.kinds is None else mesh.kinds.astype(np.int32), parts, kinds)
    by_medium = [body if body >= 0 else -1 - body for body in surface.faces.of_media.tolist()]
    return Subject(surface, [[*scattering, *glasses][of] for of in by_medium], lamps, surrounding, view)


def _lamp(light: Light) -> Lamp:
    """Return a disc of constant radiance with the irradiance of a distant light."""
    towards = np.asarray(light.vector, np.float64) / np.linalg.norm(light.vector)
    half = float(np.radians(HALF_ANGLE_DEG if light.is_sharp else 0.5 * light.apparent_deg(0.0)))
    return Lamp(towards, np.asarray(light.brightness, np.float64) / (np.pi * np.sin(half) ** 2), half)


def strip_path(path: Path) -> Path:
    """Return the path of the strip beside a traced picture: paths.exr -> paths.png."""
    return path.with_suffix(".png")


def strip(ours: npt.ArrayLike, traced: Array) -> Pixels8:
    """Return ours, the traced picture and their difference beside each other, (h, w, 3), at one exposure."""
    picture, brightest = np.asarray(ours, np.float64), traced.max(axis=-1)
    white = float(np.percentile(brightest[brightest > 0.0], STRIP_PERCENTILE)) if brightest.any() else 1.0
    gain, enlarged = STRIP_BRIGHTNESS / white, max(1, -(-STRIP_PIXELS // len(picture)))
    shown = gain * picture, gain * traced, 0.5 + 0.5 * gain * (picture - traced)
    pixels = (np.asarray(255.0 * srgb(tile) + 0.5, np.uint8) for tile in shown)
    tiles = (np.repeat(np.repeat(tile, enlarged, axis=0), enlarged, axis=1) for tile in pixels)
    captioned = [written(tile, 10, 20, text, grey=grey) for tile, (text, grey) in zip(tiles, CAPTIONS, strict=True)]
    return np.concatenate(captioned, axis=1)


def compare(picture: npt.ArrayLike, halves: Array, used: npt.NDArray[np.bool_]) -> PathTracedComparison:
    """Return the comparison of a picture (h, w, 3) with two estimates (2, h, w, 3) in the pixels `used`, (h, w)."""
    radiance = np.asarray(picture, np.float64)
    first, second, picture_means = (_block_means(image, used) for image in (*halves, radiance))
    traced = 0.5 * (first + second)
    noise2 = 0.25 * np.mean((first - second) ** 2, axis=0)
    traced_rms = np.sqrt(np.maximum(np.mean(traced**2, axis=0) - noise2, np.finfo(np.float64).tiny))
    rms2 = np.mean((picture_means - traced) ** 2, axis=0) - noise2
    ratio = radiance[used].sum(axis=0) / np.maximum(halves.mean(axis=0)[used].sum(axis=0), np.finfo(np.float64).tiny)
    rms2 = np.where(rms2 > SIGNIFICANT * np.sqrt(2.0 / len(traced)) * noise2, rms2, 0.0)
    values = ratio, np.sqrt(rms2) / traced_rms, np.sqrt(noise2) / traced_rms
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
