"""Media: coefficients, mixtures, Fresnel and refraction, constants of diffusion, single scattering."""
