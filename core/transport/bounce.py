"""Light that leaves the object and enters it again once, for methods that solve no equation.

One bounce only: on thin concave parts dipoles let out more than enters, and further bounces would grow. What leaves is
scaled to at most a' of what has entered.
"""

import numpy as np

from milkglass.core.arrays import Array, Float32
from milkglass.core.light.exchange import Exchange
from milkglass.core.light.ground import GroundReturn
from milkglass.core.stages import Stage, Stages
from milkglass.core.transport.base import EnteringFlux


def reentering(lit: EnteringFlux, exchange: Exchange, exitance: Array, stages: Stages) -> tuple[Float32, Float32]:
    """Return the light that enters again: irradiance at the exchange's vertices (m, 3), flux of the samples (n, 3).

    Parameters
    ----------
    lit : EnteringFlux
        That has entered first.
    exchange : Exchange
    exitance : (n, 3)
        M at the samples of the first light.
    stages : Stages
    """
    samples, eta = lit.solid.samples, lit.media[0].eta
    spacing = float(np.sqrt(lit.solid.area / max(len(samples), 1)))
    emitters = stages.run(
        Stage.EXCHANGE_GEOMETRY,
        (exchange, samples),
        lambda: exchange.emitters(samples.points, samples.normals, spacing),
    )
    matrix = stages.run(
        Stage.SURFACE_EXCHANGE, (exchange, samples, eta), lambda: exchange.hits.matrix(eta, emitters, len(samples))
    )
    at_samples = stages.run(Stage.BODY_INTERPOLATION, (exchange, samples), lambda: exchange.at_samples(samples))
    leaving = np.maximum(exitance, 0.0)
    total = np.einsum("i,ij->j", samples.areas.astype(np.float64), leaving)
    most = np.array([medium.albedo for medium in lit.media]) * lit.flux.sum(axis=0, dtype=np.float64)
    leaving = leaving * np.minimum(1.0, most / np.maximum(total, np.finfo(np.float64).tiny))
    if exchange.leaving is not None:
        leaving = leaving * exchange.leaving
    leaving = leaving.astype(np.float32)
    irradiance = np.asarray(matrix @ leaving)
    if (ground := exchange.ground) is not None:
        below = stages.run(
            Stage.SURFACE_GROUND, (ground, emitters, eta), lambda: GroundReturn(ground, eta, emitters, len(samples))
        )
        irradiance = irradiance + np.stack([below.irradiance(i, leaving[:, i]) for i in range(3)], axis=1)
    flux = exchange.tinted(at_samples @ irradiance) * samples.areas[:, None]
    return irradiance, np.asarray(flux, np.float32)
