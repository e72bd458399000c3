"""Transports that sum a profile over the surface, (1): exitance is the deposited flux convolved with a kernel.

M(x) = sum of W(x) O over nodes near x + a local term: W spreads flux over the layers and gathers exitance from them, O
is the deposited flux convolved, and the local term is what the layers are too coarse for. Each step is kept until
something that it depends on changes: kernels with (material, layers), the deposit with (light, layers).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from milkglass.core.arrays import Array, Float32
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.grid.atlas import Atlas
from milkglass.core.grid.kernels import Kernels, Spectra
from milkglass.core.grid.layers import LayerGrid, deposit, gather
from milkglass.core.grid.shape import ConvolutionShape
from milkglass.core.profiles.base import Profile, Profiles
from milkglass.core.stages import Stage, Stages
from milkglass.core.threads import one_blas_thread, pool_map
from milkglass.core.transport.base import EnteringFlux, GoOn, Scattered, SurfaceLights
from milkglass.core.transport.bounce import reentering
from milkglass.core.transport.pixels import LocalTerm, PixelTables


@dataclass(eq=False)
class FftTransport(ABC):
    """Deposit, kernels and convolution; layers, weights, kernels and the local term are left to the methods.

    Parameters
    ----------
    kernels : Kernels
        Keeps the spectra and convolvers.
    """

    kernels: Kernels = field(default_factory=Kernels, kw_only=True)

    sweeps = 1

    def scatter(self, lit: EnteringFlux, stages: Stages, go_on: GoOn | None = None) -> "NodeExitance":
        """Return the exitance at the nodes of the light that enters a solid, in one step: `go_on` is not called."""
        lit = lit.with_unscattered(stages)
        first = self._scattered(lit, stages)
        if lit.exchange is None:
            return first
        weights = self.weights(lit.grid, lit.coordinates)
        irradiance = lit.flux / np.maximum(lit.solid.samples.areas, np.finfo(np.float32).tiny)[:, None]
        exitance = gather(weights, first.volume) + first.pixel_tables().local.factors[0] * irradiance
        again, flux = reentering(lit, lit.exchange, exitance, stages)
        of_second = stages.run(Stage.SECOND_PASS, (self,), Stages)
        second = self._scattered(replace(lit, flux=lit.flux + flux), of_second)
        return replace(second, reentering=again)

    def _scattered(self, lit: EnteringFlux, stages: Stages) -> "NodeExitance":
        nodes = self.node_exitance(lit.grid, lit.coordinates, lit.flux, lit.profiles, lit.solid.area, stages)
        return NodeExitance(self, lit.grid, lit.profiles, nodes)

    @one_blas_thread()
    def node_exitance(
        self, grid: LayerGrid, coordinates: Float32, flux: Float32, profiles: Profiles, area: float, stages: Stages
    ) -> Float32:
        """Return O, the part of exitance that the nodes carry, (3, n_layers, height, width) float32.

        Parameters
        ----------
        grid : from `grid`
        coordinates : (n, 3) float32
            Grid coordinates of the surface samples.
        flux : (n, 3) float32
            E dA, the power that each sample carries.
        profiles : R, G and B
        area : float
            Of the surface, mm^2.
        stages : Stages
        """
        convolvers = [self.kernels.convolver(self.shape(grid, profile, area), i) for i, profile in enumerate(profiles)]
        weights = stages.run(Stage.WEIGHTS, (grid, coordinates), lambda: self.weights(grid, coordinates))
        layers = stages.run(Stage.DEPOSIT, (weights, flux), lambda: deposit(grid, weights, flux))
        kernels = tuple(
            None if p.is_black else (p, c.shape, grid.texel, grid.layer_distance)
            for p, c in zip(profiles, convolvers, strict=True)
        )

        def make(profile: Profile, shape: ConvolutionShape) -> Float32:
            return self.spectrum(profile, grid, shape)

        spectra = stages.run(Stage.SPECTRA, kernels, lambda: self.kernels.spectra(kernels, make))
        before = stages.kept(Stage.CONVOLUTION)

        def convolve() -> Float32:
            lit = [i for i, spectrum in enumerate(spectra) if spectrum is not None and layers[i].any()]
            twins = {i: _twin(i, lit, layers, spectra) for i in lit}
            reusable = {i: _known(i, layers, spectra, before) for i in lit if twins[i] == i}

            def convolved(i: int) -> Float32:
                spectrum, result = spectra[i], reusable[i]
                assert spectrum is not None
                return convolvers[i].convolve(layers[i], spectrum) if result is None else result

            # Layers that mix pair by pair have all threads in one convolution; others are convolved side by side.
            shared = convolvers[0].shape.mixes_pairs
            results = map(convolved, reusable) if shared else pool_map(convolved, reusable)
            found = dict(zip(reusable, results, strict=True))
            dark = np.zeros_like(layers[0])
            return np.stack([found[twins[i]] if i in twins else dark for i in range(len(layers))])

        return stages.run(Stage.CONVOLUTION, (layers, spectra), convolve)

    def material(self, lit: EnteringFlux) -> tuple[object, ...]:
        """Return the profiles of R, G and B, on which this transport depends."""
        return tuple(lit.profiles)

    def tables_of(self, lit: EnteringFlux, atlas: Atlas, parts: Sequence[Scattered | None]) -> PixelTables:
        """Return the table of the local term, which is the same for all bodies."""
        return PixelTables(self.local(atlas.grid, lit.profiles))

    def in_body(self, object_mesh: Mesh, crop: Callable[[LayerGrid], LayerGrid]) -> "FftTransport":
        """Return itself: it keeps nothing of a body, and its grid is handed to it."""
        return self

    def start_cold(self) -> None:
        """Forget spectra that are out of use alone: no convolution starts from the last."""
        self.kernels.keep_used()

    def release(self) -> None:
        """Release the kernels of all convolutions."""
        self.kernels.release()

    @property
    @abstractmethod
    def smooth(self) -> bool:
        """Whether W are quadratic B-splines rather than tents."""

    @abstractmethod
    def grid(self, mesh: Mesh, rotation: npt.NDArray[np.float64]) -> LayerGrid:
        """Return the layers that hold a mesh; see `core.transport.base.Transport.grid`."""

    @abstractmethod
    def weights(self, grid: LayerGrid, coordinates: npt.NDArray[np.floating]) -> csc_array:
        """Return the weights W of points on the nodes; see `core.transport.base.Transport.weights`."""

    @abstractmethod
    def local(self, grid: LayerGrid, profiles: Profiles) -> LocalTerm:
        """Return the local term, the part of exitance that the layers are too coarse for."""

    @abstractmethod
    def shape(self, grid: LayerGrid, profile: Profile, area: float) -> ConvolutionShape:
        """Return the sizes of a channel's transforms, on an object of `area` mm^2."""

    @abstractmethod
    def spectrum(self, profile: Profile, grid: LayerGrid, shape: ConvolutionShape) -> Float32:
        """Return the spectrum of a channel's kernel between the nodes."""


