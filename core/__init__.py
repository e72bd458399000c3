"""Numerics of milkglass: arrays in, arrays out.

The pipeline by rooms, from a model to exitance; `core/README.md` has its equations and shapes::

    geometry      a triangle mesh in world space, its normals, bodies and surface samples with areas dA
    material      coefficients, Fresnel terms and constants of diffusion; profiles: R_d of each channel
    light         irradiance of a light probe, its strong sources, and the visibility of the rest
    grid          flux deposited on layers of nodes, (3) (4); kernels between layers, (5); convolution by FFT, (6)
    paths         rays through the object, mirrored and refracted at its surface
    transport     exitance by `layered`, `ewald` or `diffusion`, of all bodies together or of each
    photograph    or, instead of a model, height, surface and surround of a photographed object
    reference     the judges: equation (1) summed in float64, visibility by rays, photons
    display       the tone map; stages: what to compute again; threads: the pool of worker threads

Numbers in brackets are the equations of Echevarria et al., "Screen-space subsurface scattering rendering", CEIG 2010.
core does NOT draw, open windows or files other than its own tables, print, or know OpenGL.
"""
