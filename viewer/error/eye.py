"""Error of whole pixels against paths from the eye: what is mirrored, seen through, and scattered once and more often.

Photons judge exitance, of which clear matter has none. Paths from the eye (`core.reference.eye_paths`) judge radiance,
in blocks of pixels: what a scan refracts differs from pixel to pixel. The picture is drawn again for them, small, with
sharp lamps as discs, since no path from the eye meets a point.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_erosion

from milkglass.core.arrays import Array, Bools, Float32, Floats, Ints
from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.probe import Probe
from milkglass.core.paths.lamps import BALL, EVERYWHERE
from milkglass.core.paths.resolution import resolved_share
from milkglass.core.reference.eye_paths import PARTS, GroupRadiance, LitObject, SeenLight, group_radiance
from milkglass.core.reference.near_lamps import NearBall, NearPanel
from milkglass.core.reference.photon_lights import Beam, Surroundings
from milkglass.viewer.render.picture import Frame
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.camera import model_camera, world_to_probe
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.scene import Scene

LARGEST = 160  # pixels along the longer side of the picture that is judged
SAMPLES = 4  # of a pixel of it
BLOCK = 8  # pixels along the sides of a block
MOST_BLOCKS = 64
EDGE_PIXELS = 2  # left out along outlines
ROUNDS = 16
LEAST_ANGLE_DEG = 30.0  # of lamps: paths find smaller ones too seldom
MOST_COLLISIONS = 10.0  # of a path: beyond, photons from the lights are by far the faster ones
SIGNIFICANT = 2.0  # standard errors that an rms is above nothing, at least
SCATTERED, INSIDE = ("once", "often"), PARTS[1:]


@dataclass(frozen=True)
class PartError:
    """Error of a part of radiance, of R, G and B each.

    Attributes
    ----------
    share : (3,)
        Of the part in the radiance of the paths.
    ratio, rms : (3,)
        Mean over the paths' mean; root mean square difference of blocks over the paths' rms, without their noise, and 0
        where it is below that. NaN where the paths find nothing, or the transport does not tell the part apart.
    noise : (3,)
        Standard error of the blocks, over the same.
    """

    share: tuple[float, ...]
    ratio: tuple[float, ...]
    rms: tuple[float, ...]
    noise: tuple[float, ...]


@dataclass(frozen=True)
class EyeError:
    """Errors of a picture's pixels.

    Attributes
    ----------
    whole : PartError
        Of all radiance; without the mirror's where that is no smooth surface's.
    parts : dict
        Of `PARTS`, and of "scattered", once and often together.
    blocks, paths : int
    lost : float
        Share of the paths that is lost at edges.
    """

    whole: PartError
    parts: dict[str, PartError]
    blocks: int
    paths: int
    lost: float


def judged_by_eye(scene: Scene, mesh: Mesh) -> tuple[bool, str]:
    """Tell whether paths from the eye are to judge a scene rather than photons from its lights, and why, a clause."""
    collisions = lit_object(scene, mesh, None).collisions
    course = f"light loses its course about {collisions:.2g} times in the object at most"
    if collisions > MOST_COLLISIONS:
        return False, f"{course}: paths from the eye would take many times as long, and show little but its surface"
    return True, f"{course}: pixels show more than its surface"


def lit_object(scene: Scene, mesh: Mesh, probe: Probe | None, shares: Sequence[float] = (0.0, 0.0, 0.0)) -> LitObject:
    """Return what paths from the eye meet in a scene.

    Told apart they are as in a picture whose nodes resolve the free paths of R, G and B by so much (`shares`): that has
    sigma_s' (1 + share g) scatter, and the rest of sigma_s, the most forward, go on as if it had not.
    """
    material = scene.material.resolve()
    lights = [_seen(light) for light in scene.effective_lights()]
    if probe is not None and scene.environment.intensity > 0.0:
        turn = world_to_probe(scene.environment.rotation_deg)
        lights.append(Surroundings(probe.latlong, turn, scene.environment.intensity))
    g = np.array(material.g)
    matter = np.array(material.sigma_s_prime) / (1.0 - g), np.array(material.sigma_a), g
    return LitObject(mesh, *matter, material.eta, lights, 1.0 - (1.0 - g) * (1.0 + np.asarray(shares) * g))


def _seen(light: Light) -> SeenLight:
    """Return a light as paths from the eye meet it."""
    if light.DISTANT:
        return Beam(light.vector, light.brightness, light.apparent_deg(0.0))
    lamp = light.seen()
    centre, radiance = np.array(lamp.place), np.array(lamp.radiance)
    if lamp.shape == BALL:
        return NearBall(centre, lamp.size, radiance)
    return NearPanel(centre, np.array(lamp.width), np.array(lamp.height), np.array(lamp.forward), radiance)


def judged(scene: Scene) -> Scene:
    """Return the scene whose picture is judged: small, without sharp lamps, and without a ground."""
    width, height = scene.display.image_size
    scale = min(1.0, LARGEST / max(width, height))
    size = max(1, round(scale * width)), max(1, round(scale * height))
    return replace(
        scene,
        display=replace(scene.display, image_size=size),
        lights=tuple(light.widened(LEAST_ANGLE_DEG) for light in scene.all_lights()),
        ground=replace(scene.ground, on=False),
    )


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of pixels of a picture that shows the object there.

    Attributes
    ----------
    rows, columns : (k,) int
        Of all pixels, top row first.
    of_pixel : (k,) int
        Block of each pixel, ascending.
    starts : (n + 1,) int
        First pixel of each block, and k.
    """

    rows: Ints
    columns: Ints
    of_pixel: Ints
    starts: Ints

    @property
    def count(self) -> int:
        """Return how many there are."""
        return len(self.starts) - 1

    @classmethod
    def of(cls, alpha: Floats, seed: int) -> "Blocks":
        """Return some blocks of a picture with coverage (h, w), at least half of whose pixels the object covers.

        Raises
        ------
        InputError
            If there are none.
        """
        used = binary_erosion(alpha == 1.0, iterations=EDGE_PIXELS)
        rows, columns = np.nonzero(used)
        across = -(-alpha.shape[1] // BLOCK)
        block = rows // BLOCK * across + columns // BLOCK
        found, counts = np.unique(block, return_counts=True)
        found = found[2 * counts >= BLOCK * BLOCK]
        if len(found) == 0:
            raise InputError("the picture shows too little of the object to compare; enlarge it")
        if len(found) > MOST_BLOCKS:
            found = np.sort(np.random.default_rng(seed).choice(found, MOST_BLOCKS, replace=False))
        chosen = np.flatnonzero(np.isin(block, found))
        chosen = chosen[np.argsort(block[chosen], kind="stable")]
        of_pixel = np.searchsorted(found, block[chosen])
        return cls(rows[chosen], columns[chosen], of_pixel, np.searchsorted(of_pixel, np.arange(len(found) + 1)))

    def means(self, image: Floats) -> Array:
        """Return the mean of an image (h, w, 3) over each block, (n, 3)."""
        pixels = image[self.rows, self.columns].astype(np.float64)
        return np.asarray(np.add.reduceat(pixels, self.starts[:-1]) / np.diff(self.starts)[:, None])

    def shots(
        self, to_world: Array, size: tuple[int, int], count: int, rng: np.random.Generator
    ) -> tuple[Array, Array, Ints]:
        """Return the origins and directions (m, 3) of `count` paths of each block, and its number.

        Parameters
        ----------
        to_world : (4, 4)
            Clip to world space, row vectors.
        size : (width, height)
        count : int
        rng : Generator
        """
        groups = np.repeat(np.arange(self.count), count)
        spread = np.diff(self.starts)[groups]
        pixel = self.starts[groups] + (rng.random(len(groups)) * spread).astype(np.int64)
        u, v = rng.random((2, len(groups)))
        x = 2.0 * (self.columns[pixel] + u) / size[0] - 1.0
        y = 1.0 - 2.0 * (self.rows[pixel] + v) / size[1]
        near, far = (
            _unprojected(np.stack([x, y, np.full(len(x), z), np.ones(len(x))], axis=1) @ to_world) for z in (-1, 1)
        )
        directions = far - near
        return near, directions / np.linalg.norm(directions, axis=1, keepdims=True), groups


def _unprojected(points: Array) -> Array:
    return np.asarray(points[:, :3] / points[:, 3:])


def unseen_light(scene: Scene) -> str | None:
    """Return the reason why paths from the eye do not meet a light of a scene, in a few words, or None."""
    if any(light.seen().cone != EVERYWHERE for light in scene.effective_lights()):
        return "no path from the eye meets a spot light, which is a point"
    return None


def eye_error(renderer: Renderer, scene: Scene, paths: int, seed: int, progress: Callable[[float], None]) -> EyeError:
    """Return the errors of a scene's picture, drawn anew, against so many paths from the eye in all.

    Raises
    ------
    InputError
        As `Renderer.render`; if the picture shows too little of the object.
    """
    scene = judged(scene)
    frame = renderer.render(scene, samples=SAMPLES)
    lit = renderer.light(scene)
    once = np.zeros_like(frame.scattered)
    if lit.beams is not None:
        alone = replace(scene.transport, light_paths="once")
        once = renderer.render(replace(scene, transport=alone), samples=SAMPLES).scattered
    shares = [0.0 if lit.beams is None else resolved_share(medium, lit.grid) for medium in lit.media]
    size, mesh = scene.display.image_size, lit.model.mesh
    blocks = Blocks.of(frame.alpha, seed)
    to_world = np.asarray(np.linalg.inv(model_camera(scene.camera, mesh, size).world_to_clip), np.float64)
    of_block = max(1, round(paths / (ROUNDS * blocks.count)))
    probe = renderer.probe(scene.environment) if scene.environment.given else None
    found = group_radiance(
        lit_object(scene, mesh, probe, shares),
        lambda rng: blocks.shots(to_world, size, of_block, rng),
        blocks.count,
        ROUNDS,
        seed,
        progress,
    )
    drawn = Drawn(frame, once, np.array(shares) == 1.0, scene.gloss.is_smooth and scene.gloss.strength == 1.0)
    return _compared(drawn, blocks, found, of_block * ROUNDS * blocks.count)


class Drawn(NamedTuple):
    """What is judged.

    Attributes
    ----------
    frame : Frame
    once : (h, w, 3) float32
        What of it has scattered once.
    apart : (3,) bool
        Whether that is told apart in R, G and B.
    mirrors : bool
        Whether its surface mirrors as a smooth one does.
    """

    frame: Frame
    once: Float32
    apart: Bools
    mirrors: bool


def _compared(drawn: Drawn, blocks: Blocks, found: GroupRadiance, paths: int) -> EyeError:
    """Return the errors of a frame."""
    frame, apart, is_mirror = drawn.frame, drawn.apart, drawn.mirrors
    mirror, through, scattered = (blocks.means(of) for of in (frame.specular, frame.unscattered, frame.scattered))
    single = blocks.means(drawn.once)
    total = found.of(PARTS if is_mirror else INSIDE)[0].mean(axis=0)

    everywhere = np.ones(3, np.bool_)

    def error(ours: Array, parts: tuple[str, ...], known: Bools = everywhere) -> PartError:
        return part_error(ours, *found.of(parts), total, known)

    return EyeError(
        error(mirror + through + scattered, PARTS) if is_mirror else error(through + scattered, INSIDE),
        {
            "mirror": error(mirror, ("mirror",), everywhere & is_mirror),
            "unscattered": error(through, ("unscattered",)),
            "once": error(single, ("once",), apart),
            "often": error(scattered - single, ("often",), apart),
            "scattered": error(scattered, SCATTERED),
        },
        blocks.count,
        paths,
        found.lost,
    )


def part_error(ours: Array, truth: Array, noise: Array, total: Array, known: Bools) -> PartError:
    """Return the error of n blocks, (n, 3), against paths with their standard error; `total` (3,) is all radiance."""
    noise2 = np.square(noise).mean(axis=0)
    size = np.sqrt(np.maximum(np.square(truth).mean(axis=0) - noise2, 0.0))
    rms2 = np.square(ours - truth).mean(axis=0) - noise2
    rms2 = np.where(rms2 > SIGNIFICANT * np.sqrt(2.0 / len(truth)) * noise2, rms2, 0.0)
    visible = size > np.sqrt(noise2)  # else they have found next to nothing

    def over(values: Array, by: Array, where: Bools) -> tuple[float, ...]:
        return tuple(np.divide(values, by, out=np.full(3, np.nan), where=where & (by > 0.0)).tolist())

    mean = truth.mean(axis=0)
    return PartError(
        over(mean, total, np.ones(3, np.bool_)),
        over(ours.mean(axis=0), mean, visible & known),
        over(np.sqrt(rms2), size, visible & known),
        over(np.sqrt(noise2), size, visible),
    )
