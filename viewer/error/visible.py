"""Error of a picture's exitance at random visible points, relative to equation (1) summed in float64.

Arrays in, arrays out and no OpenGL, so that a window may run `measure` in another thread: `visible_points` takes its
points from a picture, `Illumination` its light from a scene.
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
BATCH_POINTS = 100  # points that share sources: fewer points need fewer sources, more points share the coarse ones
MAX_SUB_LIGHTS = 100  # of a light with a size; a disc has SUB_LIGHTS_A_DEGREE over its diameter
SUB_LIGHTS_A_DEGREE = 4
RAYS_AT_A_TIME = 1 << 15  # a few ms, during which no other Python thread runs


@dataclass(frozen=True, eq=False)
class VisiblePoints:
    """Random pixels of a picture that show the object, with position and exitance.

    Attributes
    ----------
    rows, columns : (n,) int
        Row 0 at the top.
    positions : (n, 3) float64
        World space, mm.
    exitance : (n, 3) float64
        Exitance M of the picture.
    """

    rows: npt.NDArray[np.intp]
    columns: npt.NDArray[np.intp]
    positions: Array
    exitance: Array


@dataclass(frozen=True, eq=False)
class Illumination:
    """Illumination of an object by lights and an environment.

    Attributes
    ----------
    lights : tuple of Light
        In world space.
    table : (h, 2h, 3) float array or None
        Irradiance of the environment over normals, F_t included, see `core.light.probe.irradiance_table`.
    to_probe : (3, 3) float64
        Rotation from world space to the frame of the environment, row vectors.
    intensity : float
        Factor on the environment.
    visible : callable, optional
        Returns the visible share (n, 3) of the environment from points and normals, (n, 3) each, as in the picture.
    detail : callable, optional
        Returns sources with the normals of a surface's relief, and factors (n, 3) on E by its colours and relief.
    again, again_behind : callable, optional
        Return E (n, 3) of light that left the object and enters it again, from points and normals, as in the picture:
        there, and on the other side of the object.
    """

    lights: tuple[Light, ...]
    table: npt.NDArray[np.floating] | None
    to_probe: Array
    intensity: float
    visible: Callable[[Array, Array], npt.NDArray[np.floating]] | None = None
    detail: Callable[[SourcePieces], tuple[SourcePieces, Array]] | None = None
    again: Callable[[Array, Array], Array] | None = None
    again_behind: Callable[[Array, Array], Array] | None = None

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
        """Return the illumination with the environment tabulated for a relative index of refraction."""
        table = None if probe is None else irradiance_table(probe.sh, eta)
        return cls(lights, table, np.asarray(to_probe, np.float64), intensity, visible)

    def irradiance(self, occluder: Occluder, sources: SourcePieces, eta: float) -> Array:
        """Return E at sources, (n, 3), F_t included: shadows by rays, the environment occluded as in pictures."""
        entering, factors = np.zeros((len(sources), 3)), np.float64(1.0)
        if self.detail is not None:
            sources, factors = self.detail(sources)  # type: ignore[assignment]
        surface = sources.points, sources.normals, sources.face_normals
        for light in self.lights:
            if not light.is_sharp:
                entering += _soft_irradiance(occluder, sources, light, eta)
            elif light.DISTANT:
                entering += occluder.irradiance(*surface, light.vector, light.brightness, eta)
            else:
                entering += occluder.point_irradiance(*surface, light.vector, light.brightness, eta)
        if self.table is not None:
            entering += self.surrounding(sources.normals, sources.points)
        if self.again is not None:
            entering += self.again(sources.points, sources.normals)
        return np.asarray(factors * entering)

    def surrounding(self, normals: Array, points: Array | None = None) -> Array:
        """Return E of the environment, (n, 3), by unit normals (n, 3); occluded where points (n, 3) are given."""
        assert self.table is not None
        entering = self.intensity * lookup(self.table, normals @ self.to_probe)
        if points is not None and self.visible is not None:
            entering *= self.visible(points, normals)
        return np.asarray(entering)


def _soft_irradiance(occluder: Occluder, sources: SourcePieces, light: Light, eta: float) -> Array:
    """Return E at sources, (n, 3), of a light with a size or a spot light, by a ray to each of many sub-lights."""
    surface = sources.points, sources.normals, sources.face_normals
    n_sub_lights = SUB_LIGHTS_A_DEGREE * light.apparent_deg(0.0) if light.DISTANT else np.inf
    sub_lights = light.sub_lights(int(np.clip(n_sub_lights, SUB_LIGHTS_A_DEGREE, MAX_SUB_LIGHTS)))
    share, entering = np.array(sub_lights.colour) / len(sub_lights), np.zeros((len(sources), 3))
    for i, vector in enumerate(sub_lights.vectors):
        if sub_lights.kind == DIRECTIONAL:
            entering += occluder.irradiance(*surface, vector, share, eta)
            continue
        distance2 = np.square(vector - sources.points).sum(axis=1)  # by which a point light divides
        factor = sub_lights.emission(i, sources.points) * distance2
        entering += factor[:, None] * occluder.point_irradiance(*surface, vector, share, eta)
    return entering


@dataclass(frozen=True, eq=False)
class VisibleError:
    """Error at visible points, as `measure` returns it.

    Attributes
    ----------
    points : VisiblePoints
        Points with the exitance of the picture.
    reference : (n, 3) float64
        Exitance by equation (1) at the points.
    deviation : Deviation
    n_sources : int
        Number of pieces of the surface summed at a point.
    """

    points: VisiblePoints
    reference: Array
    deviation: Deviation
    n_sources: int

    @property
    def shares(self) -> Array:
        """|M - M_ref| over the rms of the reference, (n, 3)."""
        size = np.sqrt(np.square(self.reference).mean(axis=0))
        return np.asarray(np.abs(self.points.exitance - self.reference) / np.where(size > 0.0, size, 1.0))

    @property
    def at_points(self) -> Array:
        """Largest |M - M_ref| of the channels, each over the rms of the reference, (n,)."""
        return np.asarray(self.shares.max(axis=1))


def visible_points(
    alpha: npt.NDArray[np.floating],
    position: npt.NDArray[np.floating],
    exitance: npt.NDArray[np.floating],
    count: int = DEFAULT_POINTS,
    seed: int = 0,
) -> VisiblePoints:
    """Return pixels that show the object, chosen uniformly without replacement; all if fewer than `count` do.

    Parameters
    ----------
    alpha : (H, W) array
        1 where the pixel shows the object.
    position, exitance : (H, W, 3) arrays
        From a picture of one sample a pixel: means over several samples are not on the surface.
    count : int
        Number of points, >= 1.
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
    values = position[rows, columns].astype(np.float64), exitance[rows, columns].astype(np.float64)
    return VisiblePoints(rows, columns, *values)


