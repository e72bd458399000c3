"""Triangle meshes: normals, surface samples, refinement, connected bodies, rays, and the built-in sculpture."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.core.geometry.bodies import Bodies as Bodies, find_bodies as find_bodies
    from milkglass.core.geometry.detail import MeshDetail as MeshDetail
    from milkglass.core.geometry.mesh import (
        Flaws as Flaws,
        Mesh as Mesh,
        find_flaws as find_flaws,
        place_in_world as place_in_world,
    )
    from milkglass.core.geometry.rays import RayMesh as RayMesh
    from milkglass.core.geometry.refine import Refined as Refined
    from milkglass.core.geometry.samples import SurfaceSamples as SurfaceSamples, surface_samples as surface_samples
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
