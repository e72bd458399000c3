"""Where light that is known at the vertices may be drawn in place of that of every pixel."""

import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.viewer.gl.constants import MOST_LAMPS
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.passes.lit_vertices import have_round_highlights
from milkglass.viewer.passes.refined import RefinedSurface
from milkglass.viewer.render.lit_scene import LitScene

LONGEST_EDGE = 8.0  # pixels, of the mean edge
MOST_VERTICES = 150_000  # more would take longer to light than the pixels of a picture that is drawn smaller


def refined_surface(lit: LitScene, gather: Gather) -> RefinedSurface | None:
    """Return the refined surface that pixels are drawn of; None for the object's mesh."""
    return lit.surface if gather.reentry is None else gather.reentry.surface


def without_gaps(exitance: Float32, mesh: Mesh) -> Float32:
    """Return exitance M at vertices (n, 3) with the mean of its neighbours where a vertex has none in a channel.

    The equation of a pixel fails at some 1 vertex in 4,000, as where surfaces touch: a speck that no pixel shows, but
    between vertices as large as the faces about it.
    """
    result = exitance.copy()
    for channel, values in enumerate(exitance.T):
        faces = mesh.faces[(values[mesh.faces] <= 0.0).any(axis=1)]
        known = np.where(values[faces] > 0.0, values[faces], 0.0)
        total, count = (
            np.bincount(faces.ravel(), np.repeat(part.sum(axis=1), 3), len(values)) for part in (known, known > 0.0)
        )
        filled = (values <= 0.0) & (count > 0)
        result[filled, channel] = total[filled] / count[filled]
    return result


def obstacle(lit: LitScene, gather: Gather, size: tuple[int, int]) -> str:
    """Return why light at the vertices does not look as that of (width, height) pixels does; empty where it does.

    Edges must be no longer than LONGEST_EDGE at the object's centre, and nothing be known at pixels alone.
    """
    surface = refined_surface(lit, gather)
    mesh = lit.model.mesh if surface is None else surface.refined.mesh
    if lit.detail is not None:
        return "its surface has colours or relief"
    if not have_round_highlights(lit.sources):
        return f"lamps are rectangles or spot lights, or more than {MOST_LAMPS}"
    if len(mesh.vertices) > MOST_VERTICES:
        return f"it has more than {MOST_VERTICES:,} vertices"
    edge = 2.0 * np.sqrt(mesh.area / len(mesh.faces) / np.sqrt(3.0))  # of triangles of equal sides
    across = lit.camera.rotation[:, 0] * edge  # on the right of the object's centre, mm
    clip = np.array([[0.0, 0.0, 0.0, 1.0], [*across, 1.0]]) @ lit.camera.world_to_clip
    x = clip[:, 0] / np.maximum(clip[:, 3], 1e-9)
    pixels = 0.5 * size[0] * abs(x[1] - x[0])
    return (
        f"edges of its mesh are {pixels:.0f} pixels long, more than {LONGEST_EDGE:.0f}" if pixels > LONGEST_EDGE else ""
    )
