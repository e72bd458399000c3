"""Light probes: irradiance and highlights through spherical harmonics, strong sources, visibility."""
