"""The boundary integral equation as a dense matrix, float64: collocation at the middles of flat faces.

Static parts of S and K over a face are exact (its potential by edges, Wilton et al. 1984; its solid angle), what
absorption changes is smooth and taken by a three-point rule. Nothing is shared with `core` but the constants.
"""

import numpy as np

from milkglass.core.material.medium import Medium


class Dense:
    def __init__(self, mesh, medium: Medium) -> None:
        v = mesh.vertices[mesh.faces].astype(np.float64)
        cross = np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0])
        self.areas = 0.5 * np.linalg.norm(cross, axis=1)
        self.normals, self.centres = cross / (2.0 * self.areas[:, None]), v.mean(axis=1)
        self._corners, self._medium = v, medium
        n = len(v)
        self.S, self.K = np.empty((n, n)), np.empty((n, n))
        for i in range(n):
            self.S[i], self.K[i] = self._row(self.centres[i])
        self.K[np.arange(n), np.arange(n)] = 0.0  # a flat face does not see itself

    def _row(self, x):
        v, normals, D, sigma = self._corners, self.normals, self._medium.diffusion, self._medium.attenuation
        r = v - x
        length = np.linalg.norm(r, axis=2)
        a, b, c = np.moveaxis(r, 1, 0)
        la, lb, lc = length.T
        dot = [np.einsum("ij,ij->i", *pair) for pair in ((a, b), (b, c), (c, a))]
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        angle = 2.0 * np.arctan2(volume, la * lb * lc + dot[0] * lc + dot[1] * la + dot[2] * lb)
        height = np.einsum("ij,ij->i", a, normals)
        potential = -height * angle
        for k in range(3):
            begin, end = r[:, k], r[:, (k + 1) % 3]
            along = end - begin
            along /= np.linalg.norm(along, axis=1, keepdims=True)
            out = np.einsum("ij,ij->i", begin, np.cross(along, normals))
            l0, l1 = np.einsum("ij,ij->i", begin, along), np.einsum("ij,ij->i", end, along)
            r0, r1 = length[:, k], length[:, (k + 1) % 3]
            ahead = l0 + l1 >= 0.0
            ratio = np.where(
                ahead, (r1 + l1) / np.where(ahead, r0 + l0, 1.0), (r0 - l0) / np.where(ahead, 1.0, r1 - l1)
            )
            potential += out * np.log(ratio)
        smooth_s, smooth_k = np.zeros(len(v)), np.zeros(len(v))
        for shares in np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6.0:
            y = np.einsum("nkj,k->nj", r, shares)
            d = np.maximum(np.linalg.norm(y, axis=1), 1e-12)
            smooth_s += self.areas / 3.0 * np.expm1(-sigma * d) / d
            change = np.where(sigma * d < 1e-4, -0.5 * (sigma * d) ** 2, (1.0 + sigma * d) * np.exp(-sigma * d) - 1.0)
            smooth_k += self.areas / 3.0 * change / d**3 * np.einsum("ij,ij->i", y, normals)
        return (potential + smooth_s) / (4.0 * np.pi * D), -(angle + smooth_k) / (4.0 * np.pi)

    def green(self, points, strengths):
        """phi_0 at the middles of the faces, of point sources inside."""
        D, sigma = self._medium.diffusion, self._medium.attenuation
        out = np.zeros(len(self.centres))
        for part in np.array_split(np.arange(len(points)), 1 + len(points) // 2000):
            d = np.linalg.norm(self.centres[:, None] - points[part], axis=2)
            out += (np.exp(-sigma * d) / (4.0 * np.pi * D * d)) @ strengths[part]
        return out

    def exitance(self, phi_0, bending=1.0):
        """M; `bending` of the faces as `core.material.medium.Medium.bending`."""
        matrix = (0.5 * np.eye(len(phi_0)) + self.K) * bending + self.S / (2.0 * self._medium.extrapolation_factor)
        return np.linalg.solve(matrix, phi_0) / (2.0 * self._medium.extrapolation_factor)
