"""Exitance at points of the surface, by the shaders of every picture."""

from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import moderngl
import numpy as np

from milkglass.core.arrays import Float32, Floats, Ints
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.stages import Steps, exhausted
from milkglass.viewer.gl.constants import MOST_LAMPS
from milkglass.viewer.gl.context import bind_cleared, checked, float_texture, read_rgba
from milkglass.viewer.passes.composite import CompositePass
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.passes.gbuffer import GBuffer
from milkglass.viewer.passes.irradiance import Highlights, Lamps, PixelIrradiancePass
from milkglass.viewer.passes.light_source import lamps_of
from milkglass.viewer.passes.reentry import ReentryTargets
from milkglass.viewer.passes.refined import RefinedSurface
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.vertices import without_gaps
from milkglass.viewer.scene.camera import Camera
from milkglass.viewer.scene.lights.sub_lights import PARTS
from milkglass.viewer.scene.settings import Gloss

# Exitance has no direction; one that stays keeps its last digits from following the picture's camera.
FROM_ONE_SIDE = Camera(np.eye(4), np.eye(4), np.array([0.0, 0.0, 1.0, 0.0]))
# Gives values that are known at the vertices of a refined surface, (m, k), at the points that are asked for, (n, k).
ValuesFound = Callable[[RefinedSurface, Floats], Floats]


class _Points(NamedTuple):
    """Points (n, 3) of the surface with normals (n, 3) and bodies (n,), and the values of vertices at them."""

    points: Floats
    normals: Floats
    bodies: Floats | float
    found: ValuesFound


