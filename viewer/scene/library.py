"""The library as one looks through it: measured materials and one's own, by name and by where diffusion holds."""

import functools
from collections.abc import Callable, Iterator, Mapping

from milkglass.core.errors import InputError
from milkglass.core.material import library as measured
from milkglass.core.material.library import Material
from milkglass.viewer.scene import own_materials
from milkglass.viewer.scene.declaration import nearest

# Name on the command line -> what the panel says, and which materials it keeps.
FILTERS: dict[str, tuple[str, Callable[[Material], bool]]] = {
    "all": ("all", lambda _: True),
    "valid": ("diffusion holds", measured.diffusion_holds),
    "thin": ("optically thin", measured.is_thin),
    "JMLH01": ("Jensen et al. 2001", lambda material: material.source == "JMLH01"),
    "NGD06": ("Narasimhan et al. 2006", lambda material: material.source == "NGD06"),
    "milkglass": ("chosen by us", lambda material: material.source == "milkglass"),
    "own": ("your own", lambda material: material.source == own_materials.SOURCE),
}


class Library(Mapping[str, Material]):
    """Measured materials and one's own, last, by name, however spaced and capitalised.

    >>> materials["skim milk"].eta
    1.3
    """

    def __getitem__(self, name: str) -> Material:
        """Return a material; the message of a KeyError names the nearest ones."""
        try:
            return own_materials.lookup(name)
        except InputError as error:
            raise KeyError(str(error)) from None

    def __iter__(self) -> Iterator[str]:
        return iter([material.name for material in found()])

    def __len__(self) -> int:
        return len(found())


def found(category: str = "all", search: str = "", stored: own_materials.Materials | None = None) -> list[Material]:
    """Return the materials that a filter keeps and a search finds; `stored` replaces the own ones of the file, last.

    Raises
    ------
    InputError
        If there is no such filter, or the file of one's own materials is broken.
    """
    if category not in FILTERS:
        raise InputError(f"unknown filter {category!r}; {nearest(category, FILTERS)}")
    listed = _kept(category, own_materials.stored() if stored is None else stored)
    return [material for material in listed if matches(material, search)]


@functools.lru_cache(maxsize=16)
def _kept(category: str, stored: own_materials.Materials) -> own_materials.Materials:
    _, keeps = FILTERS[category]
    return tuple(material for material in (*measured.library(), *stored) if keeps(material))


def matches(material: Material, search: str) -> bool:
    """Whether a material's name has all words of a search, however capitalised and spaced."""
    name = material.name.casefold()
    joined = "".join(character for character in name if character.isalnum())
    return all(word in name or word in joined for word in search.casefold().split())


materials = Library()
