"""First collisions of light from all around: thin parts let some of it through, and let out that much less.

Of light that enters at a point of the surface from all around, the share e collides before it leaves. Light that leaves
there has come the other way: what a ray backwards from there would have met. So where matter is thin fluence is larger
for what it lets out,

    M = e phi / (2 A),

and with e the diffusion of even light in matter that absorbs nothing has the solution that it must have, M = e E. The
curvature of the surface counts by way of the second moment of the free path, 1 - (1 + x + x^2 / 2) e^-x up to a
distance of x mean free paths, of which light comes up from within the object.
"""

import threading
from typing import NamedTuple, TypeVar

import numpy as np

from milkglass.core.arrays import Array, Bools, Float32
from milkglass.core.geometry.mesh import Mesh, face_normals
from milkglass.core.geometry.normals import across
from milkglass.core.light.crossing import EXITS, Follower
from milkglass.core.light.vertex_rays import GOLDEN, LIFT
from milkglass.core.material.fresnel import transmittance
from milkglass.core.material.medium import Medium
from milkglass.core.material.refraction import LONGEST_CHORD
from milkglass.core.transport.diffusion.patches import Patches

RAYS = 32  # of a patch, along the same directions to its normal for all
DENSE = 2e-3  # share of light that crosses parts, along normals, below which all collides
KEPT = 3  # of media, and of indices
LEAST_SHARE = 0.2  # that collides: less counts as this
COSINES = 1024  # of their table
PATCHES_AT_A_TIME = 2048

K = TypeVar("K")
V = TypeVar("V")


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

    def bent(self, bending: Array, areas: Array) -> Array:
        """Return the extrapolation length over that of a flat and thick object, from that of a thick one, (n,).

        Where next to nothing collides in all of the object the equation is all but singular, and it stays as it is.
        """
        clear = min(1.0, float(areas @ self.share / (LEAST_SHARE * areas.sum())))
        thin = 1.0 / np.maximum(self.share, LEAST_SHARE) - 1.0
        return np.asarray((1.0 + (bending - 1.0) * self.curved) * (1.0 + clear * thin))


class FirstCollisions:
    """First collisions of light that enters a surface's n patches from all around, by rays.

    Parameters
    ----------
    mesh : Mesh
    patches : Patches
    thickness : (n,) float64
        Along the normals, mm; 0 where there is none.
    """

    def __init__(self, mesh: Mesh, patches: Patches, thickness: Array) -> None:
        self._mesh, self._patches, self._thickness = mesh, patches, thickness
        self._lock = threading.Lock()
        self._paths: dict[float, tuple[Float32, Float32, Bools]] = {}
        self._kept: dict[tuple[float, float], Collisions | None] = {}

    def of(self, medium: Medium) -> Collisions | None:
        """Return what collides in a medium; None where next to all does."""
        key = medium.eta, medium.sigma_t_prime
        with self._lock:
            if key not in self._kept:
                self._kept = {**_newest(self._kept), key: self._found(medium)}
            return self._kept[key]

    def _found(self, medium: Medium) -> Collisions | None:
        areas, thickness = self._patches.areas, np.where(self._thickness > 0.0, self._thickness, np.inf)
        if areas @ np.exp(-medium.sigma_t_prime * thickness) < DENSE * areas.sum():
            return None
        if medium.eta not in self._paths:
            self._paths = {**_newest(self._paths), medium.eta: self._cast(medium.eta)}
        lengths, shares, meets = self._paths[medium.eta]
        free_paths = np.minimum(np.float32(medium.sigma_t_prime) * lengths, LONGEST_CHORD)
        left = shares * np.exp(-free_paths)
        beyond = left * (1.0 + free_paths * (1.0 + 0.5 * free_paths))
        share, curved = (1.0 - part.sum(axis=1, dtype=np.float64) for part in (left, beyond))
        colliding = 1.0 - np.float32(RAYS) * left.reshape(*meets.shape, EXITS).sum(axis=2)
        # Few rays that meet the object count with one of all.
        from_object = np.einsum("ij,ij->i", meets, colliding, dtype=np.float64) + share
        towards = from_object / np.maximum((1 + meets.sum(axis=1)) * share, np.finfo(np.float64).tiny)
        return Collisions(share, curved, towards)

    def _cast(self, eta: float) -> tuple[Float32, Float32, Bools]:
        """Return lengths in matter after which light leaves, mm, and the share that does, (n, RAYS * EXITS) each.

        And whether rays come from the object, (n, RAYS).
        """
        mesh, n, lift = self._mesh, len(self._patches), np.float32(LIFT * self._mesh.radius)
        facing = face_normals(mesh.vertices, mesh.faces).astype(np.float32)
        follower, steps = Follower(mesh.rays, facing, lift, eta, np.inf), np.arange(RAYS)
        cosines = (np.arange(COSINES) + 0.5) / COSINES
        density = np.cumsum(cosines * transmittance(eta, cosines))
        mu = np.interp((steps + 0.5) / RAYS, density / density[-1], cosines)
        sine, turn = np.sqrt(1.0 - mu * mu), 2.0 * np.pi * GOLDEN * steps
        across_first, across_second, inwards = (
            part[:, None].astype(np.float32) for part in (sine * np.cos(turn), sine * np.sin(turn), -mu)
        )
        (lengths, shares), meets = np.empty((2, n, RAYS * EXITS), np.float32), np.empty((n, RAYS), bool)
        for start in range(0, n, PATCHES_AT_A_TIME):
            chosen = slice(start, start + PATCHES_AT_A_TIME)
            normals = self._patches.face_normals[chosen]
            first, second = (axis[:, None].astype(np.float32) for axis in across(normals))
            places, outward = (
                np.repeat(part.astype(np.float32), RAYS, axis=0) for part in (self._patches.on_surface[chosen], normals)
            )
            arriving = across_first * first + across_second * second + inwards * normals[:, None].astype(np.float32)
            arriving = arriving.reshape(-1, 3)
            meets[chosen] = mesh.rays.occluded(places + lift * outward, -arriving).reshape(-1, RAYS)
            found = follower.within(places, outward, arriving)
            lengths[chosen], shares[chosen] = (part.reshape(len(normals), -1) for part in found)
        return lengths, shares / np.float32(RAYS), meets


def _newest(kept: dict[K, V]) -> dict[K, V]:
    """Return what was kept but for the oldest of `KEPT`."""
    return dict(list(kept.items())[1 - KEPT :])