class SurfaceExitance:
    """Computes exitance at points of a lit object in one OpenGL context, as pixels have it."""

    def __init__(
        self,
        context: moderngl.Context,
        irradiance: PixelIrradiancePass,
        composite: CompositePass,
        no_probe: moderngl.Texture,
    ) -> None:
        self._context, self._irradiance, self._composite = context, irradiance, composite
        self._no_highlights = Highlights(Gloss(0.0, 1.0, "none", normalized=False), no_probe)

    def at(self, samples: SurfaceSamples, lit: LitScene, gather: Gather) -> Float32:
        """Return exitance M at samples of the surface: (n, 3)."""

        def found(surface: RefinedSurface, values: Floats) -> Floats:
            return surface.at(values, samples.points, samples.normals)

        return self._at(samples, found, lit, gather)

    def at_vertices(self, vertices: Ints, lit: LitScene, gather: Gather, *, inside: bool = False) -> Float32:
        """Return exitance M at vertices of the object's mesh, (n, 3), for their numbers, (n,).

        From `inside` it is M / e, e the share of light from all around that collides there before it leaves.
        """
        mesh = lit.model.mesh
        of_vertex = np.zeros(len(mesh.vertices), np.int32)
        of_vertex[mesh.faces] = np.arange(len(mesh.faces), dtype=np.int32)[:, None]
        areas = np.full(len(vertices), mesh.area / max(len(mesh.vertices), 1), np.float32)
        samples = SurfaceSamples(mesh.vertices[vertices], mesh.normals[vertices], areas, of_vertex[vertices])
        # The mesh's vertices are the first of a refined one.
        return self._at(samples, lambda _, values: values[vertices], lit, gather, inside=inside)

    def lamps_at(self, surface: RefinedSurface | None, lit: LitScene, gather: Gather, sharing: int) -> Steps[Lamps]:
        """Compute what each lamp gives at all vertices of a refined surface, or of the object's mesh.

        It depends on the lamps and on `matter_key`. One part in `sharing` of a lamp's sub-lights is seen.
        """
        gbuffer, depth = self._gbuffer(_vertices(surface, lit), lit, gather)
        lamps = {}
        for source in lamps_of(lit.sources):
            targets = replace(self._irradiance.targets(gbuffer.position.size, depth), stores=True)
            yield from self._irradiance.steps(
                gbuffer, (source,), gather, self._no_highlights, FROM_ONE_SIDE, targets, 0, sharing
            )
            lamps[source] = targets
        return lamps

    def of_refined(
        self, surface: RefinedSurface | None, lit: LitScene, gather: Gather, lamps: Lamps
    ) -> Steps[tuple[Float32, Float32]]:
        """Compute exitance M at all vertices of a refined surface, or of the object's mesh, and what is seen of lamps.

        `lamps` is what `lamps_at` found at them.

        Returns
        -------
        exitance : (n, 3)
        shares : (n, MOST_LAMPS)
            Visible shares of lamps, in [0, 1].
        """
        mesh = lit.model.mesh if surface is None else surface.refined.mesh
        exitance, first, last = yield from self._steps(_vertices(surface, lit), lit, gather, lamps=lamps)
        shares = np.concatenate([first, last], axis=1) if lamps else np.zeros((len(exitance), MOST_LAMPS), np.float32)
        return without_gaps(exitance, mesh), shares

    def _at(
        self, samples: SurfaceSamples, found: ValuesFound, lit: LitScene, gather: Gather, *, inside: bool = False
    ) -> Float32:
        """Return M at samples, where `found` gives the values of a refined surface's vertices: (n, 3)."""
        bodies: Floats | float = 0.0
        if lit.body_marks is not None:
            bodies = lit.body_marks.of_vertex[lit.model.mesh.faces[samples.faces, 0]]
        points = _Points(samples.points, samples.normals, bodies, found)
        exitance, _, _ = exhausted(self._steps(points, lit, gather, inside=inside))
        if lit.detail is not None and lit.detail.after > 0.0:
            detail = lit.detail.detail
            pieces = detail.pieces(samples.points, samples.faces, samples.areas)
            exitance = exitance * detail.colour(pieces, lit.detail.after)
        return np.ascontiguousarray(exitance)

    def _steps(
        self,
        places: "_Points",
        lit: LitScene,
        gather: Gather,
        *,
        lamps: Lamps = MappingProxyType({}),
        inside: bool = False,
    ) -> Steps[tuple[Float32, Float32, Float32]]:
        """Compute M, E and highlights, (n, 3) each, or what else `viewer.passes.irradiance.PixelLight` holds."""
        gbuffer, depth = self._gbuffer(places, lit, gather)
        targets = replace(self._irradiance.targets(gbuffer.position.size, depth), lamps=lamps)
        sources = lit.sources
        if gather.reentry is not None:
            sources = *sources, gather.reentry.source
        highlights = self._no_highlights
        yield from self._irradiance.steps(gbuffer, sources, gather, highlights, FROM_ONE_SIDE, targets, 0, PARTS)
        # Radiance without an interface and over 1 sr is exitance, by the shader of every picture.
        composite = self._composite.targets(gbuffer.position.size, parts=False, depth=depth)
        bind_cleared(composite.framebuffer)
        traced = self._composite.not_traced(None, goes_inside=inside)
        self._composite.render(gbuffer, targets, gather.bare(), highlights, FROM_ONE_SIDE, 1.0, composite, traced)
        n, textures = len(places.points), (composite.textures["radiance"], targets.irradiance, targets.specular)
        exitance, irradiance, specular = (read_rgba(texture)[::-1].reshape(-1, 4)[:n, :3] for texture in textures)
        return exitance, irradiance, specular

    def _gbuffer(self, places: "_Points", lit: LitScene, gather: Gather) -> tuple[GBuffer, moderngl.Renderbuffer]:
        """Return points as the pixels of a G-buffer, row by row, and its depth."""
        points, normals, bodies, found = places
        n = len(points)
        size = (int(np.ceil(np.sqrt(n))),) * 2

        def pixels(rgb: Floats, alpha: Floats | float) -> moderngl.Texture:
            values = np.zeros((size[0] * size[1], 4), np.float32)
            values[:n, :3], values[:n, 3] = rgb, alpha
            texture = float_texture(self._context, size)
            texture.write(values)
            return texture

        occlusion = lit.occlusion
        position, normal, visible, again = pixels(points, 1.0), pixels(normals, bodies), None, None
        if occlusion is not None:
            far_side = found(occlusion.surface, occlusion.surface.behind(occlusion.shares))
            behind = np.rint(255.0 * far_side) @ (1.0, 256.0, 65536.0)  # visible.glsl
            visible = pixels(found(occlusion.surface, occlusion.shares), behind)
        # With depth, as of a picture: the driver would compile shaders anew for targets without.
        depth = checked(self._context, lambda: self._context.depth_renderbuffer(size), "a depth buffer")
        nothing = self._context.framebuffer([], depth)
        bind_cleared(nothing, depth=0.0)
        if (reentry := gather.reentry) is not None:
            near, far = (pixels(found(reentry.surface, values), 0.0) for values in (reentry.irradiance, reentry.behind))
            again = ReentryTargets(near, far, nothing)
        return GBuffer(position, normal, nothing, visible, reentry=again), depth


def matter_key(gather: Gather) -> tuple[object, ...]:
    """Return all that `SurfaceExitance.lamps_at` depends on of the matter."""
    return *((kind.eta, kind.tables.tables.local.reach, kind.bodies) for kind in gather.kinds), gather.clear_from


def _vertices(surface: RefinedSurface | None, lit: LitScene) -> _Points:
    """Return the vertices of a refined surface, or of the object's mesh."""
    mesh = lit.model.mesh if surface is None else surface.refined.mesh
    bodies: Floats | float = 0.0
    if lit.body_marks is not None:
        of_vertex = lit.body_marks.of_vertex.astype(np.float32)
        bodies = of_vertex if surface is None else of_vertex[surface.refined.sources]
    length = np.maximum(np.linalg.norm(mesh.normals, axis=1, keepdims=True), 1e-6)
    return _Points(mesh.vertices, mesh.normals / length, bodies, lambda _, values: values)
