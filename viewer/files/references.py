"""Files that a model's file names, as people's programs write them: %20, backslashes, and the options of MTL."""

from collections.abc import Iterable
from urllib.parse import unquote

import numpy as np
import trimesh

from milkglass.core.arrays import Array

VECTORS = ("-o", "-s", "-t")  # options of one to three numbers
PAIRS = ("-mm",)
SINGLES = ("-blendu", "-blendv", "-boost", "-bm", "-cc", "-clamp", "-imfchan", "-texres", "-type")


class References(trimesh.resolvers.FilePathResolver):  # type: ignore[misc]  # trimesh has no types
    """Finds files that a glTF file, or an OBJ file and its MTL files, name."""

    def get(self, name: str) -> bytes:
        """Return the bytes of a file; raises what trimesh's does where there is none."""
        for candidate in candidates(name):
            try:
                return bytes(super().get(candidate))
            except (OSError, ValueError):
                continue
        return bytes(super().get(name))


def candidates(name: str) -> Iterable[str]:
    """Return the files that a name with options may mean, the likeliest first."""
    plain = split_options(name)[0]
    forward = plain.replace("\\", "/")
    return dict.fromkeys((plain, forward, unquote(forward)))


def split_options(text: str) -> tuple[str, dict[str, tuple[float, ...]]]:
    """Return the file of a map's line, spaces kept, and the numbers of its options -o, -s and -t."""
    rest, found = text.strip(), {}
    while rest.startswith("-"):
        option, _, after = rest.partition(" ")
        option, after = option.lower(), after.lstrip()
        if option in VECTORS:
            numbers: list[float] = []
            while len(numbers) < 3 and (number := _number(after.partition(" ")[0])) is not None:
                numbers.append(number)
                after = after.partition(" ")[2].lstrip()
            found[option] = tuple(numbers)
        elif option in (*PAIRS, *SINGLES):
            for _ in range(2 if option in PAIRS else 1):
                after = after.partition(" ")[2].lstrip()
        else:
            break
        rest = after
    return rest, found


def transform_of(text: str) -> Array | None:
    """Return the transform of texture coordinates of a map's line, (3, 3); None where it has none."""
    options = split_options(text)[1]
    if not options.keys() & {"-o", "-s"}:
        return None
    offset, scale = (*options.get("-o", ()), 0.0, 0.0), (*options.get("-s", ()), 1.0, 1.0)
    return np.array([[scale[0], 0.0, offset[0]], [0.0, scale[1], offset[1]], [0.0, 0.0, 1.0]])


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if np.isfinite(number) else None
