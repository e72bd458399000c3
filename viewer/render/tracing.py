"""Rays of sight traced for the pixels of a G-buffer, batch by batch."""

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

import moderngl
import numpy as np
from scipy.spatial import cKDTree

from milkglass.core.arrays import Array, Float32, Ints
from milkglass.core.geometry.mesh import Mesh, face_normals
from milkglass.core.stages import Stage, Stages, Steps
from milkglass.viewer.gl.context import current
from milkglass.viewer.passes.composite import CompositePass, Traced
from milkglass.viewer.passes.gather import Gather
from milkglass.viewer.passes.gbuffer import GBuffer
from milkglass.viewer.passes.irradiance import DISC_FROM, SMOOTH_EDGE
from milkglass.viewer.passes.sight_draft import Drafted, GlowTextures, SightDraftPass, SurroundingTextures
from milkglass.viewer.render.exitance import SurfaceExitance
from milkglass.viewer.render.lit_scene import LitScene
from milkglass.viewer.render.paths import Paths
from milkglass.viewer.scene.camera import Camera, Offset, further_offsets, jittered
from milkglass.viewer.scene.light_paths import LightPaths

if TYPE_CHECKING:
    from milkglass.core.paths import ClearPart, Glow, Sight, Tree
    from milkglass.core.paths.resolved import Resolved
    from milkglass.core.paths.tree import Found

FINE_RAYS = 2**19  # of sight in a picture of several samples, up to which each has further rays
MOST_RAYS = 32  # of a pixel, likewise
RESUME = 1e-5  # radii behind a face at which rays that look for the next one start
ALIKE = 0.05  # contrast of rays between which others are interpolated
ROWS_WRITTEN = 64  # at a time, of what rays have found
RAYS_A_STEP = 65536  # of sight: what about 0.1 s are enough for


class Leaving:
    """What rays see of a lit object that they enter, at vertices that they ask for, computed once each in OpenGL.

    That is M / (e pi T) where they go on inside (`core.paths.tree`), else M / (pi T). Vertices of clear parts are
    numbered after its own; of them each has what the nearest vertex of the object has.
    """

    def __init__(
        self, context: moderngl.Context, exitance: SurfaceExitance, lit: LitScene, gather: Gather, *, inside: bool
    ) -> None:
        self._context, self._exitance, self._lit, self._gather = context, exitance, lit, gather
        self._inside = inside
        n = len(lit.model.mesh.vertices)
        self._values, self._known = np.zeros((n, 3), np.float32), np.zeros(n, bool)
        beside = [np.arange(n), *(cKDTree(lit.model.mesh.vertices).query(part.mesh.vertices)[1] for part in lit.clear)]
        self._nearest = np.concatenate(beside)
        self._dimming = dimming(lit.model.mesh, lit.clear)
        of_vertex = lit.kind_of_vertex
        self._left = np.array([kind.left_to_surface for kind in gather.kinds])[of_vertex]
        self._normalisation = np.array([[kind.exit_normalisation] for kind in gather.kinds])[of_vertex]

    def __call__(self, vertices: Ints) -> Float32:
        """Return the values of vertices, (m, 3), for their numbers, (m,)."""
        vertices, gather = self._nearest[vertices], self._gather
        missing = np.unique(vertices[~self._known[vertices]])
        if len(missing):
            with current(self._context):
                exitance = self._exitance.at_vertices(missing, self._lit, gather, inside=self._inside)
            exitance = exitance * self._dimming[missing]
            self._values[missing] = exitance * self._left[missing] / self._normalisation[missing]
            self._known[missing] = True
        return self._values[vertices]


def dimming(mesh: Mesh, parts: "Sequence[ClearPart]") -> Float32:
    """Return what clear parts leave of light from all around on its way to a mesh's vertices, (n, 3).

    By their thickness along the normal, and the mean way through a plate that light from all around takes.
    """
    left, starts = np.zeros((len(mesh.vertices), 3)), mesh.vertices.astype(np.float64)
    for part in parts:
        if not any(part.absorption):
            continue
        ray, face = part.mesh.rays.all_hits(starts, mesh.normals.astype(np.float64), RESUME * part.mesh.radius)
        planes, corners = face_normals(part.mesh.vertices, part.mesh.faces)[face], part.mesh.faces[face, 0]
        facing = np.einsum("ij,ij->i", planes, mesh.normals[ray])
        off = np.einsum("ij,ij->i", planes, part.mesh.vertices[corners] - starts[ray])
        across = np.sign(facing) * off / np.where(facing == 0.0, np.inf, facing)
        thickness = np.maximum(np.bincount(ray, across, len(starts)), 0.0)
        longer = 2.0 * part.eta**2 * (1.0 - np.sqrt(1.0 - 1.0 / part.eta**2))
        left += longer * thickness[:, None] * np.asarray(part.absorption)
    return np.exp(-left).astype(np.float32)


