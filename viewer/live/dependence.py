"""What a picture depends on, for deciding what to do again."""

from collections.abc import Iterator
from dataclasses import replace

from milkglass.core.transport.quality import sample_spacing
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.assets.sources import (
    BodiesOf,
    DetailOf,
    PartsOf,
    ProfileFile,
    RoughnessOf,
    RowSumsOf,
    SamplesOf,
    Source,
    model_source,
    probe_source,
)
from milkglass.viewer.render.lighting import quality_of
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.scene.keys import version
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import CameraSettings


def files(scene: Scene) -> tuple[object, ...]:
    """Everything that has to be read or sampled before a scene can be lit."""
    return scene.model, scene.environment.source, scene.material.table_in_use, scene.transport, scene.detail


def scene_sources(scene: Scene, assets: Assets, *, draft: bool = False) -> Iterator[Source[object]]:
    """Yield the sources of all that lighting a scene needs, each once those before it are at hand.

    A draft lights whatever samples there are.
    """
    model, environment, table = model_source(scene.model), scene.environment, scene.material.table_in_use
    yield model
    yield DetailOf.asked(scene.model, scene.detail)
    if environment.given:
        yield (probe := probe_source(environment))
        if environment.extract:
            yield PartsOf(assets.get(probe))
    if table is not None:
        yield ProfileFile(table)
    mesh = assets.get(model).mesh
    if scene.separate:
        yield BodiesOf(mesh)
    if scene.transport.facts.on_open_surface is not None:
        yield RowSumsOf(mesh, scene.separate)
    if draft:
        return
    settings = assets.possible(scene.transport, mesh, scene.separate)
    if settings.facts.needs_roughness:
        yield RoughnessOf(mesh)
    yield SamplesOf(mesh, sample_spacing(mesh, settings, quality_of(scene, mesh, assets).resolution))


def lighting_key(scene: Scene, occluded: bool = False) -> tuple[object, ...]:
    """Everything that light and transport depend on, but for where the camera stands; `occluded`: as far as known."""
    environment, material = scene.environment, scene.material
    table = material.table_in_use
    scatters = material.resolve(), material.profile, table, version(table)
    return scene.model, scatters, scene.detail, scene.effective_lights(), environment, scene.transport, occluded


def turned(camera: CameraSettings) -> CameraSettings:
    """Return what turns the layers, out of a camera."""
    return CameraSettings(azimuth_deg=camera.azimuth_deg, elevation_deg=camera.elevation_deg, roll_deg=camera.roll_deg)


def angle(a: CameraSettings, b: CameraSettings) -> float:
    """Largest difference of the angles, degrees."""
    turn = abs(a.azimuth_deg - b.azimuth_deg) % 360.0
    return max(min(turn, 360.0 - turn), abs(a.elevation_deg - b.elevation_deg), abs(a.roll_deg - b.roll_deg))


def same_light(a: LitScene, b: LitScene) -> bool:
    """Whether transport would have the same work: stages return the very same arrays where nothing changed."""
    return (
        a.model is b.model
        and a.transport is b.transport
        and a.grid == b.grid
        and a.coordinates is b.coordinates
        and a.flux is b.flux
        and a.profiles == b.profiles
        and a.media == b.media
        and len(a.lights) == len(b.lights)
        and all(one is other for one, other in zip(a.lights, b.lights, strict=True))
        and a.sources == b.sources
        and a.bodies is b.bodies
        and a.detail is b.detail
    )


def looks_of(scene: Scene, lit: LitScene) -> tuple[object, ...]:
    """All that a picture depends on, but for its volume and its size."""
    display = replace(scene.display, image_size=(16, 16))
    return scene.camera, scene.specular, scene.environment, display, scene.photo, lit.model, lit.detail, lit.sources
