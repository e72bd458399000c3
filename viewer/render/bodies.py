"""Bodies of a scene that scatter light each alone, made ready for lighting, transport and shading."""

import moderngl
import numpy as np

from milkglass.core.geometry.bodies import Bodies
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.kernels import MAX_CONVOLVERS
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.stages import Stage, Stages
from milkglass.core.transport.base import SeparableTransport
from milkglass.core.transport.methods import Method
from milkglass.core.transport.quality import Quality
from milkglass.core.transport.separate import OfBodies
from milkglass.viewer.passes.layers import LayersPass

MOST_SEPARATE = 64  # bodies by default: each takes 15 ms, so that more are better joined


class BodyMarks:
    """The body that each vertex belongs to, as an index on the CPU and the GPU.

    Attributes
    ----------
    of_vertex : (n,) int32
    buffer : one float a vertex
    """

    def __init__(self, context: moderngl.Context, mesh: Mesh, bodies: Bodies) -> None:
        self.of_vertex = bodies.of_vertex(mesh)
        self.buffer = context.buffer(self.of_vertex.astype(np.float32))


class Separation:
    """Makes bodies ready in one OpenGL context; a step runs only when what it depends on has changed."""

    def __init__(self, context: moderngl.Context, stages: Stages, layers: LayersPass) -> None:
        self._context, self._run, self._layers = context, stages.run, layers
        self._kept: dict[tuple[Quality, Bodies, SurfaceSamples], OfBodies] = {}

    def start_cold(self) -> None:
        """Have all transports of bodies forget their solutions."""
        for transport in self._kept.values():
            transport.start_cold()

    def release(self) -> None:
        """Release the transports of bodies that later pictures could use again."""
        self._kept.clear()

    def marks(self, mesh: Mesh, bodies: Bodies) -> BodyMarks:
        """Return the index of the body of each vertex, uploaded."""
        return self._run(Stage.BODY_MARKS, [mesh, bodies], lambda: BodyMarks(self._context, mesh, bodies))

    def of_bodies(
        self,
        mesh: Mesh,
        bodies: Bodies,
        made_for: Quality,
        transport: SeparableTransport,
        grid: LayerGrid,
        samples: SurfaceSamples,
    ) -> OfBodies:
        """Return the transport in each body of a mesh alone, whose layers the GPU can hold.

        Raises
        ------
        InputError
            If the GPU cannot hold the layers.
        """

        def wrap() -> OfBodies:
            if not made_for.facts.solves:
                return OfBodies(transport, mesh, bodies, samples)
            key = made_for, bodies, samples
            wrapped = self._kept.pop(key, None) or OfBodies(transport, mesh, bodies, samples)
            self._kept = {**dict(list(self._kept.items())[-1:]), key: wrapped}  # a drag's and the picture's
            return wrapped

        wrapped = self._run(Stage.SEPARATE_TRANSPORT, [transport, bodies, samples], wrap)
        self._layers.check_atlas(self._run(Stage.BODY_LAYERS, [wrapped, grid], lambda: wrapped.atlas(grid)))
        return wrapped


def separate_by_default(bodies: Bodies, method: Method) -> Bodies | None:
    """Return bodies that are to be separate though nobody asked for it; None where all are joined.

    Light that crosses the air between bodies is what equation (1) says, and an error of methods that have more to say.
    """
    return bodies if method.separates_bodies and 2 <= bodies.count <= MOST_SEPARATE else None


def convolvers(made_for: Quality, count: int) -> int:
    """Return how many convolvers are to be kept for so many bodies, each of which may have shapes of its own."""
    return MAX_CONVOLVERS + made_for.facts.shapes_a_body * (count - 1)


def bodies_warnings(bodies: Bodies | None) -> tuple[str, ...]:
    """Return a sentence on what keeps bodies from being separate; None for `bodies`: they were not asked to be."""
    if bodies is None:
        return ()
    if bodies.open_components:
        return (
            f"{bodies.open_components} parts of the model are not closed, so they have no inside and scatter light"
            " together as one body",
        )
    if bodies.count == 1:
        return ("the model is one body, so model.bodies = separate has nothing to separate",)
    return ()