class Tracing:
    """Traces rays of sight for pictures in one OpenGL context, in a `worker`."""

    def __init__(
        self,
        context: moderngl.Context,
        stages: Stages,
        composite: CompositePass,
        exitance: SurfaceExitance,
        worker: Executor,
    ) -> None:
        self._context, self._run, self._worker = context, stages.run, worker
        self._composite, self._exitance = composite, exitance
        self._drafts = SightDraftPass(context)

    def tree(self, paths: Paths | None, lit: LitScene, gather: Gather, shown: LightPaths) -> "Tree | None":
        """Return what rays are traced in, with the exitance of the surface where they meet it again.

        `shown` are the parts of light that are shown by way of the inside.
        """
        if paths is None or paths.tree is None:
            return None
        clear, resolved = paths.tree, gather.resolved
        tree = clear
        if paths.meets_itself or resolved is not None:
            key = clear, lit.model, lit.detail, *lit.sources, *gather.key, resolved, paths.meets_itself

            def lit_tree() -> "Tree":
                glows = () if resolved is None else tuple(kind.glow for kind in resolved.kinds)
                leaving = None
                if paths.meets_itself:
                    leaving = Leaving(self._context, self._exitance, lit, gather, inside=clear.clear)
                return replace(clear, glows=glows, leaving=leaving)

            tree = self._run(Stage.LIT_PATHS, key, lit_tree)
        if all(shown.inside):
            return tree
        return self._run(Stage.PATH_PARTS, [tree, resolved, shown], lambda: _of_parts(tree, resolved, shown))

    def steps(self, followed: "Followed", gbuffer: GBuffer, camera: Camera, offset: Offset) -> Steps[Traced | None]:
        """Follow the rays of a sample of the pixels and return what they found, to be added by the composite.

        Parameters
        ----------
        followed : Followed
        gbuffer : GBuffer
            Of the sample, with the relief of the surface, where it has any.
        camera : Camera
        offset : (float, float)
            Of the sample from the middle of its pixel.
        """
        tree, (width, height) = followed.tree, gbuffer.position.size
        with current(self._context):
            pixels, sight = seen_first(gbuffer, camera.eye)
        if len(pixels) == 0:
            return None
        superseded = threading.Event()

        def in_turn(rays: Ints) -> "Iterator[tuple[Ints, Sight]]":
            for start in range(0, len(rays), RAYS_A_STEP):
                part = rays[start : start + RAYS_A_STEP]
                yield np.arange(start, start + len(part)), sight.part(part)

        def beside() -> "Iterator[tuple[Ints, Sight]]":
            # By the mesh alone, which has no relief.
            for other in followed.beside(offset, width * height) if gbuffer.detail is None else ():
                yield seen_beside(tree, pixels, (width, height), jittered(camera, other, (width, height)))

        def found(parts: "Iterator[tuple[Ints, Sight]]", count: int) -> Steps[Float32]:
            return self._found(tree, parts, count, superseded, followed.highlights)

        try:
            if followed.step == 1:
                radiance = yield from found(chain(in_turn(np.arange(len(pixels))), beside()), len(pixels))
            else:
                radiance = yield from _by_few(
                    lambda rays: found(in_turn(rays), len(rays)), pixels, width, followed.step, sight
                )
        finally:
            superseded.set()
        size, inside = (width, height), tree.clear
        textures = self._run(
            Stage.PATH_TARGETS, [size, inside], lambda: self._composite.traced_textures(size, inside=inside)
        )
        if inside:
            *shown, collided = radiance
            for texture, values, share in zip(textures, shown, collided.T, strict=True):
                _write(texture, pixels, np.column_stack([values, share]))
        else:
            _write(textures[0], pixels, radiance[0])
        return Traced(textures, goes_inside=tree.clear)

    def _found(
        self,
        tree: "Tree",
        parts: "Iterator[tuple[Ints, Sight]]",
        count: int,
        superseded: threading.Event,
        highlights: float,
    ) -> Steps[Float32]:
        """Return the mean radiance of `count` places by rays, part by part: (kinds, count, 3).

        Kinds are those of `core.paths.tree.Seen`, or the first alone where no rays go on inside.
        """
        from milkglass.core.paths.tree import Seen

        kinds = len(Seen._fields) if tree.clear else 1
        radiance, counts = np.zeros((kinds, count, 3), np.float32), np.zeros(count, np.float32)

        def begun(rays: "Sight") -> "Future[Found]":
            return self._worker.submit(tree.find, rays, lambda: not superseded.is_set(), highlights)

        shown, rays = next(parts)
        following = begun(rays)
        for after in chain(parts, [None]):
            yield following
            found, numbers = following.result(), shown
            if after is not None:
                shown, following = after[0], begun(after[1])
            for layer, values in zip(radiance, tree.lit(found), strict=False):
                layer[numbers] += values
            counts[numbers] += 1.0
        radiance /= counts[:, None]
        return radiance

    def draft(self, tree: "Tree", lit: LitScene, gbuffer: GBuffer, depth: moderngl.Renderbuffer, clip: Array) -> Traced:
        """Draw a draft of what rays of all pixels would find in one kind of matter, in place of following them.

        `depth` and the world-to-clip matrix `clip` are those of the G-buffer.
        """
        run, size, buffers = self._run, gbuffer.position.size, lit.model.buffers
        back = run(Stage.BACK_TARGETS, [size], lambda: self._drafts.back_targets(size))
        run(
            Stage.BACK_FACES,
            [buffers, gbuffer.position, back, clip.tobytes()],
            lambda: self._drafts.render_back(buffers, lit.model.mesh, clip, lit.camera, gbuffer, back),
        )
        around = run(
            Stage.SIGHT_AROUND, [tree.surroundings], lambda: SurroundingTextures(self._context, tree.surroundings)
        )
        glows = tree.glows if tree.inside is None else tree.inside.glows
        glow = run(Stage.SIGHT_GLOW, [glows], lambda: GlowTextures(self._context, glows[0] if glows else None))
        targets = run(Stage.SIGHT_TARGETS, [size, depth], lambda: self._drafts.targets(size, depth))
        unscattered = tree.inside is None or tree.inside.unscattered
        drafted = Drafted(around, glow, lit.eta, tuple(tree.extinction[0]), unscattered)
        self._drafts.render(gbuffer, back, lit.camera, lit.model.mesh, drafted, targets)
        return Traced(targets.textures, goes_inside=tree.clear)


