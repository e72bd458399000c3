"""The object of a photograph as a mesh, and the camera that sees the mesh where the photograph shows the object."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32
from milkglass.core.display import LUMINANCE
from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.photograph.depth import estimate_height, inflated, inscribed_radius
from milkglass.core.photograph.light import ShadingFit, fit_shading, shading_residual, without_lamp
from milkglass.core.photograph.surface import Outline, find_outline, height_surface
from milkglass.core.photograph.surround import filled, scene_luminance
from milkglass.viewer.files.depth import depth_format_of
from milkglass.viewer.files.photograph import Photo, Region
from milkglass.viewer.photograph.enlarge import enlarged
from milkglass.viewer.photograph.framing import Framing
from milkglass.viewer.scene.settings import CameraSettings

DEEPEST = 50.0  # times the photograph's width: a camera that holds the whole object must still show it


@dataclass(frozen=True, eq=False)
class Geometry:
    """Surface of a photograph's object, and what it was made of.

    Attributes
    ----------
    framing : Framing
    colour : (h, w, 3) float32
        Linear RGB of the region in [0, 1], a pixel for each `block`.
    coverage : (h, w) float32
        By the object, [0, 1], of the same pixels.
    share : (n, m) float64
        Coverage of the nodes' squares.
    base : (n, m) float64
        The outline inflated, in nodes.
    shading : ShadingFit
        How the object is lit in the photograph.
    height : (n, m) float64
        Of the nodes towards the camera, in nodes; 0 beside the object.
    mesh : Mesh
    camera : CameraSettings
        Orthographic; shows what is in the photograph.
    """

    framing: Framing
    colour: Float32
    coverage: Float32
    share: Array
    base: Array
    shading: ShadingFit
    height: Array
    mesh: Mesh
    camera: CameraSettings

    def depth_mm(self, band: Region) -> Float32:
        """Return the height of a region's pixels (height, width), mm, linear between the nodes; 0 beside the object."""
        nodes = (self.height * self.framing.mm).astype(np.float32)[..., None]
        whole = self.framing.region
        rows, columns = (
            range(start, start + n)
            for start, n in ((band.top - whole.top, band.height), (band.left - whole.left, band.width))
        )
        return enlarged(nodes, self.framing.node, rows, columns)[..., 0]

    def facing(self) -> Float32:
        """Return the cosine between surface and camera at every rendered pixel, (h, w); 0 at the rim."""
        down, right = np.gradient(self.height)
        cosine = np.where(self.base > 0.0, 1.0 / np.sqrt(1.0 + down**2 + right**2), 0.0).astype(np.float32)[..., None]
        rows, columns = self.framing.size
        return enlarged(self.framing.cut(cosine), self.framing.shades, range(rows), range(columns))[..., 0]


def make_geometry(
    photo: Photo,
    framing: Framing,
    white: float,
    *,
    strength: float,
    smoothing: float,
    depth: Path | None = None,
    on_shading: Callable[[ShadingFit], object] = lambda _: None,
) -> Geometry:
    """Return the surface of a photograph's object, its depth estimated or read from a map.

    Parameters
    ----------
    photo, framing
    white : float
        Luminance of the photograph's white, see `core.photograph.surround.scene_radiance`.
    strength, smoothing : as of `core.photograph.depth.estimate_height`
        Of a depth map, strength is a factor and smoothing has no effect.
    depth : Path, optional
        See `read_depth`.
    on_shading : callable
        Called with the shading as soon as it is measured: the light can be computed meanwhile.

    Raises
    ------
    InputError
        If the object is too thin for a surface, or the depth cannot be used.
    """
    colour, coverage = photo.reduced(framing.region, framing.block)
    share = _squares(coverage, framing.step)
    outline = find_outline(share)
    if not outline.inner.any():
        raise InputError(
            f"{photo.mask_path} shows nothing thick enough for a volume: paint the object's inside white too"
        )
    base = inflated(outline.inner)
    mapped = None
    if depth is not None:
        mapped = _height_from_map(
            read_depth(depth, photo), photo, framing, outline, strength, relative=depth_format_of(depth).relative
        )
    shown = colour @ LUMINANCE.astype(np.float32)
    shading = _shading(shown, coverage, share, base if mapped is None else mapped, framing.step, white)
    on_shading(shading)
    if mapped is None:
        light = over_nodes(shown, coverage, framing.step)
        # Of a lamp shading ends at the terminator, where light comes through the object: no slope is read from that.
        more = None if shading.lamp is not None else shading_residual(light, base, outline.inner, shading)
        light = without_lamp(light, base, outline.inner, shading)
        height = estimate_height(
            light,
            outline.inner,
            base,
            residual=more,
            gradient=shading.gradient,
            smoothing=smoothing,
            strength=strength,
        )
    else:
        height = mapped
        depth_in_widths = np.ptp(mapped[outline.inner]) / max(share.shape)
        if depth_in_widths > DEEPEST:
            raise InputError(
                f"the depth map {depth} makes the object {depth_in_widths:.3g} times as deep as it is wide: "
                "check its unit, mm, or lower --depth-strength"
            )
    mesh = height_surface(outline, height, base, framing.mm)
    centre = mesh.bounds.mean(axis=0)
    mesh = replace(mesh, vertices=mesh.vertices - centre.astype(np.float32))
    camera = _camera(framing, mesh, centre)
    return Geometry(framing, colour, coverage, share, base, shading, height, mesh, camera)