def measure(  # noqa: PLR0913
    visible: VisiblePoints,
    mesh: Mesh,
    illumination: Illumination,
    material: Material,
    progress: Callable[[float], None] | None = None,
    threads: int = 0,
    occluder: Occluder | None = None,
    bodies: Bodies | None = None,
    profiles: Profiles | None = None,
) -> VisibleError:
    """Return the error of exitance at visible points relative to equation (1).

    Parameters
    ----------
    visible : VisiblePoints
    mesh : Mesh
    illumination : Illumination
    material : Material
        Object, light and material of the picture.
    progress : callable, optional
        Called with the finished share, in [0, 1], several times a second, by one thread at a time; what it raises
        ends the work.
    threads : int
        Number of threads; 0 takes all cores.
    occluder : Occluder, optional
        Occluder of the mesh, if there is one already.
    bodies : Bodies, optional
        Bodies that scatter light separately: the sum at a point is then over its body.
    profiles : Profiles, optional
        Profiles of R, G and B; standard dipoles of the material if not given.
    """
    profiles, report = profiles or dipoles(material), progress or (lambda _: None)
    bright = [resolved_length(p) for p in profiles if not p.is_black]
    occluder, count = occluder or Occluder(mesh), len(visible.positions)
    reference, n_sources = np.zeros((count, 3)), 0
    n_before = 0  # number of points of finished bodies
    for surface, indices in _scattering_surfaces(mesh, visible.positions, bodies) if bright else ():
        order = indices[np.argsort(visible.positions[indices, 1], kind="stable")]  # neighbours share fine sources
        for start in range(0, len(indices), BATCH_POINTS):
            batch = order[start : start + BATCH_POINTS]
            points = visible.positions[batch]

            def count_done(n_done: int, start: int = n_before + start) -> None:
                report(min(1.0, (start + n_done) / count))

            sources = graded_sources(surface, points, min(bright), lambda count_done=count_done: count_done(0))  # type: ignore[misc]
            flux = np.empty((len(sources), 3))
            for first in range(0, len(sources), RAYS_AT_A_TIME):
                count_done(0)
                chunk = sources[first : first + RAYS_AT_A_TIME]
                flux[first : first + RAYS_AT_A_TIME] = (
                    illumination.irradiance(occluder, chunk, material.eta) * chunk.areas[:, None]
                )
            reference[batch] = _exitance(points, sources, flux, profiles, threads, count_done)
            n_sources = max(n_sources, len(sources))
            count_done(len(batch))
        n_before += len(indices)
    return VisibleError(visible, reference, Deviation.of(visible.exitance, reference), n_sources)


def _scattering_surfaces(
    mesh: Mesh, points: Array, bodies: Bodies | None
) -> Iterator[tuple[Mesh, npt.NDArray[np.intp]]]:
    """Yield surfaces that scatter light together, with the indices of points (n, 3) on them."""
    if bodies is None:
        yield mesh, np.arange(len(points))
        return
    body = bodies_at(mesh, bodies, points)
    for index in np.unique(body):
        yield bodies.submesh(mesh, int(index)), np.flatnonzero(body == index)


def _exitance(
    points: Array,
    sources: SourcePieces,
    flux: Array,
    profiles: Profiles,
    threads: int,
    count_done: Callable[[int], None],
) -> Array:
    """Return `direct_exitance` of points, distributed over threads; count_done(n) is called with finished points."""
    threads = threads or os.cpu_count() or 1
    shares = np.array_split(points, 4 * threads)
    n_done, lock = [0] * len(shares), threading.Lock()

    def work(i: int) -> Array:
        def count(share: float) -> None:
            with lock:
                n_done[i] = round(share * len(shares[i]))
                count_done(sum(n_done))

        return direct_exitance(shares[i], sources.points, flux, profiles, count, sources.areas)

    with ThreadPoolExecutor(threads) as pool:
        return np.concatenate(list(pool.map(work, range(len(shares)))))
