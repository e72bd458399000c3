"""`milkglass fit`: coefficients of a material by pictures, a scene of it, and a report beside that."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from milkglass.core.errors import InputError
from milkglass.viewer.commands import terminal
from milkglass.viewer.commands.options import load_scene
from milkglass.viewer.commands.report import check_stay
from milkglass.viewer.scene import own_materials
from milkglass.viewer.scene.keys import input_files
from milkglass.viewer.scene.whole_file import replacement

if TYPE_CHECKING:
    from milkglass.viewer.fit.fitting import Fit


def run(
    pictures: Sequence[str], scenes: Sequence[str], output: str, masks: Sequence[str], exposure: str, name: str | None
) -> None:
    """Fit a material, write the scene of it, and a report beside it, `.json` and `.png`."""
    from rich.console import Console

    from milkglass.viewer.files.images import check_output, write_png
    from milkglass.viewer.fit.fitting import EXPOSURES, fit
    from milkglass.viewer.fit.pictures import read_picture

    if exposure not in EXPOSURES:
        raise InputError(f"--exposure {exposure}: it must be one of {', '.join(EXPOSURES)}")
    if len(masks) not in (0, len(pictures)):
        raise InputError(f"there are {len(masks)} masks and {len(pictures)} pictures; give one for each, or none")
    check_output(output, (".toml",))
    written = [Path(output).with_suffix(suffix) for suffix in (".toml", ".json", ".png")]
    loaded = [load_scene(path) for path in scenes]
    inputs: list[tuple[str, str | Path]] = [
        (f"{role} {path}", path)
        for role, paths in (("scene", scenes), ("picture", pictures), ("mask", masks))
        for path in paths
    ]
    inputs += [(f"the {role}", path) for scene in loaded for role, path in input_files(scene).items()]
    check_stay(inputs, f"--output {output}", written)
    if name is not None:
        own_materials.checked_name(name)
    of_pictures: Sequence[str | None] = masks or [None] * len(pictures)
    read = [read_picture(path, mask) for path, mask in zip(pictures, of_pictures, strict=True)]
    with terminal.progress_bar(Console(stderr=True)) as tell:
        found = fit(loaded, read, exposure=exposure, progress=tell)
    if name is not None:
        own_materials.save(name, found.material)
    with replacement(written[1]) as temporary:
        temporary.write_text(json.dumps(found.content(), indent=2) + "\n", encoding="utf-8")
    write_png(written[2], found.sheet())
    found.scene.save(written[0])
    typer.echo(said_of(found))
    typer.echo(f"The scene is in {written[0]}; {written[1].name} and {written[2].name} beside it say more.")


def said_of(found: "Fit") -> str:
    """Return the coefficients with their standard errors, and what is not told, in lines."""
    lines = []
    for key in ("sigma_s_prime", "sigma_a"):
        values, errors = getattr(found.material, key), found.relative_errors[key]
        shown = (f"{value:.4g} (± {_percent(error)})" for value, error in zip(values, errors, strict=True))
        lines.append(f"{key} = {', '.join(shown)} 1/mm")
    factors = ", ".join(f"{factor:.4g}" for factor in found.brightness)
    lines.append(
        f"brightness of the lights: {factors} times the scene's; the residual is {found.misfit:.2f} times noise"
    )
    return "\n".join([*lines, *(f"note: {note}." for note in found.notes)])


def _percent(error: float) -> str:
    return f"{100.0 * error:.2g} %" if error < 1.0 else "more than 100 %"
