"""Illumination of a scene as the float64 reference takes it."""

from dataclasses import replace

from milkglass.core.transport.base import Scattered
from milkglass.viewer.assets.sources import PartedProbe
from milkglass.viewer.error.visible import Illumination
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.sources import probe_lamps
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.scene import Scene


def with_reentry(illumination: Illumination, lit: LitScene, scattered: Scattered) -> Illumination:
    """Return an illumination with the light that left the object and enters it again, as a picture has it."""
    total = lit.entering_again(scattered)
    surface = lit.surface
    if total is None or surface is None:
        return illumination
    behind = surface.behind(total)
    return replace(
        illumination,
        again=lambda points, normals: surface.at(total, points, normals),
        again_behind=lambda points, normals: surface.at(behind, points, normals),
    )


def lights_of(scene: Scene, parted: PartedProbe | None, lit: LitScene | None = None) -> Illumination:
    """Return a scene's lights and its probe, in sources and remainder, occluded as in `lit`; without OpenGL."""
    occlusion = None if lit is None else lit.occlusion
    visible = None if occlusion is None else occlusion.at
    environment = scene.environment
    eta, to_probe = scene.material.resolve().eta, world_to_probe(environment.rotation_deg)
    sources, remainder = ((), None) if parted is None else parted
    lights = (*scene.effective_lights(), *probe_lamps(environment, sources))
    illumination = Illumination.of(lights, eta, remainder, to_probe, environment.intensity, visible)
    return illumination if lit is None or lit.detail is None else replace(illumination, detail=lit.detail.on_sources)
