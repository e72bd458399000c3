"""Paths of light through clear and murky matter: refracted and mirrored at its surface, straight in between.

Rays of sight stand for the light about them that forward peaks turn.
"""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.core.paths.events import (
        Chords as Chords,
        Rays as Rays,
        follow as follow,
        most_events as most_events,
    )
    from milkglass.core.paths.glow import Glow as Glow
    from milkglass.core.paths.lamps import Lamp as Lamp
    from milkglass.core.paths.peaks import Peaks as Peaks
    from milkglass.core.paths.surface import ClearPart as ClearPart, Surface as Surface
    from milkglass.core.paths.surroundings import Floor as Floor, Surroundings as Surroundings
    from milkglass.core.paths.tree import Inside as Inside, Seen as Seen, Sight as Sight, Tree as Tree
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
