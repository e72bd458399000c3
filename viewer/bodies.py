"""Bodies of a scene that scatter light each on their own: what lighting, transport and shading need of them."""

from dataclasses import dataclass

import moderngl
import numpy as np
import numpy.typing as npt

from core.atlas import Atlas
from core.bodies import Bodies
from core.mesh import Mesh
from core.separate import SeparateTransport
from core.spectra import Profiles
from core.stages import Stages

Float32 = npt.NDArray[np.float32]


class BodyMarks:
    """Body of each vertex, on both sides.

    Attributes
    ----------
    of_vertex : (n,) int32
    buffer : one float a vertex
    """

    def __init__(self, context: moderngl.Context, mesh: Mesh, bodies: Bodies) -> None:
        self.of_vertex = bodies.of_vertex(mesh)
        self.buffer = context.buffer(self.of_vertex.astype(np.float32))


@dataclass(frozen=True, eq=False)
class Separated:
    """Two bodies or more, ready for transport and for shading."""

    marks: BodyMarks
    atlas: Atlas
    transport: SeparateTransport

    def exitance(self, coordinates: Float32, flux: Float32, profiles: Profiles, stages: Stages) -> Float32:
        """See `core.separate.SeparateTransport.exitance`."""
        return self.transport.exitance(self.atlas, coordinates, flux, profiles, stages)


def bodies_warnings(bodies: Bodies | None) -> tuple[str, ...]:
    """One sentence on what keeps bodies from being separate; None: they were not asked to be."""
    if bodies is None:
        return ()
    if bodies.open_parts:
        return (
            f"{bodies.open_parts} parts of the model are not closed, so they have no inside and scatter light together"
            " as one body",
        )
    if bodies.count == 1:
        return ("the model is one body, so model.bodies = separate has nothing to separate",)
    return ()
