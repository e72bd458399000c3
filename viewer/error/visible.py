"""Error of a picture's exitance at some of its visible points, against equation (1) summed in float64.

Arrays in, arrays out and no OpenGL, so that a window may run `measure` in a thread of its own: what it takes is chosen
from a picture by `visible_points` and from a scene by `Illumination`.
"""

import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.core.geometry.bodies import Bodies, bodies_at
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.probe import Probe, irradiance_table, lookup
from milkglass.core.material.library import Material
from milkglass.core.profiles.base import Profiles
from milkglass.core.profiles.dipole import dipoles
from milkglass.core.reference.deviation import Deviation
from milkglass.core.reference.equation import Occluder, direct_exitance
from milkglass.core.reference.sources import SourcePieces, graded_sources, resolved_length
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.lights.sub_lights import DIRECTIONAL

DEFAULT_POINTS = 300
BATCH = 100  # points that share sources: fewer points take fewer sources, more of them share the coarse ones
SUB_LIGHTS = 100  # of a light with a size; a disc has SUB_LIGHTS_A_DEGREE of its diameter
SUB_LIGHTS_A_DEGREE = 4
RAYS = 1 << 15  # cast at a time: a few ms, during which no other Python thread runs


@dataclass(frozen=True, eq=False)
class VisiblePoints:
    """Random pixels of a picture that show the object, and what is there.

    Attributes
    ----------
    rows, columns : (n,) int
        Row 0 at the top.
    positions : (n, 3) float64
        World space, mm.
    exitance : (n, 3) float64
        M of the picture.
    """

    rows: npt.NDArray[np.intp]
    columns: npt.NDArray[np.intp]
    positions: Array
    exitance: Array


@dataclass(frozen=True, eq=False)
class Illumination:
    """All that lights an object.

    Attributes
    ----------
    lights : tuple of Light
        In world space.
    table : (h, 2h, 3) float array or None
        Irradiance of the environment over normals, F_t included, see `core.light.probe.irradiance_table`.
    to_probe : (3, 3) float64
        World to the environment's frame, row vectors.
    intensity : float
        Of the environment.
    visible : callable, optional
        Share of the environment's light that reaches points (n, 3) with normals (n, 3): (n, 3), as in the picture.
    detail : callable, optional
        Of a surface with colours or relief: sources with the normals that light meets, and factors (n, 3) on E.
    """

    lights: tuple[Light, ...]
    table: npt.NDArray[np.floating] | None
    to_probe: Array
    intensity: float
    visible: Callable[[Array, Array], npt.NDArray[np.floating]] | None = None
    detail: Callable[[SourcePieces], tuple[SourcePieces, Array]] | None = None

    @classmethod
    def of(
        cls,
        lights: tuple[Light, ...],
        eta: float,
        probe: Probe | None = None,
        to_probe: npt.ArrayLike = np.eye(3),
        intensity: float = 1.0,
        visible: Callable[[Array, Array], npt.NDArray[np.floating]] | None = None,
    ) -> "Illumination":
        """Tabulate the environment for a relative index of refraction."""
        table = None if probe is None else irradiance_table(probe.sh, eta)
        return cls(lights, table, np.asarray(to_probe, np.float64), intensity, visible)

    def irradiance(self, occluder: Occluder, sources: SourcePieces, eta: float) -> Array:
        """E that enters at sources, (n, 3): shadows cast by rays, the environment occluded as in pictures."""
        entering, factors = np.zeros((len(sources), 3)), np.float64(1.0)
        if self.detail is not None:
            sources, factors = self.detail(sources)  # type: ignore[assignment]
        where = sources.points, sources.normals, sources.face_normals
        for light in self.lights:
            if not light.is_sharp:
                entering += _soft_irradiance(occluder, sources, light, eta)
            elif light.DISTANT:
                entering += occluder.irradiance(*where, light.vector, light.brightness, eta)
            else:
                entering += occluder.point_irradiance(*where, light.vector, light.brightness, eta)
        if self.table is not None:
            entering += self.surrounding(sources.normals, sources.points)
        return np.asarray(factors * entering)

    def surrounding(self, normals: Array, points: Array | None = None) -> Array:
        """E of the environment that there is, (n, 3): by unit normals alone, or occluded at points (n, 3) too."""
        assert self.table is not None
        entering = self.intensity * lookup(self.table, normals @ self.to_probe)
        if points is not None and self.visible is not None:
            entering *= self.visible(points, normals)
        return np.asarray(entering)


def _soft_irradiance(occluder: Occluder, sources: SourcePieces, light: Light, eta: float) -> Array:
    """E of a light with a size, or a spot light, at sources (n, 3): a ray to each of many sub-lights."""
    where = sources.points, sources.normals, sources.face_normals
    wanted = SUB_LIGHTS_A_DEGREE * light.apparent_deg(0.0) if light.DISTANT else np.inf
    parts = light.sub_lights(int(np.clip(wanted, SUB_LIGHTS_A_DEGREE, SUB_LIGHTS)))
    share, entering = np.array(parts.colour) / len(parts), np.zeros((len(sources), 3))
    for i, vector in enumerate(parts.vectors):
        if parts.kind == DIRECTIONAL:
            entering += occluder.irradiance(*where, vector, share, eta)
            continue
        distance2 = np.square(vector - sources.points).sum(axis=1)  # which a point light divides by
        factor = parts.emission(i, sources.points) * distance2
        entering += factor[:, None] * occluder.point_irradiance(*where, vector, share, eta)
    return entering


