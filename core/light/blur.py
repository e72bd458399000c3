"""Gaussian blur of a lat-long map over the sphere, for backgrounds."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from milkglass.core.arrays import Float32


def blurred(latlong: Float32, sigma_deg: float) -> Float32:
    """Return a lat-long map blurred by a Gaussian of `sigma_deg` degrees.

    Columns are blurred along their meridian, over the poles; rows along their parallel, over more columns nearer to a
    pole. Separable, hence exact only where the blur is small against the distance to the poles.

    Parameters
    ----------
    latlong : (h, w, 3) float32
        Radiance; row 0 at +y. w is even.
    sigma_deg : float
        Standard deviation, >= 0; 0 returns the map itself.
    """
    if sigma_deg <= 0.0:
        return latlong
    height, width, _ = latlong.shape
    # Beyond a pole the meridian continues half a turn away.
    turned = np.roll(latlong, width // 2, axis=1)[::-1]
    doubled = np.concatenate([latlong, turned], axis=0)
    columns = gaussian_filter1d(doubled, sigma_deg / 180.0 * height, axis=0, mode="wrap")[:height]
    theta = np.pi * (np.arange(height) + 0.5) / height
    sigma = np.radians(sigma_deg) / np.sin(theta)
    frequency = np.arange(width // 2 + 1)
    gain = np.exp(-0.5 * np.square(sigma[:, None] * frequency))  # the Gaussian's transform along a circle
    rows = np.fft.irfft(np.fft.rfft(columns, axis=1) * gain[..., None], n=width, axis=1)
    return np.maximum(rows, 0.0).astype(np.float32)
