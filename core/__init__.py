"""Scattering numerics of milkglass: arrays in, arrays out.

The pipeline, one module a stage::

    mesh          arrays of a triangle mesh in world space and its flaws; normals beside it
    samples       points on the whole surface, each with normal and area dA
    environment   diffuse irradiance of a light probe, Fresnel transmittance included; probe_sources: its strong small
                  sources, taken out as lamps; probe_highlights: the rest under Phong's lobe; probe_presets: built in
    visibility    what every vertex sees of it; visibility_bake: by rays; refine: more vertices
    layers        flux of the samples spread over parallel layers, (3) (4)
    spectra       kernels between layers and their spectra, (5); ewald: the kernels of the split
    convolution   every pair of layers convolved by FFT, (6)
    transport     layers + spectra + convolution behind one interface: exitance at the nodes, a local term;
                  transport_steps: the steps that both methods share, each channel only when it changed;
                  kernels: what is kept of them
    medium        or, instead of profiles, diffusion in the object itself: its constants; green: its kernel split
    patches       samples merged into unknowns; boundary: the boundary integral equation's surface on the layers
    entry         light refracted into the patches and scattered first; refracted: along one ray
    edges         faces that meet, by curvature and pairs; crossing: light over convex ones, in a wedge; last_flight:
                  beside concave ones
    diffusion     the equation solved, on half the nodes first; diffusion_channel: one channel's operator,
                  diffusion_steps and krylov: GMRES, diffusion_solution: what comes of it;
                  diffusion_pixels: what a pixel needs of it, diffusion_points: the same at any point, on the CPU
    bodies        the solids of a mesh; atlas: the layers of each; separate and separate_diffusion: transport in each
                  alone
    tonemap       float64 reference of the display transform
    photo_depth   or, instead of a model, a photograph: height of its object; photo_surface: a mesh of that;
                  photo_surround and photo_light: a probe of the background, as the object's shading says

Beside it ``materials`` (coefficients), ``profiles`` (R_d: ``dipole``, ``better_dipole``, ``photon_beam``, ``burley``,
``gaussians``, ``profile_table``; ``radial_table`` where nothing is closed; ``profile_curves`` to look at),
``fresnel``, ``stages`` (run only what changed), ``sculpture`` and ``implicit`` (the built-in object), ``boxes`` and
``rays`` (for bodies), ``probe_maps``, ``probe_blur`` and ``spherical_harmonics`` (light probes); and to judge it all,
``reference`` (equation (1) summed directly in float64, visibility by rays), ``reference_sources`` (where its sources
lie), ``reference_environment`` (an environment that the object is in the way of, by rays), ``hierarchical`` (the sum
with an octree) and ``accuracy`` (the error to expect). ``photon_walk`` is the truth of
transport that equation (1) itself is judged by: Monte Carlo, in the ``photon_shapes`` slab, sphere and closed mesh, and
in a ``half_space``, where profiles are judged. Numbers in brackets are the equations of Echevarria et al.,
"Screen-space subsurface scattering rendering", CEIG 2010.

core does NOT draw, open windows or files other than its own tables, print, or know OpenGL.
"""
