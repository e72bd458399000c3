"""The diffusion equation solved in the object itself, as a boundary integral equation on the layers."""
