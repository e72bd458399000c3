"""Triangle meshes: normals, surface samples, refinement, connected bodies, rays, and the built-in sculpture."""
