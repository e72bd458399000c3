"""Coefficients of an object's material from photographs of it, with their uncertainty.

Given are mesh, cameras and lights, as scenes, and pictures; sigma_s' and sigma_a of R, G and B follow, and one
brightness of each light (`viewer.fit.separable`). Pictures are compared in linear radiance, in means over pixels.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.core.material.library import MAX_COEFFICIENT, Material
from milkglass.viewer.files.images import Pixels8, png_bytes
from milkglass.viewer.fit.pictures import Picture
from milkglass.viewer.fit.report import sheet
from milkglass.viewer.fit.separable import Modelled, Observed, Search, Solution
from milkglass.viewer.fit.views import View
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import MaterialSettings, Vector

EXPOSURES = ("lights", "free", "known")
SIDE = 64  # pixels of the longer side, at which pictures are compared
PATHS = 1 / 60, 1 / 18, 1 / 5  # mean free paths to start from, over the longest side; three make a picture
ALBEDOS = 0.6, 0.85, 0.94, 0.98, 0.993, 0.998
# Bounds: sigma_tr times the object's longest side, and sigma_s' over sigma_a.
LEAST, MOST = np.array([1e-2, 1e-2]), np.array([2e3, 1e6])
UNTOLD = 0.7  # standard error of a logarithm from which on a coefficient is not told: a factor of two
STRUCTURED = 1.3  # residual over the noise from which on the scene does not explain the picture
LARGE = 0.15  # residual over the picture from which on it does so badly
LEAST_ERROR = 0.01  # of a logarithm of a coefficient: diffusion is no closer to light
CHANNELS = ("red", "green", "blue")


@dataclass(frozen=True, eq=False)
class Fit:
    """A material that explains pictures, and how sure that is.

    Attributes
    ----------
    material : Material
    scene : Scene
        The first scene, of this material, with the brightnesses found.
    names : tuple of str
        Of the unknowns, 6 + K.
    covariance : (6 + K, 6 + K)
        Of their logarithms: sigma_s' and sigma_a of R, G and B, brightnesses.
    brightness : (K,)
        Factors on the lights of each scene, environment last.
    pictures, modelled, residual : of (h, w, 3)
        Each picture as it was compared, what the fit makes of it, and the difference; 0 where nothing counts.
    misfit : float
        Rms residual over the picture's noise: 1 where the scene explains all but noise.
    notes : tuple of str
        What these pictures do not tell.
    renders : int
        Number of pictures that were rendered.
    """

    material: Material
    scene: Scene
    names: tuple[str, ...]
    covariance: Array
    brightness: Array
    pictures: tuple[Array, ...]
    modelled: tuple[Array, ...]
    residual: tuple[Array, ...]
    misfit: float
    notes: tuple[str, ...]
    renders: int

    @property
    def standard_errors(self) -> dict[str, tuple[float, float, float]]:
        """Standard errors of `sigma_s_prime` and `sigma_a`, 1/mm; large ones are of the logarithm, times the value."""
        relative = self.relative_errors
        return {
            key: _triple(relative[key] * np.array(getattr(self.material, key))) for key in ("sigma_s_prime", "sigma_a")
        }

    @property
    def relative_errors(self) -> dict[str, Array]:
        """Standard errors of the logarithms of `sigma_s_prime` and `sigma_a`, (3,) each, and of `brightness`, (K,)."""
        errors = np.sqrt(np.diag(self.covariance))
        return {"sigma_s_prime": errors[:6:2], "sigma_a": errors[1:6:2], "brightness": errors[6:]}

    @property
    def correlations(self) -> Array:
        """Correlations of the logarithms, as `covariance`."""
        deviations = np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        return np.asarray(self.covariance / np.outer(deviations, deviations))

    def content(self) -> dict[str, Any]:
        """Return the fit as JSON has it."""
        return {
            "material": {key: list(getattr(self.material, key)) for key in ("sigma_s_prime", "sigma_a", "g")}
            | {"eta": self.material.eta},
            "relative_standard_errors": {key: errors.tolist() for key, errors in self.relative_errors.items()},
            "brightness": self.brightness.tolist(),
            "unknowns": list(self.names),
            "covariance_of_logarithms": self.covariance.tolist(),
            "correlations": self.correlations.tolist(),
            "residual_over_noise": self.misfit,
            "notes": list(self.notes),
            "renders": self.renders,
        }

    def _repr_png_(self) -> bytes:
        """Return each picture, what the fit makes of it, and the residual, for notebooks."""
        return png_bytes(self.sheet())

    def sheet(self) -> Pixels8:
        """Return each picture, what the fit makes of it, and the residual, side by side, (h, w, 3) sRGB."""
        return sheet(self.pictures, self.modelled, self.residual)


def fit(
    scene: Scene | Sequence[Scene],
    pictures: Picture | Sequence[Picture],
    *,
    exposure: str = "lights",
    side: int = SIDE,
    progress: Callable[[str], None] = lambda _: None,
) -> Fit:
    """Return the material of a scene's object by pictures of it.

    Parameters
    ----------
    scene : Scene, or one for each picture
        Mesh, camera and lights; its material is one of those to start from, and gives eta and g.
    pictures : Picture, or several
        From `read_picture`, or `Picture.of` linear RGB, (h, w, 3).
    exposure : str
        "lights": one unknown brightness of each light in each picture; "free": lights keep their ratios, and each
        picture has one; "known": pictures have the scene's own radiance.
    side : int
        Longer side at which pictures are compared, pixels; larger ones are reduced by means.
    progress : callable
        Told a few words now and then.

    Raises
    ------
    InputError
        What cannot be fitted, in one sentence.
    """
    seen = [pictures] if isinstance(pictures, Picture) else list(pictures)
    scenes = [scene] if isinstance(scene, Scene) else list(scene)
    if not seen:
        raise InputError("there is no picture to fit; give one or more")
    if len(scenes) not in (1, len(seen)):
        raise InputError(f"there are {len(scenes)} scenes and {len(seen)} pictures; give one scene, or one for each")
    if exposure not in EXPOSURES:
        raise InputError(f"exposure is {exposure}; it must be one of {', '.join(EXPOSURES)}")
    scenes = scenes * len(seen) if len(scenes) == 1 else scenes
    progress("lighting the object")
    views = [
        _view(of_picture, picture, side, exposure != "lights") for of_picture, picture in zip(scenes, seen, strict=True)
    ]
    return _Fitting(views, exposure == "known", progress).run(scenes[0])


def _view(scene: Scene, picture: Picture, side: int, together: bool) -> View:  # noqa: FBT001
    longest = max(picture.size)
    if longest > side:
        width, height = (max(16, round(length * side / longest)) for length in picture.size)
        picture = picture.reduced((width, height))
    display = replace(scene.display, image_size=picture.size, background="black")
    return View(replace(scene, display=display), picture, together)


class _Fitting:
    """A fit on its way: views, of which each has brightnesses of its own, and how often they were rendered."""

    def __init__(self, views: Sequence[View], known: bool, progress: Callable[[str], None]) -> None:  # noqa: FBT001
        self._views, self._known, self._progress = views, known, progress
        self._given = views[0].scene.material.resolve()
        self.renders = sum(view.lights for view in views)

    def run(self, scene: Scene) -> Fit:
        size = max(view.size_mm for view in self._views)
        low, high = (np.log(bound / [size, 1.0]) for bound in (LEAST, MOST))
        search = Search(self._evaluate, self._observed(), low, high, self._known, self._progress)
        self._progress("comparing materials to start from")
        found = search.solve(search.start(self._candidates(size, low, high)))
        sigma_s_prime, sigma_a = coefficients(found.x)
        covariance = _of_coefficients(found.x, found.covariance)
        material = replace(self._given, name="fitted", sigma_s_prime=sigma_s_prime, sigma_a=sigma_a, source="fit")
        starts = np.cumsum([0, *(len(view.rows) for view in self._views)])
        ranges = [slice(a, b) for a, b in itertools.pairwise(starts)]
        images, modelled, residual = (
            tuple(view.image(values[part]) for view, part in zip(self._views, ranges, strict=True))
            for values in (self._values, found.modelled, found.residual)
        )
        names = [f"{key} {channel}" for channel in CHANNELS for key in ("sigma_s_prime", "sigma_a")]
        names += [f"brightness {k}" for k in range(1, len(found.brightness) + 1)]
        return Fit(
            material,
            self._fitted(scene, material, found.brightness),
            tuple(names),
            covariance,
            found.brightness,
            images,
            modelled,
            residual,
            found.misfit,
            tuple(_notes(found, np.sqrt(np.diag(covariance)), low, high)),
            self.renders,
        )

    @property
    def _values(self) -> Array:
        return np.concatenate([view.values for view in self._views])

    def _observed(self) -> Observed:
        starts = np.cumsum([0, *(len(view.rows) for view in self._views)])
        pairs = np.concatenate([view.pairs() + start for view, start in zip(self._views, starts[:-1], strict=True)], 1)
        blocks = []
        for of_views in zip(*(view.blocks() for view in self._views), strict=True):
            labels = [np.stack([np.full(len(block), i), block]) for i, block in enumerate(of_views)]
            _, inverse = np.unique(np.concatenate(labels, axis=1), axis=1, return_inverse=True)
            blocks.append(inverse.ravel())
        return Observed(self._values, np.concatenate([view.valid for view in self._views]), pairs, blocks)

    def _candidates(self, size: float, low: Array, high: Array) -> list[tuple[Array, Modelled]]:
        """Return materials to start from, the scene's own among them, with their pictures in all channels."""
        pairs = [(albedo / (path * size), (1.0 - albedo) / (path * size)) for path in PATHS for albedo in ALBEDOS]
        pairs += zip(self._given.sigma_s_prime, self._given.sigma_a, strict=True)
        xs = list(np.clip(coordinates(np.array(pairs)), low, high))
        if not all(view.is_alike for view in self._views):
            return [(x, self._evaluate(np.array([x] * 3))) for x in xs]
        found = []
        for three in (xs[i : i + 3] for i in range(0, len(xs), 3)):
            pictures = self._modelled(np.array(three), white=True)
            for c, x in enumerate(three):
                alone = [
                    view.colored(picture.of_channel(c)) for view, picture in zip(self._views, pictures, strict=True)
                ]
                found.append((x, _joined(alone)))
        return found

    def _evaluate(self, x: Array) -> Modelled:
        return _joined(self._modelled(x))

    def _modelled(self, x: Array, *, white: bool = False) -> list[Modelled]:
        sigma_s_prime, sigma_a = coefficients(x)
        material = replace(self._given, name="custom", sigma_s_prime=sigma_s_prime, sigma_a=sigma_a)
        self.renders += sum(view.lights for view in self._views)
        return [view.modelled(material, white=white) for view in self._views]

    def _fitted(self, scene: Scene, material: Material, brightness: Array) -> Scene:
        """Return a scene of a material, with its lights as bright as in the first picture."""
        settings = replace(MaterialSettings.of(material), profile=scene.material.profile)
        settings = replace(settings, profile_table=scene.material.profile_table)
        shining = [light for light in scene.all_lights() if light.on and any(light.brightness)]
        count = len(shining) + scene.environment.given
        factors = np.resize(brightness[: self._views[0].lights], count)
        lights, by = [], iter(factors)
        for light in scene.all_lights():
            factor = float(next(by)) if light.on and any(light.brightness) else 1.0
            red, green, blue = (factor * channel for channel in light.brightness)
            lights.append(light.brightened((red, green, blue)))
        environment = scene.environment
        if environment.given:
            environment = replace(environment, intensity=environment.intensity * float(factors[-1]))
        return replace(scene, material=settings, lights=tuple(lights), environment=environment)


