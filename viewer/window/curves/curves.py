"""Profiles sampled as curves, in a worker thread: tables of a photon beam take longer than a frame."""

from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.core.profiles.base import Profiles
from milkglass.core.profiles.curves import curve_radii, reach, sampled
from milkglass.viewer.live.worker import Worker
from milkglass.viewer.scene.material_settings import MaterialSettings
from milkglass.viewer.scene.tables import ProfileTable

CACHED_CURVES = 16  # curves: profiles between which a person goes back and forth
REST = 1e-2  # share of the flux beyond `Curves.reach`


@dataclass(frozen=True)
class Wish:
    """A request for the curves of a material; `table` is the state of a table's file."""

    material: MaterialSettings
    table: tuple[int, int] = (0, 0)


@dataclass(frozen=True, eq=False)
class Curves:
    """The sampled profiles of the channels of a material.

    Attributes
    ----------
    profiles : R, G and B; empty where there is a problem
    radii : (n,) mm
    values : (3, n) mm^-2, R_d at the radii
    totals : (3,) diffuse reflectance
    reach : mm, radius that 99 % of every channel's flux stays within
    detail : mm, the shortest length over which a channel bends
    problem : sentence on why there are none, else empty
    """

    profiles: Profiles
    radii: Array
    values: Array
    totals: Array
    reach: float
    detail: float
    problem: str = ""


def curves_of(material: MaterialSettings, read: Callable[[Path], ProfileTable]) -> Curves:
    """Return the sampled profiles of a material; `read` as of `MaterialSettings.profiles`."""
    try:
        profiles = material.profiles(read)
    except InputError as error:
        return Curves((), np.zeros(0), np.zeros((3, 0)), np.zeros(3), 0.0, 0.0, str(error))
    bright = [profile for profile in profiles if not profile.is_black]
    radii = curve_radii(profiles)
    totals = np.array([0.0 if profile.is_black else float(profile.total(0.0)) for profile in profiles])
    detail = min((profile.mean_free_path for profile in bright), default=0.0)
    return Curves(profiles, radii, sampled(profiles, radii), totals, reach(bright, REST), detail)


class CurvesJob:
    """Samples the newest curves requested in a worker; used by the thread that draws.

    Parameters
    ----------
    wake : callable
        Called from the worker when there is something to see.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self._wake = wake
        self._worker = Worker("profiles")
        self._future: Future[list[Curves]] | None = None
        self._cache: OrderedDict[Wish, Curves] = OrderedDict()
        self._asked: tuple[Wish, ...] = ()

    @property
    def busy(self) -> bool:
        """Whether curves are being sampled."""
        return self._future is not None

    def follow(self, wishes: tuple[Wish, ...], read: Callable[[Path], ProfileTable]) -> list[Curves | None]:
        """Return the curves of every request, None while they are being sampled."""
        if self._future is not None and self._future.done():
            curves, self._future = self._future.result(), None
            self._cache |= zip(self._asked, curves, strict=True)
            while len(self._cache) > CACHED_CURVES:
                self._cache.popitem(last=False)
        missing = tuple(wish for wish in dict.fromkeys(wishes) if wish not in self._cache)
        if missing and self._future is None:
            self._asked = missing
            self._future = self._worker.submit(lambda: [curves_of(wish.material, read) for wish in missing])
            self._future.add_done_callback(lambda _: self._wake())
        return [self._cache.get(wish) for wish in wishes]

    def wait(self, timeout: float) -> None:
        """Wait until the curves are sampled; for tests and replays."""
        if self._future is not None:
            self._future.exception(timeout)

    def stop(self) -> None:
        """Take nothing more, and wait for nothing."""
        self._worker.stop()

    def close(self) -> None:
        """Stop the worker."""
        self._worker.close()
