"""Irradiance of an environment that the object occludes, by rays in float64: the reference of `light.visibility`.

It is independent of the bake: other directions, other origins of rays, no spherical harmonics.
"""

import numpy as np
import numpy.typing as npt

from milkglass.core.arrays import Array, Floats
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.maps import resample_latlong
from milkglass.core.material import fresnel

HEIGHT = 60  # rows to which a probe is averaged: 3,600 rays above each horizon
LIFT = 1e-4  # height of the origins of rays above their face, in radii of the object
_POINTS = 16  # handled at a time


def occluded_irradiance(  # noqa: PLR0913
    mesh: Mesh, points: Floats, normals: Floats, face_normals: Floats, probe: Floats, eta: float,
    rotations: npt.ArrayLike = (0.0,), height: int = HEIGHT, seed: int = 11,
) -> Array:  # fmt: skip
    """Return E = int F_t(eta, w.n) max(w.n, 0) V(w) L(w) dw, by a jittered ray for each texel of the probe.

    A ray above the horizon of the shading normal but below the face is mirrored at the face.

    Parameters
    ----------
    mesh : Mesh
    points, normals, face_normals : (n, 3) arrays
        Points on the mesh, mm; unit shading normals; unit normals of the faces.
    probe : (h, w, 3) array
        Lat-long radiance.
    eta : float
        Relative index of refraction.
    rotations : (k,) array
        Rotations of the probe about +y in degrees, rounded to whole texels of 180 / height.
    height : int
        Rows to which the probe is averaged.
    seed : int

    Returns
    -------
    (k, n, 3) float64
    """
    rng, width = np.random.default_rng(seed), 2 * height
    averaged = resample_latlong(np.asarray(probe, np.float32), height).astype(np.float64)
    shifts = [round(float(rotation) / 360.0 * width) for rotation in np.atleast_1d(rotations)]
    light = np.stack([np.roll(averaged, -shift, axis=1).reshape(-1, 3) for shift in shifts])
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    column, row = (grid.ravel() for grid in np.meshgrid(np.arange(width), np.arange(height)))
    d_omega = (edges[row] - edges[row + 1]) * (2.0 * np.pi / width)
    rays, result = mesh.rays, np.empty((len(shifts), len(points), 3))
    for start in range(0, len(points), _POINTS):
        subset = slice(start, start + _POINTS)
        normal, plane = (np.asarray(of[subset], np.float64)[:, None] for of in (normals, face_normals))
        shape = normal.shape[0], len(row)
        y = edges[row] + (edges[row + 1] - edges[row]) * rng.random(shape)
        phi = 2.0 * np.pi * ((column + rng.random(shape)) / width - 0.5)
        towards = np.stack([np.sqrt(1.0 - y * y) * np.sin(phi), y, -np.sqrt(1.0 - y * y) * np.cos(phi)], axis=-1)
        cosine = np.einsum("nkc,nc->nk", towards, normal[:, 0])
        point, above = np.nonzero(cosine > 0.0)
        cosine, towards = cosine[point, above], towards[point, above]
        below = np.minimum(np.einsum("kc,kc->k", towards, plane[point, 0]), 0.0)
        towards -= 2.0 * below[:, None] * plane[point, 0]
        origins = np.asarray(points[subset], np.float64) + LIFT * mesh.radius * plane[:, 0]
        weight = np.zeros(shape)
        visible = ~rays.occluded(origins[point], towards)
        weight[point, above] = cosine * fresnel.transmittance(eta, cosine) * d_omega[above] * visible
        result[:, subset] = np.einsum("nk,rkc->rnc", weight, light, optimize=True)
    return result
