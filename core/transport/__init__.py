"""Transport of light in the object: `layered`, `ewald` and `diffusion` behind one interface."""
