"""First collisions of light from all around: thin parts let some of it through, and let out that much less.

Of light that enters at a point of the surface from all around, the share e collides before it leaves. Light that leaves
there has come the other way: what a ray backwards from there would have met. So where matter is thin fluence is larger
for what it lets out,

    M = e phi / (2 A),

and with e the diffusion of even light in matter that absorbs nothing has the solution that it must have, M = e E. The
curvature of the surface counts by way of the second moment of the free path, 1 - (1 + x + x^2 / 2) e^-x up to a
distance of x mean free paths, of which light comes up from within the object.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Float32, Int32
from milkglass.core.geometry.mesh import Mesh, face_normals
from milkglass.core.geometry.normals import across
from milkglass.core.light.casting import Casting
from milkglass.core.light.vertex_rays import GOLDEN, LIFT
from milkglass.core.material.fresnel import reflectance, row_of, transmittance
from milkglass.core.material.medium import Medium
from milkglass.core.material.refraction import LONGEST_CHORD
from milkglass.core.threads import Recent
from milkglass.core.transport.diffusion.patches import Patches

DIRECTIONS = 64  # into the hemisphere below a patch, and out of it: of the inner ones light takes those it is bent to
INDICES = 1.3, 1.5  # least and largest index that paths are followed for at first; one beyond has them followed anew
EXITS, MOSTLY = 2, 0.5  # times that some of a path's light leaves; F_r from which on none does
EVENTS = 16  # surfaces that a path meets
DENSE = 2e-3  # share of light that crosses parts, along normals, below which all collides
KEPT = 3  # indices
KEPT_MEDIA = 8  # those of a material, and the free paths of even light beside them
LEAST_SHARE = 0.2  # that collides: less counts as this
COSINES = 4096  # of tables of Fresnel's factors
PATCHES_AT_A_TIME = 1024
ROUNDING = np.finfo(np.float32).eps  # of shares: next to no matter, of which only that is left
ENDLESS = 1e30  # mm: a way that light never gets through, which of no matter at all is no mean free path long


class Collisions(NamedTuple):
    """What of light from all around collides below patches, (n,) each.

    Attributes
    ----------
    share : (n,) float64
        That collides before it leaves, [0, 1].
    curved : (n,) float64
        Share of the second moment of its free path that is within the object, [0, 1].
    towards : (n,) float64
        What leaves towards the object itself over what leaves, by directions: that share of light from there over
        `share`. Between petals it goes straight across, where they are thinnest.
    """

    share: Array
    curved: Array
    towards: Array

    def concentration(self, areas: Array) -> Array:
        """Return fluence over that which lets out as much in thick matter, (n,) >= 1: 1 / e.

        Where next to nothing collides in all of the object the equation is all but singular, and it stays as it is.
        """
        clear = min(1.0, float(areas @ self.share / (LEAST_SHARE * areas.sum())))
        return np.asarray(1.0 + clear * (1.0 / np.maximum(self.share, LEAST_SHARE) - 1.0))

    def bent(self, bending: Array, areas: Array) -> Array:
        """Return the extrapolation length over that of a flat and thick object, from that of a thick one, (n,)."""
        return np.asarray((1.0 + (bending - 1.0) * self.curved) * self.concentration(areas))


class FirstCollisions:
    """First collisions of light that enters a surface's n patches from all around.

    Parameters
    ----------
    areas : (n,) float64
        mm^2.
    thickness : (n,) float64
        Along the normals, mm; 0 where there is none.
    exits : callable
        Returns where light leaves that does not collide, for an index of refraction; None where that is not known.
    """

    def __init__(self, areas: Array, thickness: Array, exits: "Callable[[float], Exits | None]") -> None:
        self._areas, self._thickness, self._exits = areas, thickness, exits
        self._kept = Recent[tuple[float, float], Collisions | None](KEPT_MEDIA)

    def of(self, medium: Medium) -> Collisions | None:
        """Return what collides in a medium; None where next to all does, or no paths are known."""
        return self._kept.of((medium.eta, medium.sigma_t_prime), lambda: self._found(medium))

    def _found(self, medium: Medium) -> Collisions | None:
        areas, thickness = self._areas, np.where(self._thickness > 0.0, self._thickness, ENDLESS)
        if areas @ np.exp(-medium.sigma_t_prime * thickness) < DENSE * areas.sum():
            return None
        exits = self._exits(medium.eta)
        if exits is None:
            return None
        lengths, shares, meets, weights = exits
        free_paths = np.minimum(np.float32(medium.sigma_t_prime) * lengths, LONGEST_CHORD)
        left = shares * np.exp(-free_paths)
        beyond = left * (1.0 + free_paths * (1.0 + 0.5 * free_paths))
        share, curved = (1.0 - part.sum(axis=(0, 1), dtype=np.float64) for part in (left, beyond))
        colliding = weights[:, None] - left.sum(axis=0)
        # Few rays that meet the object count with one of all.
        one = 1.0 / len(weights)
        from_object = np.einsum("ij,ij->j", meets, colliding, dtype=np.float64) + one * share
        towards = from_object / ((one + weights @ meets) * np.maximum(share, ROUNDING))
        return Collisions(share, curved, towards)


class Exits(NamedTuple):
    """Where light that has entered n patches along m directions leaves, without collisions.

    Attributes
    ----------
    lengths, shares : (EXITS, m, n) float32
        Ways through matter, mm, and shares of the light that has entered a patch.
    meets : (m, n) float32
        1 where the ray outside comes from the object itself, 0 elsewhere.
    weights : (m,) float32
        Share of the light that takes each direction.
    """

    lengths: Float32
    shares: Float32
    meets: Float32
    weights: Float32

    def at(self, patches: npt.NDArray[np.intp]) -> "Exits":
        """Return them for some of the patches."""
        return Exits(self.lengths[..., patches], self.shares[..., patches], self.meets[:, patches], self.weights)


class InnerPaths:
    """Straight paths of light through matter from a surface's n patches, followed when they are first asked for.

    Parameters
    ----------
    mesh : Mesh
    patches : Patches
    """

    def __init__(self, mesh: Mesh, patches: Patches) -> None:
        self.patches, self._mesh = patches, mesh
        self._paths, self._exits = Recent[tuple[float, float], _Paths](1), Recent[float, Exits](KEPT)
        self._known: tuple[float, float] | None = None  # least and largest index of the paths

    def exits(self, eta: float) -> Exits:
        """Return where light leaves for an index of refraction, >= 1."""
        return self._exits.of(eta, lambda: self._followed(eta).exits(eta))

    def are_known(self, eta: float) -> bool:
        """Whether paths have been followed that serve for an index of refraction."""
        known = self._known
        return known is not None and known[0] <= eta <= known[1]

    def _followed(self, eta: float) -> "_Paths":
        known = least, most = min(eta, INDICES[0]), max(eta, INDICES[1])
        paths = self._paths.of(known, lambda: _Paths(self._mesh, self.patches, least, most))
        self._known = known
        return paths


class _Paths:
    """Straight paths through matter from n patches, mirrored where they meet the surface, whatever its index.

    An index bends light into directions along a spiral that is cut off at the critical angle, and says how much leaves
    at each meeting; where the paths lead is the mesh's alone. A path ends where light of the largest index has left
    `EXITS` times, or where the mesh has a hole.

    Parameters
    ----------
    mesh : Mesh
    patches : Patches
    least, most : float
        Indices of refraction, >= 1, between which they serve.
    """

    def __init__(self, mesh: Mesh, patches: Patches, least: float, most: float) -> None:
        n = len(patches)
        self._rays, self._lift = mesh.rays, np.float32(LIFT * mesh.radius)
        self._normals = face_normals(mesh.vertices, mesh.faces).astype(np.float32)
        self._windows = [_window(eta) for eta in (least, most)]  # cosines from which on light leaves
        inwards, outwards = _spiral(_count(least)) * np.array([1.0, 1.0, -1.0], np.float32), _spiral(DIRECTIONS)
        self._meets = np.empty((DIRECTIONS, n), bool)
        starts, casting = range(0, n, PATCHES_AT_A_TIME), Casting(n, lambda _: None, None)

        def cast(start: int) -> list[tuple[Int32, Float32, Float32]]:
            chosen = slice(start, start + PATCHES_AT_A_TIME)
            normals, places = (part[chosen].astype(np.float32) for part in (patches.face_normals, patches.on_surface))
            axes = [
                axis.astype(np.float32)
                for axis in (*across(patches.face_normals[chosen]), patches.face_normals[chosen])
            ]
            above = _along(outwards, axes)
            origins = np.tile(places + self._lift * normals, (DIRECTIONS, 1))
            self._meets[:, chosen] = self._rays.occluded(origins, above).reshape(DIRECTIONS, -1)
            below = _along(inwards, axes)
            return self._meetings(np.tile(places - self._lift * normals, (len(inwards), 1)), below)

        self._blocks = list(zip(starts, casting.run(cast, starts), strict=True))

    def _meetings(self, starts: Float32, directions: Float32) -> list[tuple[Int32, Float32, Float32]]:
        """Return, meeting by meeting, which paths light may leave at, cosines there and lengths so far, mm."""
        (possible, certain), found = self._windows, []
        paths, along = np.arange(len(starts), dtype=np.int32), np.zeros(len(starts), np.float32)
        left = np.zeros(len(starts), np.int8)
        for _ in range(EVENTS):
            face, distance = self._rays.first(starts, directions)
            met = np.flatnonzero(face >= 0)
            distance32, normals = distance[met].astype(np.float32), self._normals[face[met]]
            paths, directions, left = paths[met], directions[met], left[met]
            along = along[met] + distance32 + self._lift
            cosines = np.einsum("ij,ij->i", directions, normals)
            leaves = np.flatnonzero(cosines >= possible)
            found.append((paths[leaves], cosines[leaves], along[leaves]))
            left += cosines >= certain
            on = np.flatnonzero(left < EXITS)
            normals = normals[on]
            starts = starts[met[on]] + distance32[on, None] * directions[on] - self._lift * normals
            # A face seen from its wrong side, of parts that overlap or are folded, is passed.
            directions = directions[on] - 2.0 * np.maximum(cosines[on], 0.0)[:, None] * normals
            paths, along, left = paths[on], along[on], left[on]
        return found

    def exits(self, eta: float) -> Exits:
        """Return where light leaves for an index of refraction."""
        count, n = _count(eta), self._meets.shape[1]
        table = reflectance(1.0 / eta, np.linspace(0.0, 1.0, COSINES + 1)).astype(np.float32)
        # Flux that enters up to the borders of each direction's share of the disc, which Fresnel's factor weights.
        sines2 = (np.arange(COSINES) + 0.5) / COSINES
        entering = np.cumsum(transmittance(eta, np.sqrt(1.0 - sines2)))
        borders = np.append(eta * eta * np.arange(count) / DIRECTIONS, 1.0)
        weights = np.diff(np.interp(borders, np.arange(COSINES + 1) / COSINES, [0.0, *entering / entering[-1]]))
        weights = weights.astype(np.float32)
        lengths, shares = np.empty((2, EXITS, count, n), np.float32)
        for start, meetings in self._blocks:
            chosen = slice(start, start + PATCHES_AT_A_TIME)
            size = len(range(n)[chosen])
            of_block = _left(meetings, count * size, table)
            lengths[..., chosen], shares[..., chosen] = (part.reshape(EXITS, count, size) for part in of_block)
        shares *= weights[:, None]
        # What goes in has come from the opposite side.
        inside, outside = _spiral(count)[:, :2], _spiral(DIRECTIONS)[:, :2]
        inside *= -np.minimum(eta, 1.0 / np.linalg.norm(inside, axis=1))[:, None]
        nearest = np.linalg.norm(inside[:, None] - outside, axis=2).argmin(axis=1)
        return Exits(lengths, shares, self._meets[nearest].astype(np.float32), weights)


def _left(meetings: list[tuple[Int32, Float32, Float32]], n: int, table: Float32) -> tuple[Float32, Float32]:
    """Return where light of the first n paths leaves by a table of F_r from inside: lengths, shares, (EXITS, n) each.

    Of a path that is not reflected totally the rest goes on to where it meets the surface next. Nothing is left to
    chance, so that neighbours are alike. Lengths are `ENDLESS` where light does not leave.
    """
    lengths, shares = np.full((EXITS, n), ENDLESS, np.float32), np.zeros((EXITS, n), np.float32)
    kept, exits = np.ones(n, np.float32), np.zeros(n, np.intp)
    for paths, cosines, along in meetings:
        used = int(np.searchsorted(paths, n))
        reflected = table[row_of(cosines[:used], COSINES)]
        left = np.flatnonzero((reflected < MOSTLY) & (exits[paths[:used]] < EXITS))
        path, reflected = paths[left], reflected[left]
        times = exits[path]
        lengths[times, path] = along[left]
        shares[times, path] = kept[path] * np.where(times == EXITS - 1, np.float32(1.0), 1.0 - reflected)
        kept[path] *= reflected
        exits[path] += 1
    return lengths, shares


def _count(eta: float) -> int:
    """Return how many of `DIRECTIONS` inwards light takes that an index bends to the normal."""
    return max(1, int(DIRECTIONS / eta**2))


def _window(eta: float) -> float:
    """Return the cosine inside from which on less than `MOSTLY` is reflected."""
    cosines = np.linspace(0.0, 1.0, COSINES + 1)
    return float(cosines[np.argmax(reflectance(1.0 / eta, cosines) < MOSTLY)]) - 0.5 / COSINES


def _spiral(count: int) -> Float32:
    """Return the first of `DIRECTIONS` of a density like the cosine, (count, 3): from the axis z on."""
    steps = np.arange(count)
    sines2, angles = np.minimum((steps + 0.5) / DIRECTIONS, 1.0), 2.0 * np.pi * GOLDEN * steps
    sines = np.sqrt(sines2)
    return np.stack([sines * np.cos(angles), sines * np.sin(angles), np.sqrt(1.0 - sines2)], axis=1).astype(np.float32)


def _along(directions: Float32, axes: list[Float32]) -> Float32:
    """Return directions, (m, 3), in the frames of patches, three axes (n, 3): (m n, 3), direction by direction."""
    return np.asarray(
        sum(part[:, None, None] * axis for part, axis in zip(directions.T, axes, strict=True)), np.float32
    ).reshape(-1, 3)
