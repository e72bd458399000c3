"""Mixtures of materials by volume, and their dilution in water, by independent scattering.

Every particle and molecule scatters and absorbs as before; there are only fewer of them in each mm^3 (Narasimhan et al.
2006, whose measurements rest on it). Coefficients are then weighted by volume,

    sigma(m) = sum f_i sigma_i,   sum f_i = 1,   for sigma_s' and sigma_a alike,

and so is the index of refraction, n = sum f_i n_i (Gladstone and Dale 1863), which holds for liquids that keep their
volumes and is a guess for others. The mean cosine g is weighted by what scatters, sigma_s' / (1 - g). Where particles
touch (paste, cream, far more than is dissolved) none of this is true.
"""

from dataclasses import replace

from milkglass.core.material.library import MAX_ETA, MIN_ETA, Material

# Absorption at 610, 550 and 460 nm (Pope and Fry, Applied Optics 36(33), 1997); it scatters 1e-6 / mm, which is left
# out. The published coefficients of diluted liquids hold none of it: milk's red is a hundredth of water's own.
WATER = Material("Water", (0.0, 0.0, 0.0), (2.644e-4, 5.65e-5, 9.79e-6), 1.333, "Pope and Fry 1997")
LEAST_WATER = -1e5  # lower bound of `water`, beyond any measured dilution


def mix(first: Material, second: Material, share: float) -> Material:
    """Return the mixture of two materials, `share` in [0, 1] of the volume being the other."""
    name = f"{first.name} with {100.0 * share:.4g} % {second.name}"
    return _weighted(name, (first, 1.0 - share), (second, share), first.eta + share * (second.eta - first.eta))


def dilute(material: Material, water: float) -> Material:
    """Return a material of whose volume a share is water.

    Parameters
    ----------
    material : Material
    water : float
        In [0, 1]; 1 is water alone. Below 0 water is taken out, and 1 - water times as much of the material is in each
        mm^3: -1 twice as much. Its absorption is not subtracted then, and the index stays, for neither is in
        published coefficients of diluted liquids.

    Raises
    ------
    InputError
        Where concentration takes a coefficient beyond `core.material.library.MAX_COEFFICIENT`.
    """
    if water >= 0.0:
        mixed = mix(material, WATER, water)
        return replace(mixed, name=f"{material.name}, {100.0 * water:.6g} % water")
    strength = 1.0 - water
    return _weighted(
        f"{material.name}, {strength:.6g} times as strong", (material, strength), (WATER, 0.0), material.eta
    )


def _weighted(name: str, first: tuple[Material, float], second: tuple[Material, float], eta: float) -> Material:
    def summed(key: str) -> tuple[float, float, float]:
        pairs = zip(getattr(first[0], key), getattr(second[0], key), strict=True)
        red, green, blue = (first[1] * a + second[1] * b for a, b in pairs)
        return red, green, blue

    def cosine(channel: int) -> float:
        parts = [(share * m.sigma_s_prime[channel], m.g[channel]) for m, share in (first, second)]
        whole = sum(reduced / (1.0 - g) for reduced, g in parts)
        if whole == 0.0:
            return first[0].g[channel]
        least, *_, most = sorted(g for reduced, g in parts if reduced > 0.0) * 2  # rounding
        return min(most, max(least, sum(reduced / (1.0 - g) * g for reduced, g in parts) / whole))

    eta = min(MAX_ETA, max(MIN_ETA, eta))  # rounding
    red, green, blue = (cosine(channel) for channel in range(3))
    return Material(name, summed("sigma_s_prime"), summed("sigma_a"), eta, "mixture", (red, green, blue))
