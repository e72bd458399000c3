"""Scattering numerics of milkglass: arrays in, arrays out.

The pipeline, one module a stage::

    mesh          arrays of a triangle mesh in world space, its normals and its flaws
    samples       points on the whole surface, each with normal and area dA
    environment   diffuse irradiance of a light probe, Fresnel transmittance included
    layers        flux of the samples spread over n_l parallel layers, (3) (4)
    spectra       kernels between layers and their spectra, (5)
    convolution   every pair of layers convolved by FFT, (6)
    transport     layers + spectra + convolution behind one interface: the layer volume
    tonemap       float64 reference of the display transform
    reference     equation (1) summed directly in float64, ray-cast visibility

beside ``materials`` (coefficients), ``dipole`` (R_d) and ``fresnel``. Numbers in brackets are the
equations of Echevarria et al., "Screen-space subsurface scattering rendering", CEIG 2010.

core does NOT draw, open windows or files other than its own tables, print, or know OpenGL.
"""
