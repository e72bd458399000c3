"""Fits of pictures of our own making, whose material is known: `python -m tests.support.fit_truth [COUNT] [LIGHT...]`.

Random materials of an albedo of 0.5 to 0.999 and a mean free path of 1/60 to 1/3 of the object, in 1 % noise at an
unknown brightness. Each row is a fit; the last one says how many coefficients are within two stated standard errors,
and within 5 % where less than 3 % is stated.
"""

import resource
import sys
import time
from dataclasses import replace

import numpy as np

import milkglass as mg
from milkglass.core.geometry.mesh import Mesh
from tests.support.shapes import cube
from tests.support.solids import ball, block, mesh_of

LIGHTS = {
    "front": {"lights": (mg.DirectionalLight((0.4, 0.5, 0.77), (3.0, 3.0, 3.0)),)},
    "back": {"lights": (mg.DirectionalLight((-0.5, 0.35, -0.8), (3.0, 3.0, 3.0)),)},
    "probe": {"lights": (), "environment": mg.EnvironmentSettings(builtin="studio")},
}
SIDE = 64  # pixels
FACTOR = 2.7
NOISE = 0.01


def egg() -> Mesh:
    part = ball(10.0)
    part.apply_scale((1.0, 0.7, 0.6))
    return mesh_of(part)


SHAPES = {"egg": egg, "cube": cube, "plank": lambda: mesh_of(block((20.0, 12.0, 5.0)))}


def material(rng: np.random.Generator, size: float, longest: float = 1 / 3) -> mg.MaterialSettings:
    free_path = size * np.exp(rng.uniform(np.log(1 / 60), np.log(longest), 3))
    albedo = 1.0 - np.exp(rng.uniform(np.log(1e-3), np.log(0.5), 3))
    scattering, absorption = (tuple((part / free_path).tolist()) for part in (albedo, 1.0 - albedo))
    return mg.MaterialSettings(sigma_s_prime=scattering, sigma_a=absorption, eta=1.4)


def fitted(scene: mg.Scene, rng: np.random.Generator) -> tuple[mg.Fit, np.ndarray, np.ndarray]:
    """Return the fit of a noisy picture of a scene, its errors and those stated, (6,) each, of logarithms."""
    radiance = FACTOR * mg.render(scene).radiance.astype(np.float64)
    radiance *= 1.0 + NOISE * rng.standard_normal(radiance.shape)
    start = replace(scene, material=mg.MaterialSettings(name="marble", eta=1.4))
    found = mg.fit(start, mg.Picture.of(radiance))
    keys = "sigma_s_prime", "sigma_a"
    ratios = [np.array(getattr(found.material, key)) / getattr(scene.material, key) for key in keys]
    return found, np.log(np.concatenate(ratios)), np.concatenate([found.relative_errors[key] for key in keys])


def main(count: int, lights: list[str]) -> None:
    rows = []
    for i in range(count):
        for light in lights:
            rng = np.random.default_rng((i, *light.encode()))
            shape = list(SHAPES)[i % len(SHAPES)]
            mesh, display = SHAPES[shape](), mg.DisplaySettings(image_size=(SIDE, SIDE))
            scene = mg.Scene(
                model=mg.ModelSettings(mesh=mesh), material=material(rng, 20.0), display=display, **LIGHTS[light]
            )
            began = time.process_time()
            found, errors, stated = fitted(scene, rng)
            took = time.process_time() - began
            rows.append((errors, stated, took, found.renders, bool(found.notes)))
            print(shape, light, f"{took:.0f} CPU s, {found.renders} renders, misfit {found.misfit:.2f}")  # noqa: T201
            for name, values in (("errors", errors), ("stated", stated)):
                print("  ", name, *(f"{100 * value:.1f}" for value in values), "%", flush=True)  # noqa: T201
            print(*(f"    {note}" for note in found.notes), sep="\n", flush=True)  # noqa: T201
    errors, stated = (np.array([row[k] for row in rows]) for k in (0, 1))
    silent = ~np.array([row[4] for row in rows])
    for name, chosen in (("all", np.ones(len(rows), bool)), ("without a note", silent)):
        if chosen.any():
            size, said = np.abs(errors[chosen]), stated[chosen]
            sure = size[said < 0.03]
            took, renders = (np.median([row[k] for row in rows]) for k in (2, 3))
            print(  # noqa: T201
                f"{name}, {chosen.sum()} fits: {100 * (size <= 2 * said).mean():.0f} % within two standard errors, "
                f"{100 * (sure < 0.05).mean() if len(sure) else 100:.0f} % of {len(sure)} sure ones within 5 %, "
                f"median {took:.1f} CPU s, {renders:.0f} renders"
            )
    print(f"memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3:.0f} MB")  # noqa: T201


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 3, sys.argv[2:] or list(LIGHTS))