def _joined(views: Sequence[Modelled]) -> Modelled:
    """Return the pictures of all views, whose brightnesses are apart: a light of one is dark in the others."""
    if len(views) == 1:
        return views[0]
    counts, pixels = [v.scattered.shape[0] for v in views], [v.scattered.shape[1] for v in views]
    parts = []
    for key in ("scattered", "highlights"):
        whole, k, n = np.zeros((sum(counts), sum(pixels), 3)), 0, 0
        for view, count, length in zip(views, counts, pixels, strict=True):
            whole[k : k + count, n : n + length] = getattr(view, key)
            k, n = k + count, n + length
        parts.append(whole)
    return Modelled(*parts)


def coordinates(pairs: Array) -> Array:
    """Return what is searched for: log sigma_tr and log sigma_s' / sigma_a, (n, 2), of sigma_s' and sigma_a, (n, 2).

    Materials that look alike have sigma_tr in common: in these coordinates their valley is straight.
    """
    scattering, absorption = np.maximum(pairs, 1e-30).T
    attenuation = np.sqrt(3.0 * absorption * (absorption + scattering))
    return np.asarray(np.log(np.stack([attenuation, scattering / absorption], axis=1)))


def coefficients(x: Array) -> tuple[Vector, Vector]:
    """Return sigma_s' and sigma_a of R, G and B, 1/mm, of `coordinates`, (3, 2)."""
    attenuation, ratio = np.exp(x).T
    absorption = attenuation / np.sqrt(3.0 * (1.0 + ratio))
    limits = (np.minimum(values, MAX_COEFFICIENT) for values in (ratio * absorption, absorption))
    sigma_s_prime, sigma_a = (_triple(values) for values in limits)
    return sigma_s_prime, sigma_a


