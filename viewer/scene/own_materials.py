"""A person's own materials: one TOML file in the user's data folder, a table each.

    ["candle"]
    sigma_s_prime = [0.6, 0.7, 0.9]   # 1/mm
    sigma_a = [0.001, 0.003, 0.012]   # 1/mm
    eta = 1.44
    g = [0.8, 0.8, 0.8]               # mean cosine of scattering; 0, isotropic, without it

A scene never refers to this file: where an own material is named, in a scene file, an option or the panel, its
coefficients are what the scene keeps, and so it renders alike on every machine. No name of the library can be given to
one.
"""

import functools
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import platformdirs
from filelock import FileLock, Timeout

from milkglass.core.errors import InputError
from milkglass.core.material import library as materials
from milkglass.core.material.library import Material
from milkglass.viewer.scene import toml_files
from milkglass.viewer.scene.declaration import nearest, shown
from milkglass.viewer.scene.given_file import given_bytes, reason_of

SOURCE = "own"
KEYS = ("sigma_s_prime", "sigma_a", "eta", "g")
OPTIONAL: dict[str, Any] = {"g": (0.0, 0.0, 0.0)}
COEFFICIENTS = {"name": KEYS, "mix_with": tuple(f"mix_{key}" for key in KEYS)}  # that a scene has in a name's place
LONGEST_NAME = 60
PATIENCE = 10.0  # seconds that another process may take to change the file

Materials = tuple[Material, ...]


def file() -> Path:
    """Return the path of the file of own materials, which need not exist."""
    return Path(platformdirs.user_data_dir("milkglass", appauthor=False)) / "materials.toml"


def stored() -> Materials:
    """Return the own materials in the order of their file, which is read again where it has changed.

    Raises
    ------
    InputError
        Naming the file, the material and the key.
    """
    try:
        return read(file())
    except FileNotFoundError:
        return ()


def lookup(name: str) -> Material:
    """Return a material of the library, else an own one, by name as `core.material.library.lookup`."""
    try:
        return materials.lookup(name)
    except InputError:
        return materials.lookup(name, stored())


