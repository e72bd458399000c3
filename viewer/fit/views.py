"""What a scene's camera sees of an object in one light at a time, as linear arrays of the pixels that count."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_erosion

from milkglass.core.arrays import Array, Bools, Float32, Ints
from milkglass.core.errors import InputError
from milkglass.core.material.library import Material
from milkglass.viewer.assets.keeper import Assets
from milkglass.viewer.fit.pictures import Picture
from milkglass.viewer.fit.separable import Modelled
from milkglass.viewer.render.picture import Frame
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.lights import Light
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import EnvironmentSettings, MaterialSettings

SAMPLES = 4  # of a pixel
TOLERANCE = 1e-5  # of a solution: what it begins from then changes pictures by a thousandth of a step's change
WHOLE = 0.999  # coverage from which on a pixel is of the object alone
LEAST_PIXELS = 50  # of the object
BLOCKS = 4, 8, 16  # pixels on a side, over which residuals may hang together


@dataclass(frozen=True)
class Illuminant:
    """A light of a scene alone, or all of them.

    Attributes
    ----------
    scene : Scene
        Lit by it alone.
    color : (3,)
        Its share of its white, by which pictures of white light are multiplied; 1 where light stays as it is.
    """

    scene: Scene
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)


def sources(scene: Scene, *, together: bool) -> list[Illuminant]:
    """Return the lights of a scene, the environment last; `together`, all of them as one.

    Raises
    ------
    InputError
        Where nothing shines.
    """
    lights = scene.effective_lights()
    if not lights and not scene.environment.given:
        raise InputError("no light of the scene shines; give it one (lights), or an environment")
    if together:
        return [Illuminant(scene)]
    alone = replace(scene, environment=EnvironmentSettings())
    if is_alike(scene):
        found = [Illuminant(replace(alone, lights=(_white(light),)), _share(light.brightness)) for light in lights]
    else:
        found = [Illuminant(replace(alone, lights=(light,))) for light in lights]
    return [*found, Illuminant(replace(scene, lights=()))] if scene.environment.given else found


def is_alike(scene: Scene) -> bool:
    """Whether R, G and B differ by the material and the lamps' colours alone, so that any may stand for another."""
    surface = scene.model.path is None and scene.model.texture is None and scene.model.normal_map is None
    plain = scene.detail.albedo == "off" or scene.model.mesh is not None or surface
    return plain and not scene.environment.given and not scene.ground.on and not scene.materials


def _white(light: Light) -> Light:
    most = max(light.brightness)
    return light.brightened((most, most, most))


def _share(brightness: tuple[float, float, float]) -> tuple[float, float, float]:
    red, green, blue = (channel / max(brightness) for channel in brightness)
    return red, green, blue


@dataclass(eq=False)
class View:
    """A picture beside what a scene shows.

    Parameters
    ----------
    scene : Scene
        Of the picture's size.
    picture : Picture
    together : bool
        Whether lights keep their ratios.
    """

    scene: Scene
    picture: Picture
    together: bool

    def __post_init__(self) -> None:
        self._sources = sources(self.scene, together=self.together)
        assets = Assets()
        self._renderers = [Renderer(assets=assets, tolerance=TOLERANCE) for _ in self._sources]
        frames = self._frames(self.scene.material)
        if frames[0].quality.facts.uses_profile:
            raise InputError(
                f"a fit needs transport in the object itself, and this scene has {frames[0].quality.method}; choose "
                "transport diffusion and a closed model"
            )
        resolution = frames[0].quality.resolution
        fixed = replace(self.scene.transport, resolution=resolution)  # one grid, whatever the material
        self._sources = [replace(of, scene=replace(of.scene, transport=fixed)) for of in self._sources]
        self.counts = binary_erosion(frames[0].mask >= WHOLE)[..., None] & self.picture.counts
        seen = self.counts.any(axis=2)
        if np.count_nonzero(seen) < LEAST_PIXELS:
            raise InputError(
                f"{self.picture.name} has {np.count_nonzero(seen)} pixels that count where the scene shows the object; "
                "look at the mask, the camera and the exposure"
            )
        self.rows, self.columns = np.nonzero(seen)
        self.size_mm = float(np.ptp(self._renderers[0].light(self._sources[0].scene).model.mesh.bounds, axis=0).max())

    @property
    def lights(self) -> int:
        """Number of brightnesses."""
        return len(self._sources)

    @property
    def is_alike(self) -> bool:
        """Whether a picture in R may stand for one in B."""
        return not self.together and all(is_alike(source.scene) for source in self._sources)

    @property
    def values(self) -> Array:
        """The picture's pixels that count, (n, 3)."""
        return np.asarray(self.picture.pixels[self.rows, self.columns])

    @property
    def valid(self) -> Bools:
        """Which channels of them do, (n, 3)."""
        return np.asarray(self.counts[self.rows, self.columns])

    def pairs(self) -> Ints:
        """Return neighbours in a row or a column among the pixels that count, (2, m)."""
        index = np.full(self.counts.shape[:2], -1)
        index[self.rows, self.columns] = np.arange(len(self.rows))
        found = [np.stack([index[:, :-1], index[:, 1:]]), np.stack([index[:-1], index[1:]])]
        both = np.concatenate([pair.reshape(2, -1) for pair in found], axis=1)
        return np.asarray(both[:, (both >= 0).all(axis=0)])

    def blocks(self) -> list[Ints]:
        """Return the block of each pixel that counts, (n,), for each of `BLOCKS`."""
        width = self.counts.shape[1]
        return [(self.rows // side) * width + self.columns // side for side in BLOCKS]

    def modelled(self, material: Material, *, white: bool = False) -> Modelled:
        """Return pictures of a material in each light alone, (K, n, 3), in white light if asked for."""
        frames = self._frames(MaterialSettings.of(material))
        colors = [(1.0, 1.0, 1.0) if white else source.color for source in self._sources]

        def pixels(values: Sequence[Float32]) -> Array:
            of_lights = [plane[self.rows, self.columns] * color for plane, color in zip(values, colors, strict=True)]
            return np.stack(of_lights).astype(np.float64)

        # Images of lamps in the surface and through it are as sharp as the lamp, and a pixel may meet them or not.
        highlights = pixels([frame.specular + frame.unscattered for frame in frames])
        return Modelled(pixels([frame.subsurface for frame in frames]) + highlights, highlights)

    def colored(self, modelled: Modelled) -> Modelled:
        """Return pictures of white lights in their colours."""
        colors = np.array([source.color for source in self._sources])[:, None, :]
        return Modelled(modelled.scattered * colors, modelled.highlights * colors)

    def _frames(self, material: MaterialSettings) -> list[Frame]:
        return [
            renderer.render(replace(source.scene, material=material), samples=SAMPLES)
            for renderer, source in zip(self._renderers, self._sources, strict=True)
        ]

    def image(self, values: Array) -> Array:
        """Return values of the pixels that count, (n, 3), as a picture, (h, w, 3), 0 elsewhere."""
        picture = np.zeros(self.picture.pixels.shape)
        picture[self.rows, self.columns] = values
        return picture
