"""The lights of a scene as the float64 reference takes them."""

from dataclasses import replace

from milkglass.viewer.assets.sources import PartedProbe
from milkglass.viewer.error.visible import Illumination
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.sources import probe_lamps
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.scene import Scene


def lights_of(scene: Scene, around: PartedProbe | None, lit: LitScene | None = None) -> Illumination:
    """Gather a scene's lights, with those of its probe and the rest of it, occluded as in `lit`; uses no OpenGL."""
    occlusion = None if lit is None else lit.occlusion
    visible = None if occlusion is None else occlusion.at
    environment = scene.environment
    eta, to_probe = scene.material.resolve().eta, world_to_probe(environment.rotation_deg)
    strong, rest = ((), None) if around is None else around
    lights = (*scene.effective_lights(), *probe_lamps(environment, strong))
    illumination = Illumination.of(lights, eta, rest, to_probe, environment.intensity, visible)
    return illumination if lit is None or lit.detail is None else replace(illumination, detail=lit.detail.on_sources)