def spelled_out(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return keys of a scene's material with coefficients in the place of names of own materials.

    Raises
    ------
    InputError
        If no material has a name, or one is given beside coefficients.
    """
    settings = dict(values)
    for key, coefficients in COEFFICIENTS.items():
        if settings.get(key) is None:
            continue
        material = lookup(settings[key])
        if material.source != SOURCE:
            continue
        for coefficient, value in zip(coefficients, _content(material), strict=True):
            if settings.get(coefficient) is None:
                settings[coefficient] = value
            elif coefficient not in ("eta", "g", "mix_eta", "mix_g"):
                raise InputError(f"material.{key} and material.{coefficient} are both given; keep one of them")
        settings[key] = None
    return settings


def named_like(material: Material) -> Material | None:
    """Return the own material of the same coefficients, if there is one; a file that cannot be read has none."""
    try:
        return next((candidate for candidate in stored() if _content(candidate) == _content(material)), None)
    except InputError:
        return None


def save(name: str, material: Material) -> Material:
    """Store a material under a name, in the place of an own one of that name, and return it as it is stored.

    Raises
    ------
    InputError
        If the name is the library's or no name, or the file cannot be read or written.
    """
    saved = replace(material, name=checked_name(name), source=SOURCE)
    key = materials.key_of(saved.name)
    with _changing() as existing:
        if any(materials.key_of(candidate.name) == key for candidate in existing):
            _write(file(), [saved if materials.key_of(candidate.name) == key else candidate for candidate in existing])
        else:
            _write(file(), [*existing, saved])
    return saved


def delete(name: str) -> None:
    """Remove an own material from the file."""
    with _changing() as existing:
        _write(file(), [candidate for candidate in existing if candidate.name != name])


def rename(name: str, new: str) -> None:
    """Give an own material another name, which none of the others has."""
    new = checked_name(new)
    with _changing() as existing:
        rest = [candidate for candidate in existing if candidate.name != name]
        if any(materials.key_of(candidate.name) == materials.key_of(new) for candidate in rest):
            raise InputError(f'"{new}" is another of your materials; choose another name')
        _write(file(), [replace(old, name=new) if old.name == name else old for old in existing])


def import_from(path: Path) -> Materials:
    """Add the materials of a file to the own ones, all or none, and return them.

    Raises
    ------
    InputError
        Naming the file and what is wrong in it, or the material that would change one that is known.
    """
    try:
        new = read(path)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    with _changing() as existing:
        by_key = {materials.key_of(candidate.name): candidate for candidate in existing}
        for candidate in new:
            before = by_key.get(materials.key_of(candidate.name))
            if before is not None and _content(before) != _content(candidate):
                raise InputError(f'{path}: you have another "{candidate.name}"; rename one of them')
            by_key.setdefault(materials.key_of(candidate.name), candidate)
        _write(file(), by_key.values())
    return new


def export_to(path: Path) -> Materials:
    """Write the own materials to a file, which is replaced, and return them."""
    exported = stored()
    if not exported:
        raise InputError("there are no materials of your own to export; save one first")
    _write(path, exported)
    return exported


def checked_name(name: str) -> str:
    """Return a name that an own material can have, without spaces around it.

    Raises
    ------
    InputError
        Saying what is wrong with it.
    """
    name = " ".join(name.split())
    if not materials.key_of(name) or not name.isprintable() or len(name) > LONGEST_NAME:
        raise InputError(f"a material needs a name of 1 to {LONGEST_NAME} letters, not {shown(name)}")
    for candidate in materials.library():
        if materials.key_of(candidate.name) == materials.key_of(name):
            raise InputError(f'"{name}" is a material of the library ({candidate.name}); choose another name')
    return name


def read(path: Path) -> Materials:
    """Read a file of materials, or return what it held if it has not changed since.

    Raises
    ------
    InputError
        Naming the file, the material and the key.
    FileNotFoundError
    """
    try:
        found = path.stat()
        return _read(path, found.st_mtime_ns, found.st_size)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot read the materials ({error.strerror or error})") from error


@contextmanager
def _changing() -> Iterator[Materials]:
    """Yield the own materials while no other process may change them, so that what two save at once is all kept.

    Raises
    ------
    InputError
        The file cannot be read, its folder cannot be written, or another process holds it for `PATIENCE`.
    """
    path = file()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = FileLock(path.with_suffix(".lock"))
        lock.acquire(timeout=PATIENCE)
    except Timeout:
        raise InputError(f"{path}: another milkglass has been changing it for {PATIENCE:g} s; try again") from None
    except (OSError, NotImplementedError) as error:
        raise InputError(f"{path}: cannot write the materials ({reason_of(error)})") from error
    try:
        _read.cache_clear()  # a file replaced twice within one tick of its clock looks unchanged
        yield stored()
    finally:
        lock.release()


@functools.lru_cache(maxsize=8)
def _read(path: Path, changed: int, size: int) -> Materials:
    found: dict[str, Material] = {}
    for name, content in toml_files.parse(given_bytes(path, "the materials"), path).items():
        try:
            material = _material(name, content)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        if materials.key_of(material.name) in found:
            raise InputError(f'{path}: two materials are called "{material.name}"; rename one of them')
        found[materials.key_of(material.name)] = material
    return tuple(found.values())


def _material(name: str, content: Any) -> Material:
    name = checked_name(name)
    if not isinstance(content, dict):
        raise InputError(f'"{name}" must be a table; write ["{name}"] on a line and {", ".join(KEYS)} below')
    for key in content:
        if key not in KEYS:
            raise InputError(f'{name}: unknown key "{key}"; {nearest(key, KEYS)}')
    for key in KEYS:
        if key not in content and key not in OPTIONAL:
            raise InputError(f"{name}: {key} is missing")
    given = OPTIONAL | content
    return Material(name, given["sigma_s_prime"], given["sigma_a"], given["eta"], SOURCE, given["g"])


def _content(material: Material) -> tuple[object, ...]:
    return tuple(getattr(material, key) for key in KEYS)


def _write(path: Path, stored_materials: Iterable[Material]) -> None:
    """Write a file of materials, whole or not at all."""
    document = {
        material.name: {key: list(v) if isinstance(v := getattr(material, key), tuple) else v for key in KEYS}
        for material in stored_materials
    }
    toml_files.write(path, toml_files.dumps(document), "the materials")
