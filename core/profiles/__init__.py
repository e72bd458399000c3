"""Diffusion profiles R_d(r) that equation (1) sums, one file each."""
