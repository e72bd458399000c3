"""The diffusion profiles by name, one file each: what only reads names loads none of their numerics.

A new profile is a file here with its `FAMILY`, and its name in `PROFILES`.
"""

from importlib import import_module

from milkglass.core.profiles.base import Family

DIPOLE, BEAM, TABLE = "dipole", "photon_beam", "table"

# The modules, each of which has a `FAMILY`, in the order of lists of choices.
PROFILES: dict[str, str] = {
    name: f"{__package__}.{name}" for name in (DIPOLE, "better_dipole", BEAM, "burley", "gaussians", TABLE)
}


def family(name: str) -> Family:
    """Return the profiles of one of the names of `PROFILES`; loads their numerics."""
    found: Family = import_module(PROFILES[name]).FAMILY
    return found
