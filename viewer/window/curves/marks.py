"""Lengths that a profile is to be seen against: what the grid resolves, the object, the mean free path."""

from dataclasses import dataclass

from milkglass.core.profiles.registry import family
from milkglass.viewer.gui.sliders import significant
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.scene.scene import Scene

LIKE = 0.02  # distances of nodes that differ by less are told once


@dataclass(frozen=True)
class Mark:
    """A length on the axis of radii: mm, what it is, and the channel (0, 1, 2) it is of, None for all."""

    name: str
    radius: float
    channel: int | None = None

    @property
    def label(self) -> str:
        """What is written beside it."""
        return f"{self.name} {significant(self.radius)} mm"


def marks(scene: Scene, lit: LitScene | None) -> list[Mark]:
    """Return the lengths of a scene: mean free paths first, then the grid's, then the object.

    Parameters
    ----------
    scene : Scene
    lit : LitScene, optional
        With the grid of the picture, once there is one.
    """
    material = scene.material.resolve()
    found = []
    if not family(scene.material.profile).has_given_widths:
        paths = zip(material.sigma_s_prime, material.mean_free_path, strict=True)
        found += [Mark("mean free path", float(path), i) for i, (scatters, path) in enumerate(paths) if scatters > 0.0]
    if lit is not None:
        texel, distance = lit.grid.texel, lit.grid.layer_distance
        found.append(Mark(lit.quality.facts.grid_unit, texel))
        if distance > 0.0 and abs(distance - texel) > LIKE * texel:
            found.append(Mark("layer", distance))
    return [*found, Mark("object", scene.model.size_mm)]