@dataclass(frozen=True, eq=False)
class VisibleError:
    """What `measure` finds.

    Attributes
    ----------
    seen : VisiblePoints
    reference : (n, 3) float64
        Equation (1) at the points.
    deviation : Deviation
    n_sources : int
        Pieces of the surface summed for a point.
    """

    seen: VisiblePoints
    reference: Array
    deviation: Deviation
    n_sources: int

    @property
    def shares(self) -> Array:
        """|M - M_ref| over the reference's rms, (n, 3)."""
        size = np.sqrt(np.square(self.reference).mean(axis=0))
        return np.asarray(np.abs(self.seen.exitance - self.reference) / np.where(size > 0.0, size, 1.0))

    @property
    def at_points(self) -> Array:
        """|M - M_ref| of the worst channel over the reference's rms in that channel, (n,)."""
        return np.asarray(self.shares.max(axis=1))


def visible_points(
    alpha: npt.NDArray[np.floating],
    position: npt.NDArray[np.floating],
    exitance: npt.NDArray[np.floating],
    count: int = DEFAULT_POINTS,
    seed: int = 0,
) -> VisiblePoints:
    """Choose pixels that show the object, each as likely, without repeats; all if there are fewer than `count`.

    Parameters
    ----------
    alpha : (H, W) array
        1 where the pixel shows the object. Other pixels are not chosen.
    position, exitance : (H, W, 3) arrays
        Of a picture of one sample a pixel: the mean over several is no point of the surface.
    count : int
        >= 1.
    seed : int

    Raises
    ------
    InputError
        If no pixel shows the object.
    """
    rows, columns = np.nonzero(alpha >= 1.0)
    if len(rows) == 0:
        raise InputError("the picture does not show the object, so it has no error; move the camera or enlarge it")
    chosen = np.random.default_rng(seed).choice(len(rows), min(count, len(rows)), replace=False)
    rows, columns = rows[chosen], columns[chosen]
    found = position[rows, columns].astype(np.float64), exitance[rows, columns].astype(np.float64)
    return VisiblePoints(rows, columns, *found)


def measure(
    seen: VisiblePoints,
    mesh: Mesh,
    illumination: Illumination,
    material: Material,
    progress: Callable[[float], None] | None = None,
    threads: int = 0,
    occluder: Occluder | None = None,
    bodies: Bodies | None = None,
    profiles: Profiles | None = None,
) -> VisibleError:
    """Sum equation (1) at visible points and compare.

    Parameters
    ----------
    seen : from `visible_points`
    mesh, illumination, material
        What the picture shows.
    progress : callable, optional
        Called with the finished share, in [0, 1], several times a second, by one thread at a time; what it raises
        ends the work.
    threads : int
        0 takes all cores.
    occluder : Occluder, optional
        Of the mesh, where it has been made before.
    bodies : Bodies, optional
        Of the mesh, where each scatters light alone: the sum at a point then runs over its own body.
    profiles : R, G and B, optional
        Of the material; the standard dipole's if not given.
    """
    profiles, say = profiles or dipoles(material), progress or (lambda _: None)
    bright = [resolved_length(p) for p in profiles if not p.is_black]
    occluder, count = occluder or Occluder(mesh), len(seen.positions)
    reference, n_sources = np.zeros((count, 3)), 0
    before = 0  # points of the bodies that are done
    for surface, own in _own_surfaces(mesh, seen.positions, bodies) if bright else ():
        order = own[np.argsort(seen.positions[own, 1], kind="stable")]  # neighbours share fine sources
        for start in range(0, len(own), BATCH):
            batch = order[start : start + BATCH]
            points = seen.positions[batch]

            def finished(done: int, start: int = before + start) -> None:
                say(min(1.0, (start + done) / count))

            sources = graded_sources(surface, points, min(bright), lambda finished=finished: finished(0))  # type: ignore[misc]
            flux = np.empty((len(sources), 3))
            for first in range(0, len(sources), RAYS):
                finished(0)
                part = sources[first : first + RAYS]
                flux[first : first + RAYS] = illumination.irradiance(occluder, part, material.eta) * part.areas[:, None]
            reference[batch] = _exitance(points, sources, flux, profiles, threads, finished)
            n_sources = max(n_sources, len(sources))
            finished(len(batch))
        before += len(own)
    return VisibleError(seen, reference, Deviation.of(seen.exitance, reference), n_sources)


def _own_surfaces(mesh: Mesh, points: Array, bodies: Bodies | None) -> Iterator[tuple[Mesh, npt.NDArray[np.intp]]]:
    """Surfaces whose light reaches points (n, 3), and which of the points they are."""
    if bodies is None:
        yield mesh, np.arange(len(points))
        return
    body = bodies_at(mesh, bodies, points)
    for each in np.unique(body):
        yield bodies.submesh(mesh, int(each)), np.flatnonzero(body == each)


def _exitance(
    points: Array,
    sources: SourcePieces,
    flux: Array,
    profiles: Profiles,
    threads: int,
    finished: Callable[[int], None],
) -> Array:
    """`core.reference.equation.direct_exitance`, a share of the points a core; `finished` is told how many are done."""
    threads = threads or os.cpu_count() or 1
    shares = np.array_split(points, 4 * threads)
    done, lock = [0] * len(shares), threading.Lock()

    def work(i: int) -> Array:
        def count(share: float) -> None:
            with lock:
                done[i] = round(share * len(shares[i]))
                finished(sum(done))

        return direct_exitance(shares[i], sources.points, flux, profiles, count, sources.areas)

    with ThreadPoolExecutor(threads) as pool:
        return np.concatenate(list(pool.map(work, range(len(shares)))))
