"""Diffusion coefficient and boundary condition of a material, one colour channel at a time.

The diffusion coefficient is the one with which fluence falls as it does in transport, deep inside and whatever the
albedo. Grosjean's (2 s_a + s_s') / (3 s_t'^2) is its first order, within 1.2 % at an albedo of 0.9, which is yet 6 % of
the light behind a sphere of 16 mean free paths. The boundary condition is phi + 2 A D dphi/dn = 0, with the exact
Fresnel reflectance from inside; with it, what leaves is M = phi / (2 A).

That is for a flat surface. On a curved one the light that comes up to it at a slant has come from nearer to the surface
where it is convex, from deeper below where it is concave. To second order along its way, with l the mean free path,

    4 pi I = phi - l mu dphi/dn + l^2 (1 - 3 mu^2) / 2 (2 H) dphi/dn,

2 H the sum of the principal curvatures, above 0 where the surface is convex; the last term has no flux of its own, and
with it the condition that what goes down is F_r of what comes up, as a mean over mu as for A, gives

    z_b = 2 A D - gamma l (2 H l),    gamma = (1 + 2 R1 - 3 R3) / (4 (1 - R1)),    R3 = 4 int_0^1 F_r(mu) mu^3 dmu.

Photons from deep inside a shell or a ball tell z_b by where they leave: without a boundary it is 0.779 mean free paths
around a cavity of radius 7, 0.577 in a ball of radius 4 and 0.710 on a plane, and gamma = 1/4 makes 0.071 and -0.125 of
that. It holds where the surface is concave, as inside a bowl. On smooth convex ones lit from outside it is too much, as
light that has just entered is held back there by total reflection, and the share that is left was fitted to balls. At
an edge it is let out by the other face (`core.transport.diffusion.edges.crossing`), and curvature counts up to where
second order ends, which was fitted to boxes, cylinders and cones (`BoundaryConditionConstants`).
"""

import functools
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from milkglass.core.arrays import Array
from milkglass.core.material import fresnel
from milkglass.core.material.library import Material
from milkglass.core.provenance import chosen, fitted

SMALLEST_ALBEDO = 0.06  # below it k of `asymptotic_diffusion` is 1 to the last bit
LONGEST_PATH = 1e9  # mean free path, mm; more changes nothing


@dataclass(frozen=True)
class BoundaryConditionConstants:
    """What the boundary condition has beyond its derivation."""

    anisotropy: float = fitted(
        0.5,
        "growth of A over sqrt(1 - a'), where light near the surface is not isotropic",
        "ball",
        "plate",
    )
    anisotropy_within: float = fitted(
        0.4, "growth of A over sqrt(1 - a') where light that has scattered once is apart", "ball"
    )
    convex_share: float = fitted(0.6, "share of curvature's effect on a convex surface that is nearly flat", "ball")
    sharpest_edge: float = fitted(
        0.8, "curvature of an edge times mean free path at which second order ends", "cube", "cylinder", "cone"
    )
    deepest_cavity: float = chosen(2.0, "concave curvature times mean free path, beyond which no more counts", "bowl")


BOUNDARY_CONDITION = BoundaryConditionConstants()


@dataclass(frozen=True)
class Medium:
    """Coefficients of one colour channel of a material.

    Attributes
    ----------
    sigma_s_prime, sigma_a : float
        Reduced scattering and absorption, 1/mm, >= 0.
    eta : float
        Relative index of refraction, >= 1.
    anisotropy : float
        Growth of A over sqrt(1 - a').
    g : float
        Mean cosine of scattering, [0, 1). Diffusion knows sigma_s' alone; `delta_eddington` takes it apart.
    """

    sigma_s_prime: float
    sigma_a: float
    eta: float
    anisotropy: float = BOUNDARY_CONDITION.anisotropy
    g: float = 0.0

    @property
    def is_black(self) -> bool:
        """Whether the medium does not scatter, sigma_s' = 0."""
        return self.sigma_s_prime == 0.0

    @property
    def sigma_t_prime(self) -> float:
        """Reduced extinction s_t' = s_s' + s_a, 1/mm."""
        return self.sigma_s_prime + self.sigma_a

    @property
    def albedo(self) -> float:
        """Reduced albedo a' = s_s' / s_t', in [0, 1]; 0 without matter."""
        return self.sigma_s_prime / self.sigma_t_prime if self.sigma_t_prime > 0.0 else 0.0

    @property
    def mean_free_path(self) -> float:
        """Mean free path l = 1 / s_t', mm; inf without matter."""
        return 1.0 / self.sigma_t_prime if self.sigma_t_prime > 0.0 else float("inf")

    @property
    def black(self) -> "Medium":
        """The medium that absorbs all that this one scatters."""
        return replace(self, sigma_s_prime=0.0, sigma_a=self.sigma_t_prime)

    @property
    def diffusion(self) -> float:
        """Diffusion coefficient D = s_a / sigma^2, mm: the asymptotic one of transport; inf without matter."""
        if self.sigma_t_prime == 0.0:
            return float("inf")
        return asymptotic_diffusion(self.sigma_a / self.sigma_t_prime) / self.sigma_t_prime

    @property
    def attenuation(self) -> float:
        """Effective attenuation sigma = sqrt(s_a / D), 1/mm: fluence falls by e over 1 / sigma; 0 without matter."""
        return float(np.sqrt(self.sigma_a / self.diffusion))

    @property
    def extrapolation_factor(self) -> float:
        """A >= 1 of a flat surface: the extrapolation length is z_b = 2 A D."""
        return extrapolation_factor(self.eta) * float(1.0 + self.anisotropy * np.sqrt(1.0 - self.albedo))

    def delta_eddington(self, share: float = 1.0) -> "DeltaEddington":
        """Return the medium without its forward peak, by a share in [0, 1]: at 0 scattering counts as isotropic."""
        g = share * self.g
        return DeltaEddington(self.sigma_s_prime * (1.0 + g), self.sigma_a, g / (1.0 + g))

    def bending(self, curvature: npt.ArrayLike, edges: npt.ArrayLike = 0.0) -> Array:
        """Return b > 0, the extrapolation length on a curved surface over that on a flat one.

        Parameters
        ----------
        curvature : (...) array
            2 H, 1/mm, above 0 where the surface is convex; without edges.
        edges : (...) array
            What convex edges add to it, >= 0.
        """
        mfp = min(self.mean_free_path, LONGEST_PATH)
        sharp = np.asarray(edges, np.float64) * mfp
        bent = np.clip(np.asarray(curvature, np.float64) * mfp, -BOUNDARY_CONDITION.deepest_cavity, LONGEST_PATH)
        bent = np.where(bent > 0.0, BOUNDARY_CONDITION.convex_share * bent / (1.0 + np.abs(bent)), bent)
        bent = bent + sharp / np.hypot(1.0, sharp / BOUNDARY_CONDITION.sharpest_edge)
        extrapolated = 2.0 * self.extrapolation_factor * self.diffusion / self.mean_free_path
        return np.asarray(1.0 - curvature_factor(self.eta) / extrapolated * bent)


