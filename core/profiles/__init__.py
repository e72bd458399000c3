"""Diffusion profiles R_d(r) that equation (1) sums: an interface (`base`), one file each, and a `registry` of names."""
