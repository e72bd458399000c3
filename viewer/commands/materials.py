"""`milkglass materials`: a table that fits a terminal, or one full line a material in a pipe."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from milkglass.core.arrays import Array
from milkglass.core.display import srgb
from milkglass.core.errors import InputError
from milkglass.core.material import library as materials, single_scattering
from milkglass.core.material.library import Material
from milkglass.core.profiles import dipole
from milkglass.viewer.scene import library, own_materials

# In a pipe no line is broken or cut, whatever width a terminal is assumed to have.
UNLIMITED_WIDTH = 10_000
MIN_WIDTH = 80


def run(name: str | None, kind: str, source: str | None, target: str | None) -> None:
    """Print a table, or exchange the user's materials with files and print a summary."""
    if source is None and target is None:
        show(name, kind)
    else:
        Console().out(exchange(source, target), highlight=False)


def show(name: str | None, kind: str = "all") -> None:
    """Print one material by channel, or the materials of the library that pass a filter of `viewer.scene.library`."""
    if name is not None and kind != "all":
        raise InputError(f"--only {kind} chooses from the whole library; leave out {name!r}")
    console = Console()
    console = Console(width=max(console.width, MIN_WIDTH) if console.is_terminal else UNLIMITED_WIDTH)
    if name is not None:
        table: RenderableType = material_table(own_materials.lookup(name))
    elif listed := library.found(kind):
        table = library_table(console.width, listed)
    else:
        table = Text("none yet: the window keeps a material under a name, and --import takes those of a file")
    with console.capture() as captured:
        console.print(table)
    # Rich pads every line to the widest one.
    console.out("\n".join(line.rstrip() for line in captured.get().splitlines()), highlight=False)


def exchange(source: str | None, target: str | None) -> str:
    """Import materials of the user from a file, export them to another, and return a summary."""
    sentences = []
    if source is not None:
        imported = own_materials.import_from(Path(source))
        sentences.append(f"{len(imported)} materials from {source} are now in {own_materials.file()}")
    if target is not None:
        exported = own_materials.export_to(Path(target))
        sentences.append(f"{len(exported)} materials of your own went to {target}")
    return "; ".join(sentences)


def library_table(width: int, listed: Sequence[Material]) -> Table:
    """Return a table of one row a material: coefficients in 1/mm, lengths in mm, each for r, g and b.

    Where `width` characters are too few, r, g and b are on separate lines, without source, eta and 1/sigma_tr.
    """
    table = _library_table(listed, stacked=False)
    fits = Console(width=UNLIMITED_WIDTH).measure(table).minimum <= width
    return table if fits else _library_table(listed, stacked=True)


def material_table(material: Material) -> RenderableType:
    """Return a table of one row a quantity and one column a channel, above the quantities of all channels."""
    channels = Table(box=None, pad_edge=False, header_style="bold")
    for heading in (material.name, *materials.CHANNELS, "unit"):
        channels.add_column(heading)
    reflectance = dipole.diffuse_reflectance(material)
    rows: list[tuple[str, Iterable[float], str]] = [
        ("reduced scattering sigma_s'", material.sigma_s_prime, "1/mm"),
        ("absorption sigma_a", material.sigma_a, "1/mm"),
        ("mean cosine of scattering g", material.g, ""),
        ("mean free path 1/sigma_t'", material.mean_free_path, "mm"),
        ("transport length 1/sigma_tr", _transport_length(material), "mm"),
        ("reduced albedo alpha'", material.alpha_prime, ""),
        ("diffuse reflectance R_d", reflectance, ""),
    ]
    for quantity, values, unit in rows:
        channels.add_row(quantity, *(f"{value:.5g}" for value in values), unit)
    common = Table.grid(padding=(0, 2))
    common.add_row("index of refraction eta", f"{material.eta:g}")
    common.add_row("colour under white light", _swatch(reflectance))
    common.add_row("source", material.source)
    common.add_row("validity of profiles", _validity(material))
    common.add_row("single scattering", single_scattering.statement(material))
    return Group(channels, common)


def _library_table(listed: Sequence[Material], *, stacked: bool) -> Table:
    path = "mfp" if stacked else "mean free path"
    headings = ["name", "source", "eta", "sigma_s'", "sigma_a", path, "1/sigma_tr", "R_d", "colour"]
    rows = [_row(material, "\n" if stacked else " ") for material in listed]
    if stacked:
        del headings[6], headings[1:3]
        for row in rows:
            del row[6], row[1:3]
    table = Table(box=None, pad_edge=False, header_style="bold")
    for i, heading in enumerate(headings):
        # Names may be broken between words, numbers may not.
        widest = max((len(line) for row in rows for line in str(row[i]).splitlines()), default=0)
        longest_word = max((len(word) for row in rows for word in str(row[i]).split()), default=0)
        table.add_column(heading, min_width=max(len(heading), longest_word if stacked and i == 0 else widest))
    table.add_column("validity of profiles")
    for row in rows:
        table.add_row(*row)
    return table


def _row(material: Material, separator: str) -> list[str | Text]:
    reflectance = dipole.diffuse_reflectance(material)
    vectors: list[Iterable[float]] = [
        material.sigma_s_prime,
        material.sigma_a,
        material.mean_free_path,
        _transport_length(material),
        reflectance,
    ]
    return [
        material.name,
        material.source,
        f"{material.eta:g}",
        *(separator.join(f"{value:.3g}" for value in vector) for vector in vectors),
        _swatch(reflectance),
        _validity(material),
    ]


def _transport_length(material: Material) -> Array:
    infinite: Array = np.full(3, math.inf)
    return np.divide(np.ones(3), material.sigma_tr, out=infinite, where=material.sigma_tr > 0.0)


def _validity(material: Material) -> str:
    return "; ".join(materials.validity_notes(material)) or "ok"


def _swatch(reflectance: Array) -> Text:
    """Return the colour under white light as #rrggbb, on a background of it where the terminal has colours."""
    encoded = srgb(np.clip(reflectance, 0.0, 1.0))
    r, g, b = (round(float(255.0 * channel)) for channel in encoded)
    code = f"#{r:02x}{g:02x}{b:02x}"
    return Text(code, style=f"{'black' if encoded.mean() > 0.5 else 'white'} on {code}")
