"""Registry of the transports: one row each, with what other rooms need to know of a method before it is made.

Reading this table imports no numerics: a row names the module of its method, which is imported when one is made.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Method:
    """Properties of a method of transport, on which its callers depend.

    Attributes
    ----------
    home : str
        Its module, with `choose_quality`, `make_transport` and `sample_spacing` as of `core.transport.quality`.
    below_grid : str
        What a picture misses where the mean free path is shorter than the grid's spacing, a clause.
    grid_unit, grid_points : str
        Name of a grid point, and of several with the layers where their spacing differs.
    layers_follow_view : bool
        Whether layers lie across the view, so that an orbiting camera moves them; else they are fixed to the object.
    uses_profile : bool
        Whether exitance is equation (1), a profile summed over the surface; else it follows from the medium alone.
    needs_roughness : bool
        Whether the error to expect, and with it the grid, follows from the roughness of the surface.
    knows_sheets : bool
        Whether pixels ask for the light that enters the other side of thin slabs.
    solves : bool
        Whether an equation is solved in steps, begun from the last solution, for the light that pixels have then too.
    normalises_flux : bool
        Whether the flux of radiance that leaves is M, L = F_t M / (pi T) with T the mean of F_t; else L = F_t M / pi,
        equation (7), whose flux is T M.
    highlight_model : str
        Model of highlights where a scene leaves it open: `normalized`, or the paper's, `phong`.
    takes_each_light : bool
        Whether light enters light by light, with its direction, and not as one sum of fluxes.
    separates_bodies : bool
        Whether bodies scatter light each alone if not asked to be joined.
    exchanges : bool
        Whether light that leaves the object meets it again and enters, if not asked otherwise.
    follows_sight : bool
        Whether rays of sight are followed, mirrored at the surface and refracted through the object (`core.paths`).
    on_open_surface : str, optional
        Method that takes the place of one that needs a closed surface; None where any surface will do.
    shapes_a_body : int
        Shapes of convolutions that a separate body may have for itself.
    draft_seconds : float
        Seconds that transport may take while something moves, before its grid gets coarser.
    """

    home: str
    below_grid: str
    grid_unit: str = "node"
    grid_points: str = "nodes"
    layers_follow_view: bool = False
    uses_profile: bool = True
    needs_roughness: bool = False
    knows_sheets: bool = True
    solves: bool = False
    normalises_flux: bool = False
    highlight_model: str = "normalized"
    takes_each_light: bool = False
    separates_bodies: bool = False
    exchanges: bool = False
    follows_sight: bool = False
    on_open_surface: str | None = None
    shapes_a_body: int = 3
    draft_seconds: float = 0.1


_AVERAGED = (
    "a point's own light stays sharp, but what reaches it from closer than that is averaged: fine relief looks flatter,"
    " and what light only shines through is off by several per cent"
)

METHODS = {
    "diffusion": Method(
        "milkglass.core.transport.diffusion.choice",
        _AVERAGED,
        uses_profile=False,
        solves=True,
        normalises_flux=True,
        takes_each_light=True,
        separates_bodies=True,
        exchanges=True,
        follows_sight=True,
        on_open_surface="ewald",
        shapes_a_body=8,  # R, G, B and no absorption, on two grids
        draft_seconds=1.0,  # another grid takes half a second by itself
    ),
    "ewald": Method("milkglass.core.transport.ewald", _AVERAGED, needs_roughness=True),
    "layered": Method(
        "milkglass.core.transport.layered",
        "light and shadow are blurred over that, and about a third of the light that falls between layers goes",
        grid_unit="texel",
        grid_points="texels or layers",
        layers_follow_view=True,
        highlight_model="phong",
        knows_sheets=False,
    ),
}
DEFAULT_METHOD = "diffusion"