class Followed(NamedTuple):
    """How rays of sight are followed for a picture.

    Attributes
    ----------
    tree : Tree
    samples : int
        Of a pixel, all of which have rays.
    step : int
        Side of the squares of pixels of which as many rays are followed, each where it tells most.
    """

    tree: "Tree"
    samples: int
    step: int

    @property
    def shows_discs(self) -> bool:
        """Whether they show lamps in the first mirror: not where few are, which would blur what lamps outline."""
        return self.tree.mirrors and self.step == 1

    @property
    def highlights(self) -> float:
        """Radius up to which lamps are drawn as highlights, radians."""
        return DISC_FROM * SMOOTH_EDGE if self.shows_discs else np.inf

    def beside(self, offset: Offset, pixels: int) -> tuple[Offset, ...]:
        """Return the offsets of the rays that a sample at `offset` has beside its own, in a picture of so many pixels.

        What is seen through clear matter changes within a pixel, the more the fewer pixels there are.
        """
        if self.samples == 1 or self.step > 1:
            return ()
        count = max(min(FINE_RAYS // (pixels * self.samples), MOST_RAYS // self.samples), 1)
        return further_offsets(offset, self.samples, count - 1)


def _of_parts(tree: "Tree", resolved: "Resolved | None", shown: LightPaths) -> "Tree":
    """Return a tree whose refracted rays show some parts of light alone."""
    from milkglass.core.paths import Inside

    glows: tuple[Glow, ...] = ()
    if resolved is not None and shown.once != shown.often:
        glows = tuple(kind.once if shown.once else kind.often for kind in resolved.kinds)
    elif shown.once:
        glows = tree.glows
    return replace(tree, inside=Inside(shown.unscattered, glows, shown.often))


def _by_few(
    follow: "Callable[[Ints], Steps[Float32]]", pixels: Ints, width: int, step: int, sight: "Sight"
) -> Steps[Float32]:
    """Return the radiance of all k pixels by as many rays as there are squares with a side of `step`, (kinds, k, 3).

    A quarter of them is spread evenly. Half as far apart again and again, down to pixels, rays are then interpolated
    between, and followed where those around differ most, half of those that are left each time.

    Parameters
    ----------
    follow : callable
        Gives the radiance of rays, of the pixels' numbers.
    pixels, width, sight
        As of `core.paths.nearby.nearby`.
    step : int
    """
    from milkglass.core.paths.nearby import nearby

    apart = 2 * step
    chosen = first_in_squares(pixels, width, apart)
    left = len(first_in_squares(pixels, width, step)) - len(chosen)
    radiance = yield from follow(chosen)
    while apart > 1:
        closer = first_in_squares(pixels, width, apart // 2)
        shown, differ = nearby(radiance, chosen, closer, pixels, width, apart, sight)
        known = np.searchsorted(closer, chosen)
        shown[:, known], differ[known] = radiance, 0.0
        most = left if apart == 2 else left // 2
        unlike = np.sort(np.argsort(-differ, kind="stable")[:most])
        unlike = unlike[differ[unlike] > ALIKE]
        if len(unlike):
            shown[:, unlike] = yield from follow(closer[unlike])
        apart, chosen, radiance, left = apart // 2, closer, shown, left - len(unlike)
    return radiance


def first_in_squares(pixels: Ints, width: int, step: int) -> Ints:
    """Return which of some pixels is the first in its square, ascending, (m,).

    `pixels` (k,) are numbered row by row, `width` in a row, ascending; squares have a side of `step`.
    """
    columns = -(-width // step)
    squares = pixels // width // step * columns + pixels % width // step
    first = np.full(squares.max(initial=-1) + 1, -1)
    first[squares[::-1]] = np.arange(len(pixels))[::-1]
    return np.sort(first[first >= 0])


def seen_first(gbuffer: GBuffer, eye: Array) -> tuple[Ints, "Sight"]:
    """Return the pixels that show the object, (k,), numbered as OpenGL does, and where their rays meet it."""
    from milkglass.core.paths import Sight

    position = _values(gbuffer.position)
    pixels = np.flatnonzero(position[:, 3] > 0.0)
    points = position[pixels, :3]
    del position  # 16 bytes a pixel, at the peak of memory
    normals_and_bodies = _values(gbuffer.normal)[pixels]
    normals, bodies = normals_and_bodies[:, :3], normals_and_bodies[:, 3].astype(np.int32)
    if gbuffer.detail is not None:
        normals = _values(gbuffer.detail[1].shading)[pixels, :3]
    directions = np.float32(eye[3]) * points - eye[:3].astype(np.float32)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return pixels, Sight(points, normals, directions, bodies)


def seen_beside(tree: "Tree", pixels: Ints, size: tuple[int, int], clip: Array) -> "tuple[Ints, Sight]":
    """Return which of k pixels show the object, by their place among them, and where rays meet it first.

    `clip` takes world to clip space; rays go through the middles of the pixels, which are numbered as OpenGL does.
    """
    middles = np.stack([pixels % size[0], pixels // size[0]], axis=1) + 0.5
    across, to_world = 2.0 * middles / np.asarray(size) - 1.0, np.linalg.inv(clip)
    ends = (np.column_stack([across, np.tile([depth, 1.0], (len(pixels), 1))]) @ to_world for depth in (-1.0, 1.0))
    near, far = (end[:, :3] / end[:, 3:] for end in ends)
    along = (far - near) / np.linalg.norm(far - near, axis=1, keepdims=True)
    shown, sight = tree.sight(near.astype(np.float32), along.astype(np.float32))
    return shown.astype(np.int64), sight


def _write(texture: moderngl.Texture, pixels: Ints, values: Float32) -> None:
    """Write the RGBA of some pixels, (k, 4), or their RGB, (k, 3), and 0 elsewhere.

    Pixels are numbered row by row from the bottom, ascending.
    """
    width, height = texture.size
    for row in range(0, height, ROWS_WRITTEN):
        rows = min(ROWS_WRITTEN, height - row)
        first, end = np.searchsorted(pixels, [row * width, (row + rows) * width])
        band = np.zeros((rows * width, 4), np.float32)
        band[pixels[first:end] - row * width, : values.shape[1]] = values[first:end]
        texture.write(band, viewport=(0, row, width, rows))


def _values(texture: moderngl.Texture) -> Float32:
    """Read the RGBA of all pixels, (n, 4), row by row from the bottom."""
    values = np.empty((texture.size[0] * texture.size[1], 4), np.float32)
    texture.read_into(values)
    return values