def _shading(shown: Float32, coverage: Float32, share: Array, height: Array, step: int, white: float) -> ShadingFit:
    """Return how the object is lit, measured on nodes that it covers wholly, if there are any."""
    seen = over_nodes(scene_luminance(shown, white), coverage, step)
    inside = share > 0.999
    return fit_shading(seen, height, inside if inside.any() else share > 0.5)


def read_depth(path: Path, photo: Photo) -> Float32:
    """Read a depth map of a photograph: (h, w), larger is nearer; of any range (PNG) or in mm.

    Raises
    ------
    InputError
        Unreadable, of another size than the photograph, not finite on the object.
    """
    values = depth_format_of(path).read(path)
    if values.shape != photo.size:
        size = " x ".join(map(str, values.shape[::-1]))
        raise InputError(
            f"the depth map {path} measures {size} but the photograph {photo.size[1]} x {photo.size[0]}: "
            "make the depth map of the same picture, at the same size"
        )
    if not np.isfinite(values[photo.mask > np.iinfo(photo.mask.dtype).max // 2]).all():
        raise InputError(f"the depth map {path} has NaN or infinite values on the object: fill them in first")
    return values


def _height_from_map(
    values: Float32, photo: Photo, framing: Framing, outline: Outline, strength: float, *, relative: bool
) -> Array:
    """Return the height of the nodes, in nodes, by a depth map; beyond the mask it continues."""
    region = framing.region
    rows = np.clip(np.arange(region.top, region.top + region.height), 0, photo.size[0] - 1)
    columns = np.clip(np.arange(region.left, region.left + region.width), 0, photo.size[1] - 1)
    # Half-covered pixels may show what is behind.
    weight = photo.coverage(region) > 0.5
    cut = np.where(weight, values[rows[:, None], columns[None, :]], 0.0)
    means, known = (
        over_nodes(cut, weight.astype(np.float32), framing.node),
        _squares(weight.astype(np.float32), framing.node) > 0.0,
    )
    height = filled(means[..., None], known.astype(np.float32))[..., 0].astype(np.float64)
    low, high = float(height[known].min()), float(height[known].max())
    if not relative:
        return (height - low) * (strength / framing.mm)
    scale = strength * inscribed_radius(outline.inner) / (high - low) if high > low else 0.0
    return (height - low) * scale


def _camera(framing: Framing, mesh: Mesh, centre: Array) -> CameraSettings:
    """Return an orthographic camera at +z whose picture is the rendered part of the region."""
    rows, columns = framing.size
    pixel, region, shown = framing.mm / framing.node, framing.region, framing.shown
    half = 0.5 * shown.height * pixel
    zoom = mesh.radius / min(1.0, columns / rows) / half
    # Nodes are the centres of squares of pixels, so that the grid's middle, x = y = 0 before, is the region's.
    right = shown.left - region.left + 0.5 * (shown.width - region.width)
    down = shown.top - region.top + 0.5 * (shown.height - region.height)
    target = (right * pixel - float(centre[0]), -down * pixel - float(centre[1]), 0.0)
    return CameraSettings(azimuth_deg=0.0, elevation_deg=0.0, orthographic=True, zoom=zoom, target_mm=target)


def over_nodes(values: npt.NDArray[np.floating], weight: npt.NDArray[np.floating], step: int) -> Array:
    """Return weighted means (n, m) of pixels (h, w) over the squares of the nodes; 0 where nothing has weight."""
    return _squares(values * weight, step) / np.maximum(_squares(weight, step), 1e-6)


def _squares(values: npt.NDArray[np.floating], step: int) -> Array:
    """Return means over squares of `step` x `step` pixels of (h, w)."""
    h, w = values.shape
    rows = values.reshape(h // step, step, w).sum(axis=1, dtype=np.float64)  # along memory
    return np.asarray(rows.reshape(h // step, w // step, step).sum(axis=2) / step**2)