def _of_coefficients(x: Array, covariance: Array) -> Array:
    """Return the covariance of the coefficients' logarithms, channel by channel, of that of coordinates x, (3, 2)."""
    turn = np.eye(len(covariance))
    for c, albedo in enumerate(1.0 / (1.0 + np.exp(-x[:, 1]))):
        turn[2 * c : 2 * c + 2, 2 * c : 2 * c + 2] = [[1.0, 1.0 - 0.5 * albedo], [1.0, -0.5 * albedo]]
    least = np.diag(np.where(np.arange(len(covariance)) < 6, LEAST_ERROR**2, 0.0))
    return np.asarray(turn @ covariance @ turn.T + least)


def _notes(found: Solution, errors: Array, low: Array, high: Array) -> list[str]:
    """Return sentences on what the pictures do not tell; errors are of the coefficients' logarithms."""
    notes, misfit, relative = [], found.misfit, found.relative
    values = np.array(coefficients(found.x)).T
    if not found.is_settled:
        notes.append(
            "the search ended before it had settled; start from a scene whose material is nearer to what is seen"
        )
    if misfit > STRUCTURED or relative.max() > LARGE:
        notes.append(
            f"the scene does not explain the picture: what is left is {misfit:.1f} times its noise, and "
            f"{100.0 * relative.max():.0f} % of it; look at mesh, camera and lights before you trust these numbers"
        )
    for c, channel in enumerate(CHANNELS):
        if np.min([found.x[c] - low, high - found.x[c]]) < 1e-6:
            notes.append(
                f"the {channel} coefficients are at the end of what was tried ({values[c, 0]:.3g} and "
                f"{values[c, 1]:.3g} 1/mm): their errors are one-sided"
            )
        for i, quantity in enumerate(("scattering", "absorption")):
            error, name = errors[2 * c + i], f"the {channel} {quantity}"
            if error > UNTOLD:
                advice = (
                    "make the object thicker or light it from behind"
                    if i == 1
                    else "take a picture in which light crosses less of it, or from another side"
                )
                factor = "a factor of more than 100" if error > 4.6 else f"a factor of {np.exp(error):.2g}"
                notes.append(
                    f"{name} cannot be told from these pictures (within {factor}): it changes little of what is seen; "
                    f"{advice}"
                )
    return notes


def _triple(values: Array) -> tuple[float, float, float]:
    red, green, blue = (float(value) for value in values)
    return red, green, blue
