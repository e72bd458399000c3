"""Writes a material's profile as a table that `material.profile_table` reads."""

from collections.abc import Callable
from pathlib import Path

from milkglass.core.errors import InputError
from milkglass.core.profiles.curves import table_text
from milkglass.core.profiles.table import parse_table
from milkglass.viewer.scene.material_settings import MaterialSettings
from milkglass.viewer.scene.tables import ProfileTable
from milkglass.viewer.scene.whole_file import replacement


def write_profile(path: Path, material: MaterialSettings, read: Callable[[Path], ProfileTable]) -> str:
    """Write a CSV file of radius_mm, R, G, B, whole or not at all; `read` as of `MaterialSettings.profiles`.

    Returns
    -------
    str
        What keeps the file from serving as a profile, starting with a semicolon; else empty.

    Raises
    ------
    InputError
        If the material's own table cannot be read, or the file cannot be written.
    """
    text = table_text(material.profiles(read), f"{material.profile} of {material.resolve().name}")
    try:
        with replacement(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror or error})") from error
    try:
        parse_table(text, path.name)
    except InputError as error:  # a profile that returns more than it gets, which a table may not
        return f"; it cannot serve as a profile: {error}"
    return ""
