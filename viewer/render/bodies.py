"""Bodies of a scene that scatter light each on their own: what lighting, transport and shading need of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import moderngl
import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.geometry.bodies import Bodies
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.grid.atlas import Atlas, fit_atlas
from milkglass.core.grid.kernels import CONVOLVERS
from milkglass.core.grid.layers import LayerGrid
from milkglass.core.material.medium import Medium
from milkglass.core.profiles.base import Profiles
from milkglass.core.stages import Stage, Stages
from milkglass.core.transport.diffusion.entry import EnteringLight
from milkglass.core.transport.diffusion.separate import SeparateDiffusion, SeparateSolution
from milkglass.core.transport.diffusion.solver import DiffusionTransport
from milkglass.core.transport.methods import Method
from milkglass.core.transport.separate import SeparateTransport
from milkglass.viewer.assets.quality import AnyTransport, Quality
from milkglass.viewer.passes.layers import LayersPass

MOST_BY_DEFAULT = 64  # bodies: each takes 15 ms, so that more are better joined


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
    transport: SeparateTransport | SeparateDiffusion

    def exitance(self, coordinates: Float32, flux: Float32, profiles: Profiles, stages: Stages) -> Float32:
        """See `core.transport.separate.SeparateTransport.exitance`."""
        assert isinstance(self.transport, SeparateTransport)
        return self.transport.exitance(self.atlas, coordinates, flux, profiles, stages)

    def solve(
        self,
        lights: Sequence[EnteringLight],
        media: Sequence[Medium],
        stages: Stages,
        go_on: Callable[[SeparateSolution], bool] | None,
    ) -> SeparateSolution:
        """See `core.transport.diffusion.separate.SeparateDiffusion.solve`."""
        assert isinstance(self.transport, SeparateDiffusion)
        return self.transport.solve(lights, media, stages, go_on)


class Separation:
    """Makes bodies ready in one OpenGL context; a step runs only when what it depends on has changed."""

    def __init__(self, context: moderngl.Context, stages: Stages, layers: LayersPass) -> None:
        self._context, self._run, self._layers = context, stages.run, layers
        self._solvers: dict[tuple[Quality, Bodies, SurfaceSamples], SeparateDiffusion] = {}

    def release(self) -> None:
        """Let go of solvers."""
        self._solvers.clear()

    def separated(
        self,
        mesh: Mesh,
        bodies: Bodies,
        made_for: Quality,
        transport: AnyTransport,
        grid: LayerGrid,
        samples: SurfaceSamples,
    ) -> Separated:
        """Place the bodies of a mesh on layers, and wrap a transport.

        Raises
        ------
        InputError
            If the GPU cannot hold the layers.
        """
        run = self._run
        marks = run(Stage.BODY_MARKS, [mesh, bodies], lambda: BodyMarks(self._context, mesh, bodies))
        cut = grid, transport.smooth
        atlas = run(Stage.BODY_LAYERS, [marks, *cut], lambda: fit_atlas(*cut, mesh.vertices, marks.of_vertex))
        self._layers.check_atlas(atlas)

        def wrap() -> SeparateTransport | SeparateDiffusion:
            if not isinstance(transport, DiffusionTransport):
                return SeparateTransport(transport, bodies, samples)
            key = made_for, bodies, samples
            solver = self._solvers.pop(key, None) or SeparateDiffusion(transport, mesh, bodies, samples)
            self._solvers = {**dict(list(self._solvers.items())[-1:]), key: solver}  # a drag's and the picture's
            return solver

        return Separated(marks, atlas, run(Stage.SEPARATE_TRANSPORT, [transport, bodies, samples], wrap))


def separate_by_default(bodies: Bodies, method: Method) -> Bodies | None:
    """Return bodies that are to be separate though nobody asked for it; None where all are joined.

    Light that crosses the air between bodies is what equation (1) says, and an error of methods that have more to say.
    """
    return bodies if method.separates_bodies and 2 <= bodies.count <= MOST_BY_DEFAULT else None


def convolvers(made_for: Quality, count: int) -> int:
    """How many are to be kept for so many bodies, each of which may have shapes of its own."""
    return CONVOLVERS + made_for.facts.shapes_a_body * (count - 1)


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