@dataclass(frozen=True, eq=False)
class NodeExitance:
    """A `core.transport.base.Scattered` whose volume is exitance itself.

    Attributes
    ----------
    transport : FftTransport
        That has made it.
    grid : LayerGrid
    profiles : R, G and B
    volume : (3, n_layers, height, width) float32
    reentering : (m, 3) float32, optional
        Irradiance that enters again, at the vertices of the exchange.
    """

    transport: FftTransport
    grid: LayerGrid
    profiles: Profiles
    volume: Float32
    reentering: Float32 | None = None

    windows = resolved = None
    residuals = 0.0, 0.0, 0.0
    convolutions = 0, 0, 0
    is_solved, estimates_unscattered = True, False
    boundaries = ()

    @property
    def world_to_texture(self) -> Array:
        """Return the matrix (4, 4) from world space to the volume's texture coordinates, row vectors."""
        return self.grid.world_to_texture

    def pixel_tables(self) -> PixelTables:
        """Return the table of the local term over thickness."""
        return PixelTables(self.transport.local(self.grid, self.profiles))

    def mean_fluence(self) -> Float32:
        """Return zeros: pixels solve no equation."""
        return np.zeros_like(self.volume)

    def exitance(self, points: Array, normals: Array, lights: SurfaceLights, tables: PixelTables) -> Array:
        """Return M at points of the surface, (n, 3); see `core.transport.base.Scattered.exitance`."""
        term = tables.local
        weights = self.transport.weights(self.grid, self.grid.coordinates(points))
        found = gather(weights, self.volume).astype(np.float64)
        at_points = lights.at(points, normals, term.reach, thin=False)
        found += term.factors[0] * np.sum([light.irradiance for light in at_points], axis=0)
        if term.reach > 0.0:
            for light in at_points:
                found += term.at(light.thickness) * light.behind
        return np.maximum(found, 0.0)

    def on_layers(self) -> Float32:
        """Return the exitance on the layers, (3, *grid.shape): the volume itself."""
        return self.volume


def _twin(i: int, lit: Sequence[int], layers: Float32, spectra: Sequence[Spectra | None]) -> int:
    """Return the first of the lit channels that is convolved alike; it may be the channel itself."""
    return next(k for k in lit if spectra[k] is spectra[i] and np.array_equal(layers[k], layers[i]))


def _known(
    i: int, layers: Float32, spectra: Sequence[Spectra | None], before: tuple[tuple[Any, ...], Float32] | None
) -> Float32 | None:
    """Return a channel's convolution if it was done before; None if it is new."""
    if before is not None:
        (old_layers, old_spectra), old = before
        if old_layers is layers and old_spectra[i] is spectra[i]:
            return np.asarray(old[i])
    return None
