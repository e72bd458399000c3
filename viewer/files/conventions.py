"""What a model's file declares of its lengths and directions, and what its format does where the file is silent.

glTF is in metres with +y up (glTF 2.0, 3.4); 3MF in the unit of its model element, millimetres without, with +z up
(3MF Core 1.3, 3.3 and 3.4); COLLADA in the metres and with the axis of its asset element, 1 and Y_UP without (COLLADA
1.4.1, 5). STL, a printer's, has no unit and +z up; OBJ, PLY and OFF declare nothing, and most have +y up.
"""

import re
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

from milkglass.core.errors import InputError

FILE = "file"  # in the place of a size: that of the file
LONGEST_HEAD = 1 << 16  # bytes of an XML file in which its first elements are
UNITS = {"micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8, "meter": 1000.0}  # of 3MF
UNKNOWN = (".step", ".stp", ".3dxml", ".xaml")  # converted on the way in, to what unit nothing says
Z_UP = (".stl", ".3mf")
COLLADA_AXES = {b"X_UP": "x", b"Y_UP": "y", b"Z_UP": "z"}


@dataclass(frozen=True)
class Conventions:
    """Unit and up axis of a model's file.

    Attributes
    ----------
    unit_mm : float, optional
        Millimetres in a unit of the file's; None where nothing tells.
    declared : bool
        Whether the file or its format says so; else millimetres are assumed.
    up : str
        The axis that points up, see `core.geometry.mesh.up_rotation`.
    """

    unit_mm: float | None = 1.0
    declared: bool = False
    up: str = "y"

    def size(self, longest: float, path: Path) -> float:
        """Return a longest side in units of the file in mm; raises `InputError` where nothing tells the unit."""
        if self.unit_mm is None:
            raise InputError(f"{path} does not tell its unit, so model.size_mm cannot be that of the file; give mm")
        return longest * self.unit_mm

    def size_text(self, longest: float) -> str:
        """Return the file's size, of its longest side in its units, in words."""
        if self.unit_mm is None:
            return f"{longest:.4g} in a unit that nothing tells"
        taken = "" if self.declared else " (no unit: mm assumed)"
        return f"{longest * self.unit_mm:.4g} mm{taken}"


def conventions(path: Path) -> Conventions:
    """Return the unit and up axis of a model's file; those of its format where its head cannot be read."""
    suffix = path.suffix.lower()
    if suffix in (".glb", ".gltf"):
        return Conventions(1000.0, declared=True)
    if suffix in UNKNOWN:
        return Conventions(None)
    if suffix not in (".3mf", ".dae", ".zae"):
        return Conventions(up="z" if suffix in Z_UP else "y")
    head = _head(path, b".model" if suffix == ".3mf" else b".dae")
    if suffix == ".3mf":
        named = re.search(rb"<(?:\w+:)?model\b[^>]*?\bunit\s*=\s*[\"'](\w+)", head)
        return Conventions(
            UNITS.get(named[1].decode("ascii", "replace") if named else "millimeter"), declared=True, up="z"
        )
    metres = re.search(rb"<unit\b[^>]*?\bmeter\s*=\s*[\"']\s*([-+.\deE]+)", head)
    axis = re.search(rb"<up_axis>\s*(\w+)", head)
    up = COLLADA_AXES.get(axis[1] if axis else b"", "y")
    try:
        unit = 1000.0 * float(metres[1]) if metres else 1000.0
    except ValueError:
        return Conventions(None, up=up)
    return Conventions(unit if 0.0 < unit < float("inf") else None, declared=True, up=up)


def _head(path: Path, suffix: bytes) -> bytes:
    """Return the first bytes of an XML file, which may be the first such in an archive; nothing of a damaged one."""
    try:
        if not zipfile.is_zipfile(path):
            with path.open("rb") as plain:
                return plain.read(LONGEST_HEAD)
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.lower().encode().endswith(suffix)]
            # The root of a 3MF file lies in 3D; parts that it refers to lie below.
            with archive.open(min(names, key=lambda name: name.count("/"))) as packed:
                return packed.read(LONGEST_HEAD)
    except (OSError, ValueError, RuntimeError, NotImplementedError, EOFError, zipfile.BadZipFile, zlib.error):
        return b""
