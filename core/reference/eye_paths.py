"""Monte Carlo transport from the eye: the radiance of pixels, by paths that end where they meet a light.

The reference of whole pictures, where photons are that of exitance (`core.reference.photons`). Nothing is approximated:
surfaces mirror and refract by the Fresnel equations, with smooth normals, matter scatters by the phase function of
Henyey and Greenstein, light that leaves may enter again. A path ends at a light, or by roulette, and is told apart by
what it has met on its way (`PARTS`). It shares no loop with the paths of pictures (`core.paths`), which part where
these choose, and gather where these wander.

R, G and B share paths. Flights are drawn for one of the three, chosen at random, and count for each by its share of the
densities with which all three would have drawn the path (balance heuristic: Veach and Guibas 1995; Wilkie et al. 2014,
Hero Wavelength Spectral Sampling): no weight exceeds 3.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

from milkglass.core.arrays import Array, Bools, Floats, Ints
from milkglass.core.geometry.mesh import Mesh, face_normals
from milkglass.core.material import fresnel
from milkglass.core.reference.phase import henyey_greenstein, phase, turned

PARTS = ("mirror", "unscattered", "once", "often")
BATCH = 1 << 14  # paths that begin together, which the caches hold
MOST_STEPS = 100_000  # of a path: nobody waits for more
ROULETTE_WEIGHT, SURVIVOR_WEIGHT = 0.1, 0.5  # weight below which roulette is played, and the weight of survivors
OFFSET = 1e-5  # radii of the object from a face at which paths go on


class SeenLight(Protocol):
    """A light, far away or near."""

    def arriving(self, directions: Array, places: Array) -> Array:
        """Return R, G and B that come from unit directions (n, 3) to places (n, 3), mm: (n, 3)."""


@dataclass(frozen=True, eq=False)
class LitObject:
    """What paths meet.

    Attributes
    ----------
    mesh : Mesh
        Closed, of smooth vertex normals.
    sigma_s, sigma_a, anisotropy : (3,) float64
        Scattering and absorption of R, G and B, 1/mm; mean cosine g of scattering. Reduced coefficients go with 0.
    eta : float
        Relative index of refraction, > 0.
    lights : of any number
    peak : (3,) float64
        Share of all scattering, the most forward, that counts as none where paths are told apart, in [0, 1).
    """

    mesh: Mesh
    sigma_s: Array
    sigma_a: Array
    anisotropy: Array
    eta: float
    lights: Sequence[SeenLight]
    peak: Array

    @property
    def collisions(self) -> float:
        """Return about how often light loses its course in it, at most: eta^2 4 V / S is the mean way through it.

        Exact of isotropic scattering of light from all around without absorption (Blanco and Fournier 2003); what
        absorbs ends sooner, and what scatters forward keeps its course (reduced coefficients).
        """
        extinction = self.sigma_s * (1.0 - self.anisotropy) + self.sigma_a
        length, absorbed = extinction * self.eta**2 * self.mesh.mean_chord, self.sigma_a / np.maximum(extinction, 1e-30)
        return float(np.max(length / (1.0 + length * absorbed)))


def traced(
    lit: LitObject, origins: Array, directions: Array, groups: Ints, count: int, rng: np.random.Generator
) -> tuple[Array, float]:
    """Return the sums of radiance that paths of each group find, (count, len(PARTS), 3), and the share that is lost.

    Parameters
    ----------
    lit : LitObject
    origins, directions : (n, 3)
        From the eye, outside of the object, mm; unit. Paths that do not meet the object find nothing.
    groups : (n,) int
        Of each path, 0 to count - 1.
    count : int
    rng : Generator
    """
    walk, sums, lost = _Walk(lit, rng), np.zeros((count, len(PARTS), 3)), 0.0
    for start in range(0, len(origins), BATCH):
        batch = slice(start, start + BATCH)
        lost += walk.add(_Paths.begun(rng, origins[batch], directions[batch], groups[batch]), sums)
    return sums, lost / max(len(origins), 1)


@dataclass(eq=False)
class _Paths:
    """Paths on their way, n of them: places and directions (n, 3), others (n,) where nothing else is said."""

    places: Array
    directions: Array
    shares: Array  # of the densities with which R, G and B would have drawn the path, (n, 3); they sum to 1
    weights: Array
    channels: Ints  # for which flights are drawn
    orders: Ints  # of scattering
    counts: Ints  # of what counts as such in R, G and B, (n, 3)
    mirrored: Bools  # where they met the object first
    inside: Bools
    groups: Ints

    @classmethod
    def begun(cls, rng: np.random.Generator, origins: Array, directions: Array, groups: Ints) -> "_Paths":
        n = len(origins)
        none, channels = np.zeros(n, np.bool_), rng.integers(0, 3, n)
        return cls(
            np.array(origins, np.float64), np.array(directions, np.float64), np.full((n, 3), 1.0 / 3.0), np.ones(n),
            channels, np.zeros(n, np.int64), np.zeros((n, 3), np.int64), none, none.copy(),
            np.asarray(groups, np.int64),
        )  # fmt: skip

    def chosen(self, index: Ints | Bools) -> "_Paths":
        return _Paths(*(getattr(self, item.name)[index] for item in fields(self)))

    def joined(self, further: "_Paths") -> "_Paths":
        return _Paths(
            *(np.concatenate([getattr(self, item.name), getattr(further, item.name)]) for item in fields(self))
        )


class _Walk:
    """Walks paths to their ends."""

    def __init__(self, lit: LitObject, rng: np.random.Generator) -> None:
        mesh = lit.mesh
        self._lit, self._rng = lit, rng
        self._extinction = lit.sigma_s + lit.sigma_a
        self._albedo = np.divide(lit.sigma_s, self._extinction, out=np.zeros(3), where=self._extinction > 0.0)
        self._rays, self._offset = mesh.rays, OFFSET * mesh.radius
        self._planes = face_normals(mesh.vertices, mesh.faces)
        self._forward = henyey_greenstein(1.0 - lit.peak, lit.anisotropy)  # cosines beyond are the peak's

    def add(self, paths: _Paths, sums: Array) -> float:
        """Add what paths find to the sums of their groups, and return the weight that is lost at edges."""
        lost, first = 0.0, True
        for _ in range(MOST_STEPS):
            if len(paths.weights) == 0:
                return lost
            starts, directions = paths.places.astype(np.float32), paths.directions.astype(np.float32)
            hits, reach, u, v = self._rays.places(starts, directions)
            face, distance = hits.astype(np.int64), np.where(hits < 0, np.inf, reach.astype(np.float64))
            flight = self._flights(paths)
            collides = flight < distance
            free = ~collides & (face < 0)
            lost += float(paths.weights[free & paths.inside].sum())
            if not first:
                self._arrive(paths.chosen(free & ~paths.inside), sums)
            self._advance(paths, np.where(free, 0.0, np.minimum(flight, distance)), collides)
            scattered = self._scattered(paths.chosen(collides))
            met = ~collides & ~free
            onwards, leaked = self._met(paths.chosen(met), face[met], u[met], v[met], splits=first)
            lost, first = lost + leaked, False
            paths = scattered.joined(onwards)
        return lost + float(paths.weights.sum())

    def _flights(self, paths: _Paths) -> Array:
        """Return how far each path goes to its next collision, infinite outside."""
        extinction = np.where(paths.inside, self._extinction[paths.channels], 0.0)
        depths = -np.log1p(-self._rng.random(len(extinction)))
        never = np.full(len(extinction), np.inf)
        return np.asarray(np.divide(depths, extinction, out=never, where=extinction > 0.0))

    def _advance(self, paths: _Paths, distance: Array, collides: Bools) -> None:
        """Move paths on, and count what each channel thinks of it."""
        paths.places += distance[:, None] * paths.directions
        thickness = np.where(paths.inside, distance, 0.0)[:, None] * self._extinction
        density = np.exp(thickness.min(axis=1, keepdims=True) - thickness)
        density[collides] *= self._extinction
        paths.shares = _normalised(paths.shares * density)

    def _scattered(self, paths: _Paths) -> _Paths:
        """Return what is left of paths that have collided, in new directions."""
        rng, g = self._rng, self._lit.anisotropy
        n = len(paths.weights)
        cosine = henyey_greenstein(rng.random(n), g[paths.channels])
        paths.shares = _normalised(paths.shares * phase(cosine[:, None], g))
        paths.directions = turned(paths.directions, cosine, rng)
        paths.orders += 1
        paths.counts += cosine[:, None] <= self._forward
        value = paths.weights * self._counted(paths).max(axis=1)
        faint = value < ROULETTE_WEIGHT
        chance = np.where(faint, value / SURVIVOR_WEIGHT, 1.0)
        survives = rng.random(n) < chance
        paths.weights /= np.maximum(chance, np.finfo(np.float64).tiny)
        return paths.chosen(survives)

    def _counted(self, paths: _Paths) -> Array:
        """Return what radiance counts for in each channel, (n, 3), but for the weight."""
        return np.asarray(3.0 * paths.shares * self._albedo ** paths.orders[:, None])

    def _arrive(self, paths: _Paths, sums: Array) -> None:
        """Add the light that paths see which leave for good."""
        if len(paths.weights) == 0:
            return
        radiance = np.sum([light.arriving(paths.directions, paths.places) for light in self._lit.lights], axis=0)
        found = paths.weights[:, None] * self._counted(paths) * radiance
        part = np.where(paths.mirrored[:, None], 0, 1 + np.minimum(paths.counts, 2))
        np.add.at(sums, (paths.groups[:, None], part, np.arange(3)), found)

    def _met(self, paths: _Paths, faces: Ints, u: Floats, v: Floats, *, splits: bool) -> tuple[_Paths, float]:
        """Return paths mirrored or refracted where they meet the surface, and the weight of those on the wrong side.

        The first time paths split, and both go on by their share.
        """
        mesh, eta = self._lit.mesh, self._lit.eta
        side = np.where(paths.inside, -1.0, 1.0)[:, None]
        planes = side * self._planes[faces]
        weights = np.stack([1.0 - u - v, u, v], axis=1).astype(np.float64)
        normals = side * np.einsum("nk,nkc->nc", weights, mesh.normals[mesh.faces[faces]].astype(np.float64))
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
        right = _dot(paths.directions, planes) < 0.0
        leaked = float(paths.weights[~right].sum())
        turned = _dot(paths.directions, normals) >= 0.0  # a smooth normal may face away, its face does not
        normals = np.where(turned[:, None], planes, normals)
        beyond = np.where(paths.inside, 1.0 / eta, eta)
        reflected = np.where(
            paths.inside,
            fresnel.reflectance(1.0 / eta, -_dot(paths.directions, normals)),
            fresnel.reflectance(eta, -_dot(paths.directions, normals)),
        )
        mirrored = _mirrored(paths.directions, normals, planes)
        refracted = _refracted(paths.directions, normals, planes, beyond)
        mirrors = right if splits else right & (self._rng.random(len(reflected)) < reflected)
        enters = right & (reflected < 1.0) if splits else right & ~mirrors
        back, through = paths.chosen(mirrors), paths.chosen(enters)
        back.directions, through.directions = mirrored[mirrors], refracted[enters]
        back.places += self._offset * planes[mirrors]
        through.places -= self._offset * planes[enters]
        through.inside = ~through.inside
        if splits:
            back.weights *= reflected[mirrors]
            through.weights *= 1.0 - reflected[enters]
            back.mirrored = np.ones(len(back.weights), np.bool_)
        return back.joined(through), leaked


def _mirrored(directions: Array, normals: Array, planes: Array) -> Array:
    """Return mirrored directions; where a smooth normal sends one below its face, those of the face."""
    smooth, flat = (directions - 2.0 * _dot(directions, of)[:, None] * of for of in (normals, planes))
    return np.where(_dot(smooth, planes)[:, None] > 0.0, smooth, flat)


def _refracted(directions: Array, normals: Array, planes: Array, eta: Array) -> Array:
    """Return refracted directions, `eta` that of the side beyond over this one; likewise."""

    def bent(of: Array) -> Array:
        cosine = -_dot(directions, of)
        along = np.sqrt(np.maximum(0.0, 1.0 - (1.0 - cosine**2) / eta**2))
        out = directions / eta[:, None] + (cosine / eta - along)[:, None] * of
        return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))

    smooth, flat = bent(normals), bent(planes)
    return np.where(_dot(smooth, planes)[:, None] < 0.0, smooth, flat)


def _normalised(shares: Array) -> Array:
    return np.asarray(shares / np.maximum(shares.sum(axis=1, keepdims=True), np.finfo(np.float64).tiny))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", a, b))


Shots = Callable[[np.random.Generator], tuple[Array, Array, Ints]]


@dataclass(frozen=True, eq=False)
class GroupRadiance:
    """Mean radiance of n groups of paths, round by round, so that its noise is known.

    Attributes
    ----------
    rounds : (rounds, n, len(PARTS), 3) float64
        Each an estimate by itself.
    lost : float
        Share of the paths lost at edges.
    """

    rounds: Array
    lost: float

    def of(self, parts: Sequence[str]) -> tuple[Array, Array]:
        """Return the radiance of some parts together, (n, 3), and its standard error."""
        chosen = self.rounds[:, :, [PARTS.index(part) for part in parts]].sum(axis=2)
        return chosen.mean(axis=0), chosen.std(axis=0, ddof=1) / np.sqrt(len(chosen))


def group_radiance(
    lit: LitObject, shots: Shots, count: int, rounds: int, seed: int, progress: Callable[[float], None]
) -> GroupRadiance:
    """Return the radiance of groups of pixels.

    Parameters
    ----------
    lit : LitObject
    shots : callable
        Draws origins, directions and groups of the paths of a round, as of `traced`; some of every group.
    count : int
        Number of groups.
    rounds : int
        >= 2.
    seed : int
    progress : callable
        Called with the finished share, in [0, 1]; what it raises ends the work.
    """
    rng, estimates, lost = np.random.default_rng(seed), np.empty((rounds, count, len(PARTS), 3)), 0.0
    for i in range(rounds):
        progress(i / rounds)
        origins, directions, groups = shots(rng)
        sums, lost_now = traced(lit, origins, directions, groups, count, rng)
        estimates[i] = sums / np.bincount(groups, minlength=count)[:, None, None]
        lost += lost_now / rounds
    progress(1.0)
    return GroupRadiance(estimates, lost)
