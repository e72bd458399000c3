"""Composite: exitance gathered from the layers (7), Fresnel and highlights, summed over the samples of a pixel."""

from dataclasses import dataclass, replace

import moderngl

from milkglass.viewer.gl.context import draw_over_object, float_targets, float_texture, over_object
from milkglass.viewer.gl.program import FullScreen
from milkglass.viewer.passes.detail_uniforms import leaving_uniforms
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.passes.gbuffer import GBuffer
from milkglass.viewer.passes.irradiance import Highlights, PixelLight
from milkglass.viewer.scene.camera import Camera

OUTPUTS = ("radiance", "position", "normal", "irradiance", "exitance", "subsurface", "specular", "unscattered")
SEEN = "t_seen_mirrored", "t_seen_through", "t_seen_scattered"  # samplers of `Traced.textures`


@dataclass(frozen=True, eq=False)
class Composite:
    """Target of the composite: RGBA float textures by name, the first or all of `OUTPUTS`.

    Each is a sum over the samples of a pixel; alpha is coverage.
    """

    textures: dict[str, moderngl.Texture]
    framebuffer: moderngl.Framebuffer


@dataclass(frozen=True, eq=False)
class Traced:
    """Radiance that rays of sight found at every pixel.

    Attributes
    ----------
    textures : tuple of moderngl.Texture
        What the first mirror shows, what is seen through the object, and what scatters towards the eye on the way; in
        their alphas R, G and B of the share of a ray that collides before it leaves. Any where no rays are followed;
        any but the first where none go on inside.
    left : tuple of R, G and B, optional
        Share of exitance that such rays do not find, in this sample of a pixel or another one, of each kind of matter.
    is_followed, goes_inside : bool
        Whether there are rays, and whether they go on inside.
    """

    textures: tuple[moderngl.Texture, ...]
    left: tuple[tuple[float, ...], ...] | None = None
    is_followed: bool = True
    goes_inside: bool = False


class CompositePass:
    """Draws the radiance that leaves the surface towards the eye, (7) and highlights."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        choices = "u_thin_reach", "u_surround_strength", "u_mirror_strength"
        self._shader = FullScreen(context, "composite.frag", *choices)
        self._none = float_texture(context, (1, 1))
        self._not_traced = Traced((self._none,) * len(SEEN), is_followed=False)

    def not_traced(self, left: tuple[tuple[float, ...], ...] | None, *, goes_inside: bool = False) -> Traced:
        """Return what stands for rays of a sample of which none are followed; arguments as of `Traced`.

        Where they were to go inside, all of them is taken to collide.
        """
        return replace(self._not_traced, left=left, goes_inside=goes_inside)

    def traced_textures(self, size: tuple[int, int], *, inside: bool) -> tuple[moderngl.Texture, ...]:
        """Allocate the textures of `Traced` for (width, height) pixels; fewer where no rays go on `inside`."""
        count = len(SEEN) if inside else 1
        drawn = tuple(float_texture(self._context, size) for _ in range(count))
        return drawn + (self._none,) * (len(SEEN) - count)

    def targets(self, size: tuple[int, int], *, parts: bool, depth: moderngl.Renderbuffer | None = None) -> Composite:
        """Allocate the textures of (width, height) pixels, of radiance or its `parts` too; `depth` of the G-buffer."""
        names = OUTPUTS if parts else OUTPUTS[:1]
        textures = dict(zip(names, float_targets(self._context, size, len(names)), strict=True))
        return Composite(textures, over_object(self._context, list(textures.values()), depth))

    def render(
        self,
        gbuffer: GBuffer,
        light: PixelLight,
        gather: Gather,
        highlights: Highlights,
        camera: Camera,
        weight: float,
        target: Composite,
        traced: Traced | None = None,
    ) -> None:
        """Add one sample of every pixel, times `weight`; the caller clears its framebuffer before the first."""
        traced = traced or self._not_traced
        target.framebuffer.use()
        mirrors = highlights.uniforms()
        for i, kind in enumerate(gather.kinds):
            triangle = self._shader.prepared(
                {
                    "t_position": gbuffer.position,
                    "t_normal": gbuffer.normal,
                    "t_irradiance": light.irradiance,
                    "t_specular": light.specular,
                    **gather.exitance_uniforms(kind),
                    **leaving_uniforms(gbuffer.detail),
                    "t_local": light.local,
                    "t_lobe": gbuffer.lobe or gbuffer.normal,
                    "u_occluded_lobe": gbuffer.lobe is not None,
                    **{name: mirrors[name] for name in ("u_surround_strength", "u_fresnel")},
                    **dict(zip(SEEN, traced.textures, strict=True)),
                    "u_traced": traced.is_followed,
                    "u_traced_inside": traced.goes_inside,
                    "u_left_to_surface": (1.0,) * 3 if traced.left is None else traced.left[i],
                    "u_mirror_strength": highlights.mirror_strength,
                    "u_world_to_clip": camera.world_to_clip,
                    "u_eye": tuple(camera.eye),
                    "u_weight": weight,
                },
                detail=gbuffer.detail is not None,
            )
            draw_over_object(self._context, triangle, has_depth=target.framebuffer.depth_attachment is not None)
