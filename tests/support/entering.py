"""Light on surface samples, as transport takes it."""

import numpy as np

from milkglass.core.arrays import Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.transport.base import EnteringFlux, EnteringLight, Transport, WholeObject


def entering(
    transport: Transport,
    mesh: Mesh,
    samples: SurfaceSamples,
    flux: Float32 | None = None,
    lights: tuple[EnteringLight, ...] = (),
    profiles=(),
    media=(),
    rotation=None,
) -> EnteringFlux:
    """Place a flux (n, 3), that of the lights together if not given, on the layers of a transport."""
    grid = transport.grid(mesh, np.eye(3) if rotation is None else rotation)
    if flux is None:
        flux = sum((light.flux for light in lights), np.zeros((len(samples), 3), np.float32))
    coordinates = grid.coordinates(samples.points).astype(np.float32)
    return EnteringFlux(WholeObject(mesh, samples), grid, coordinates, flux, tuple(lights), profiles, media)
