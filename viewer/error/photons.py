"""Error of a scene's transport against photons: of transport alone, and of the light between parts of the object.

Both come of one walk (`core.reference.photons`), in which light that has met the object again is told apart. No OpenGL.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from milkglass.core.arrays import Array, Floats, Ints
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.probe import Probe
from milkglass.core.reference.photon_lights import Beam, PhotonLight, Surroundings
from milkglass.core.reference.regions import Regions
from milkglass.core.reference.transport_error import (
    BetweenPartsError,
    PhotonReference,
    TransportError,
    between_parts_error,
    photon_reference,
    region_means,
    transport_error,
)
from milkglass.core.transport.base import Scattered
from milkglass.viewer.error.point_exitance import Evaluate, scene_exitance
from milkglass.viewer.error.visible import Illumination
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.scene import Scene

N_REGIONS = 150  # of the surface, over which the exitance of photons and of the transport is compared


Solution = tuple[LitScene, Scattered]


@dataclass(frozen=True, eq=False)
class PhotonError:
    """Errors of what is shown, against photons.

    Attributes
    ----------
    inside : TransportError
        Of transport alone, against photons that never come back.
    between_parts : BetweenPartsError
        Of the light between parts.
    whole : TransportError
        Of all light together, against photons however often they have met the object.
    reference : PhotonReference
        Of all light together.
    exitance : (n, 3) float64
        M of what is shown, the mean of each of its regions.
    """

    inside: TransportError
    between_parts: BetweenPartsError
    whole: TransportError
    reference: PhotonReference
    exitance: Array

    @property
    def noise(self) -> Array:
        """Standard error of the photons' M, over its rms, (n, 3)."""
        return np.asarray(np.sqrt(self.reference.variance) / self._size)

    @property
    def shares(self) -> Array:
        """|M - M_ref| over the rms of M_ref, (n, 3), without what the photons' noise explains."""
        beyond = (self.exitance - self.reference.exitance) ** 2 - self.reference.variance
        return np.asarray(np.sqrt(np.maximum(beyond, 0.0)) / self._size)

    @property
    def _size(self) -> Array:
        size = np.sqrt(np.square(self.reference.exitance).mean(axis=0))
        return np.asarray(np.where(size > 0.0, size, 1.0))


def photon_walk(
    scene: Scene,
    mesh: Mesh,
    probe: Probe | None,
    photons: int,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    regions: Regions | int = N_REGIONS,
) -> PhotonReference:
    """Return the exitance of a scene's object by photons.

    Parameters
    ----------
    scene : Scene
        Without an `obstacle`.
    mesh : Mesh
    probe : Probe or None
        The whole one of the scene's environment, strong sources included.
    photons : int
        Number of photons of each light and mean free path, >= 1.
    seed : int
    progress : callable, optional
        Called with the finished share, in [0, 1]; what it raises ends the work.
    regions : Regions or int
        Of the surface, over which M is a mean; or how many of them are to be found.

    Raises
    ------
    InputError
        If photons cannot walk in the mesh or the material.
    """
    lights, material = photon_lights(scene, probe), scene.material.resolve()
    return photon_reference(mesh, material, lights, regions, photons, seed, progress, between_parts=True)


def evaluated(shown: Solution, alone: Solution, illumination: Illumination) -> tuple[Evaluate, Evaluate]:
    """Return M of a picture as a function of surface points, and that of the same without light between parts.

    Both are computed once, at the points that they are first asked for: those of a reference.

    Parameters
    ----------
    shown, alone : pairs of LitScene and Scattered
        The transport of a picture, and the same without light between parts; they may be the same.
    illumination : Illumination
        Without light between parts.
    """
    whole = _evaluated_once(scene_exitance(*shown, illumination))
    return whole, whole if alone is shown else _evaluated_once(scene_exitance(*alone, illumination))


def photon_error(reference: PhotonReference, whole: Evaluate, inside: Evaluate) -> PhotonError:
    """Return the error of what a transport has scattered, as `evaluated`, relative to photons under the same light."""
    everything = reference.whole
    return PhotonError(
        transport_error(reference, inside),
        between_parts_error(reference, inside, whole),
        transport_error(everything, whole),
        everything,
        region_means(reference.regions, whole),
    )


def seen_regions(regions: Regions, alpha: Floats, position: Floats, eye: Array) -> tuple[Ints, Ints, Ints]:
    """Return the regions that a picture shows, with a pixel amid each: indices, rows and columns, (n,) each.

    Parameters
    ----------
    regions : Regions
    alpha, position : (h, w) and (h, w, 3) arrays
        Where the picture shows the object, 1, and where that is, mm.
    eye : (4,)
        Homogeneous: (position, 1), or (direction towards the eye, 0).
    """
    rows, columns = np.nonzero(alpha >= 1.0)
    points, normals = regions.samples.points.astype(np.float64), regions.samples.normals
    facing = np.flatnonzero(((eye[:3] - eye[3] * points) * normals).sum(axis=1) > 0.0)  # none of a thin part's back
    if not len(rows) or not len(facing):
        return (np.empty(0, np.int64),) * 3
    region = regions.of_sample[facing][cKDTree(points[facing]).query(position[rows, columns])[1]]
    count = np.maximum(np.bincount(region), 1)
    off = sum((values - (np.bincount(region, values) / count)[region]) ** 2 for values in (rows, columns))
    order = np.lexsort((off, region))
    found, first = np.unique(region[order], return_index=True)
    return found, rows[order][first], columns[order][first]


def _evaluated_once(evaluate: Evaluate) -> Evaluate:
    """Return exitance at points that are always the same, those of a reference, which takes seconds."""
    kept: list[Array] = []

    def at(points: Array, normals: Array) -> Array:
        if not kept:
            kept.append(evaluate(points, normals))
        return kept[0]

    return at


def photon_lights(scene: Scene, probe: Probe | None) -> list[PhotonLight]:
    """Return the distant lights of a scene, and its environment, for photons."""
    lights: list[PhotonLight] = [
        Beam(light.vector, light.brightness, light.apparent_deg(0.0)) for light in scene.effective_lights()
    ]
    if probe is not None and scene.environment.intensity > 0.0:
        to_probe = world_to_probe(scene.environment.rotation_deg)
        lights.append(Surroundings(probe.latlong, to_probe, scene.environment.intensity))
    return lights


def obstacle(scene: Scene, lit: LitScene) -> str | None:
    """Return the reason why a scene cannot be compared with photons, in a few words, or None."""
    for light in scene.effective_lights():
        if not light.DISTANT:
            return f"photons come from distant lights only, and the scene has a {light.KIND} light"
    if (reason := unlike_paths(scene, lit)) is not None:
        return reason
    if not any(scene.material.resolve().sigma_s_prime):
        return "the material does not scatter"
    if lit.body_marks is not None and lit.quality.facts.uses_profile:
        return "bodies that are separate are compared with transport diffusion only"
    return None


def unlike_paths(scene: Scene, lit: LitScene) -> str | None:
    """Return the reason why neither photons nor paths from the eye know what a scene has, in a few words, or None."""
    environment = scene.environment
    if environment.given and not environment.occluded:
        return "the object is in the way of photons, and environment.occluded is off"
    if not scene.effective_lights() and not (environment.given and environment.intensity > 0.0):
        return "the scene has no light"
    if lit.detail is not None:
        return "photons do not know the colours and the relief of the model's surface"
    if lit.clear or len(lit.matter) > 1:
        return "photons do not know parts of the model with a material of their own"
    return None
