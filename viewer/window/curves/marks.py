"""Lengths marked on the plot of a profile: nodes and layers of the grid, the object, the mean free path."""

from dataclasses import dataclass

from milkglass.core.profiles.registry import family
from milkglass.viewer.gui.sliders import significant
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.scene.scene import Scene

SAME_DISTANCE = 0.02  # relative; nodes and layers that differ by less are one mark


@dataclass(frozen=True)
class Mark:
    """A length on the axis of radii: its name, mm, and its channel (0, 1, 2), None for all."""

    name: str
    radius: float
    channel: int | None = None

    @property
    def label(self) -> str:
        """Text beside the mark."""
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
        if distance > 0.0 and abs(distance - texel) > SAME_DISTANCE * texel:
            found.append(Mark("layer", distance))
    size = scene.model.size_mm if lit is None else lit.model.size_of(scene.model.size_mm)
    return found if isinstance(size, str) else [*found, Mark("object", size)]
