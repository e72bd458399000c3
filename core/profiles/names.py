"""Names of the diffusion profiles, apart from their numerics: what only reads settings need not load those."""

DIPOLE, BETTER, BEAM, BURLEY, GAUSSIANS, TABLE = (
    "dipole",
    "better_dipole",
    "photon_beam",
    "burley",
    "gaussians",
    "table",
)
PROFILES = (DIPOLE, BETTER, BEAM, BURLEY, GAUSSIANS, TABLE)