@dataclass(frozen=True)
class DeltaEddington:
    """Coefficients of one colour channel in which light that scatters almost straight on counts as unscattered.

    Of Henyey and Greenstein's phase function the share f = g^2 becomes a peak of no width, and the rest
    (1 + 3 g'' cos) / (4 pi), with s_s'' = s_s (1 - g^2) = s_s' (1 + g) and g'' = g / (1 + g): its first three moments
    stay, and so does s_s' = s_s'' (1 - g'') (Joseph, Wiscombe and Weinman 1976).

    Attributes
    ----------
    sigma_s, sigma_a : float
        s_s'' and absorption, 1/mm, >= 0.
    cosine : float
        g'', [0, 1/2).
    """

    sigma_s: float
    sigma_a: float
    cosine: float

    @property
    def sigma_t(self) -> float:
        """Extinction s_t'' = s_s'' + s_a, 1/mm."""
        return self.sigma_s + self.sigma_a

    @property
    def albedo(self) -> float:
        """Share a'' = s_s'' / s_t'' of what collides that scatters, in [0, 1]; 0 without matter."""
        return self.sigma_s / self.sigma_t if self.sigma_t > 0.0 else 0.0

    @property
    def g(self) -> float:
        """Mean cosine of all scattering, the peak's included."""
        return self.cosine / (1.0 - self.cosine)

    @property
    def peak(self) -> float:
        """Scattering by the forward peak, s_f = s_s g^2 = s_s'' g^2 / (1 - g^2), 1/mm."""
        return self.sigma_s * self.g**2 / (1.0 - self.g**2)

    @property
    def turning(self) -> float:
        """What is left of the flux of light that collides, a'' g''."""
        return self.albedo * self.cosine

    @property
    def mean_free_path(self) -> float:
        """Mean free path 1 / s_t'', mm; inf without matter."""
        return 1.0 / self.sigma_t if self.sigma_t > 0.0 else float("inf")


NO_ABSORPTION = Medium(1.0, 0.0, 1.0)  # of a mean free path of 1 mm


def media(material: Material) -> tuple[Medium, Medium, Medium]:
    """Return the media of R, G and B."""
    channels = zip(material.sigma_s_prime, material.sigma_a, material.g, strict=True)
    red, green, blue = (Medium(scattering, absorption, material.eta, g=g) for scattering, absorption, g in channels)
    return red, green, blue


@functools.lru_cache(maxsize=1024)
def asymptotic_diffusion(absorbed: float) -> float:
    """Return D / l = (1 - a') / k^2 of the absorbed share 1 - a', k the root of a' = k / artanh k.

    Case and Zweifel 1967.
    """
    if absorbed < 1e-5:
        return 1.0 / 3.0 + 4.0 / 15.0 * absorbed
    if absorbed > 1.0 - SMALLEST_ALBEDO:
        return absorbed
    k = brentq(lambda k: k / np.arctanh(k) - (1.0 - absorbed), 1e-3, 1.0 - 1e-16)
    return absorbed / float(k) ** 2


def extrapolation_factor(eta: float) -> float:
    """Return A = (1 + R2) / (1 - R1) without absorption, R1 and R2 of `core.material.fresnel.internal_moments`."""
    r1, r2 = fresnel.internal_moments(eta)
    return (1.0 + r2) / (1.0 - r1)


def curvature_factor(eta: float) -> float:
    """Return gamma = (1 + 2 R1 - 3 R3) / (4 (1 - R1)) > 0, by which curvature changes the extrapolation length."""
    r1, r3 = fresnel.internal_moment(eta, 1), fresnel.internal_moment(eta, 3)
    return (1.0 + 2.0 * r1 - 3.0 * r3) / (4.0 * (1.0 - r1))
