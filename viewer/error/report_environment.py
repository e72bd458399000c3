"""How the environment's irradiance of a picture was obtained, and how far it is from rays; arrays alone, no OpenGL."""

from typing import Any

import numpy as np

from milkglass.core.geometry.mesh import face_cross
from milkglass.core.geometry.refine import interpolated
from milkglass.core.light.probe import irradiance_table, lookup
from milkglass.core.reference.environment import HEIGHT, occluded_irradiance
from milkglass.viewer.assets.keeper import PartedProbe
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.scene.camera import world_to_probe
from milkglass.viewer.scene.scene import Scene

POINTS = 300


def environment_content(scene: Scene, lit: LitScene, around: PartedProbe, seed: int) -> dict[str, Any]:
    """Compare E of the surface samples, at POINTS of them, with a ray for each texel of the probe in float64.

    Its strong sources, which shine as lamps, are left out on both sides. Without occlusion there is nothing to compare.
    """
    strong, rest = around
    content: dict[str, Any] = {"lamps": len(strong), "occluded": lit.occlusion is not None}
    if lit.occlusion is None:
        return content
    samples, rotation = lit.samples, scene.environment.rotation_deg
    some = np.random.default_rng(seed).choice(len(samples), min(POINTS, len(samples)), replace=False)
    points, normals, faces = samples.points[some], samples.normals[some].astype(np.float64), samples.faces[some]
    planes = face_cross(lit.model.mesh.vertices, lit.model.mesh.faces)[faces]
    planes /= np.linalg.norm(planes, axis=1, keepdims=True)
    places = lit.occlusion.baked.refined.locate(points, faces)
    unoccluded = lookup(irradiance_table(rest.sh, lit.eta), normals @ world_to_probe(rotation))
    actual = unoccluded * interpolated(*places, lit.occlusion.shares)
    # Turned by texels of its own, which are finer than those that rays go through.
    turned = np.roll(rest.latlong, -round(rotation / 360.0 * rest.latlong.shape[1]), axis=1)
    expected = occluded_irradiance(lit.model.mesh, points, normals, planes, turned, lit.eta, seed=seed)[0]
    size = np.where(expected.any(axis=0), np.sqrt(np.square(expected).mean(axis=0)), 1.0)
    return content | {
        "points": len(some),
        "rays": len(some) * HEIGHT**2,
        "rms": (np.sqrt(np.square(actual - expected).mean(axis=0)) / size).tolist(),
        "rms_not_occluded": (np.sqrt(np.square(unoccluded - expected).mean(axis=0)) / size).tolist(),
        "flux_ratio": [
            float(a / e) if e > 0.0 else 1.0 for a, e in zip(actual.sum(axis=0), expected.sum(axis=0), strict=True)
        ],
    }
