"""Ray casting against a mesh: the first face, any face, or all faces along a ray."""

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from milkglass.core.arrays import Array, Bools, Float32, Floats, Int32, Ints

MAX_HITS = 1024  # of one ray


class RayMesh:
    """Acceleration structure for rays against faces (m, 3) of vertices (n, 3)."""

    def __init__(self, vertices: npt.ArrayLike, faces: npt.ArrayLike) -> None:
        self._scene = EmbreeScene()
        TriangleMesh(
            scene=self._scene,
            vertices=np.ascontiguousarray(vertices, np.float32),
            indices=np.ascontiguousarray(faces, np.int32),
        )

    def first(self, origins: Floats, directions: Floats, reach: Array | None = None) -> tuple[Ints, Array]:
        """Return the first face (n,) that each ray hits, -1 for none, and its distance (n,) in lengths of the ray.

        The length of a ray is that of its direction. Rays end at `reach`, (n,) in these lengths, if it is given: short
        rays are cast four times as fast.
        """
        hits = self._scene.run(
            np.ascontiguousarray(origins, np.float32),
            np.ascontiguousarray(directions, np.float32),
            None if reach is None else np.ascontiguousarray(reach, np.float32),
            output=True,
        )
        return hits["primID"].astype(np.int64), hits["tfar"].astype(np.float64)

    def places(self, origins: Float32, directions: Float32) -> tuple[Int32, Float32, Float32, Float32]:
        """Return the first face of each ray, -1 for none, its distance as `first`, and the place there; (n,) each.

        The place is the weights of the face's second and third corner.
        """
        hits = self._scene.run(origins, directions, output=True)
        return hits["primID"], hits["tfar"], hits["u"], hits["v"]

    def occluded(self, origins: Floats, directions: Floats) -> Bools:
        """Return whether each ray hits a face, (n,): a fifth faster than `first`."""
        hits = self._scene.run(
            np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32), query="OCCLUDED"
        )
        return np.asarray(hits >= 0)

    def all_hits(self, origins: Array, directions: Array, step: float, *, segments: bool = False) -> tuple[Ints, Ints]:
        """Return all hits of n rays as indices (ray, face), (k,) each.

        Parameters
        ----------
        origins, directions : (n, 3) arrays
        step : float
            Offset behind a hit at which the ray continues, in the unit of the origins.
        segments : bool
            Whether rays end at origin + direction.
        """
        ray = np.arange(len(origins), dtype=np.int64)
        length = np.linalg.norm(directions, axis=1)
        ray = ray[length > 0.0]
        along = np.zeros(len(origins))
        found: list[tuple[Ints, Ints]] = [(np.empty(0, np.int64), np.empty(0, np.int64))]
        for _ in range(MAX_HITS):
            if len(ray) == 0:
                break
            start = origins[ray] + along[ray, None] * directions[ray]
            face, t = self.first(start, directions[ray])
            hit = face >= 0
            if segments:
                hit &= along[ray] + t <= 1.0
            ray, face, t = ray[hit], face[hit], t[hit]
            found.append((ray, face))
            along[ray] += np.maximum(t, 0.0) + step / length[ray]
        return np.concatenate([r for r, _ in found]), np.concatenate([f for _, f in found])
