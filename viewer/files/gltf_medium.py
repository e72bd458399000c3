"""The matter that a glTF file says its surface bounds, as coefficients in 1/mm.

A volume's extinction is -ln(c) / d, of the colour c that is left after the distance d (KHR_materials_volume). Its
scattering is told by the colour that it has after many scatterings, from which the albedo of one follows by

    1 - (4.09712 + 4.20863 rho - sqrt(9.59217 + 41.6808 rho + 17.7126 rho^2))^2,

C. Kulla and A. Conty, "Revisiting physically based shading at Imageworks", 2017; KHR_materials_scatter has it, and
KHR_materials_volume_scatter, which that replaces. Pictures on these quantities are left out.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from milkglass.core.material.library import MAX_COEFFICIENT, MAX_ETA, MAX_G, Material
from milkglass.viewer.files.gltf import SUFFIXES, listed, read_tree

USUAL_IOR = 1.5
MILLIMETRES = 1000.0  # in a metre, the unit of glTF
DARKEST = 1e-6  # share of light left after the distance, below which nothing tells more
SCATTERS = ("KHR_materials_scatter", "KHR_materials_volume_scatter")
TRANSMITS = (
    ("KHR_materials_transmission", "transmissionFactor"),
    ("KHR_materials_diffuse_transmission", "diffuseTransmissionFactor"),
)


@dataclass(frozen=True)
class FileMedium:
    """The medium of one of a file's materials, and the names of the extensions that told it."""

    material: Material
    extensions: tuple[str, ...]

    def sentence(self, path: Path) -> str:
        """Return what was heard, in words."""
        scattering, absorption = (
            ", ".join(f"{value:.4g}" for value in values)
            for values in (self.material.sigma_s_prime, self.material.sigma_a)
        )
        forward = f", g {self.material.g[0]:.3g}" if any(self.material.g) else ""
        return (
            f"{path}: the medium of its material {self.material.name} is taken ({', '.join(self.extensions)}): "
            f"sigma_s_prime {scattering} and sigma_a {absorption} 1/mm, eta {self.material.eta:.4g}{forward}; "
            "it is meant for --size-mm file, and --material names another"
        )


def single_scattering_albedo(multiple: float) -> float:
    """Return the albedo of one scattering, in [0, 1], of a medium of this albedo of many, in [0, 1]."""
    root = math.sqrt(9.59217 + 41.6808 * multiple + 17.7126 * multiple**2)
    return min(max(1.0 - (4.09712 + 4.20863 * multiple - root) ** 2, 0.0), 1.0)


def medium_of(path: Path) -> FileMedium | None:
    """Return the medium of the first material of a glTF file, in use there, that scatters light; None without one."""
    return next(_media(path), None) if path.suffix.lower() in SUFFIXES and path.is_file() else None


def _media(path: Path) -> Iterator[FileMedium]:
    tree = read_tree(path)
    materials = listed(tree, "materials")
    meshes = [mesh for mesh in listed(tree, "meshes") if isinstance(mesh, dict)]
    primitives = [primitive for mesh in meshes for primitive in listed(mesh, "primitives")]
    used = [primitive.get("material") for primitive in primitives if isinstance(primitive, dict)]
    for i, material in enumerate(materials):
        if i in used and isinstance(material, dict):
            found = _medium(material, str(material.get("name") or i + 1))
            if found is not None:
                yield found


def _medium(material: dict[str, Any], name: str) -> FileMedium | None:
    """Return the medium below a material; None where light does not enter, the wall is thin or nothing scatters."""
    held = material.get("extensions")
    extensions = (
        {key: value for key, value in held.items() if isinstance(value, dict)} if isinstance(held, dict) else {}
    )
    volume = extensions.get("KHR_materials_volume", {})
    scatter = next((extensions[key] for key in SCATTERS if key in extensions), None)
    enters = any(_number(extensions.get(key, {}).get(factor), 0.0) > 0.0 for key, factor in TRANSMITS)
    distance = _number(volume.get("attenuationDistance"), math.inf)
    if scatter is None or not enters or _number(volume.get("thicknessFactor"), 0.0) <= 0.0 or not distance > 0.0:
        return None
    left = _colour(volume.get("attenuationColor"))
    seen = _colour(scatter.get("multiscatterColorFactor", scatter.get("multiscatterColor")))
    extinction = [min(-math.log(max(c, DARKEST)) / distance / MILLIMETRES, MAX_COEFFICIENT) for c in left]
    albedo = [single_scattering_albedo(c) for c in seen]
    g = min(max(_number(scatter.get("scatterAnisotropy"), 0.0), -MAX_G), MAX_G)
    reduced = [t * a * (1.0 - g) for t, a in zip(extinction, albedo, strict=True)]
    if not any(reduced):
        return None
    absorbed = [t * (1.0 - a) for t, a in zip(extinction, albedo, strict=True)]
    eta = _number(extensions.get("KHR_materials_ior", {}).get("ior"), USUAL_IOR)
    eta = min(eta, MAX_ETA) if eta >= 1.0 else USUAL_IOR  # 0 stands for no mirror at all
    sources = tuple(key for key in ("KHR_materials_volume", *SCATTERS, "KHR_materials_ior") if key in extensions)
    g = max(g, 0.0)  # scattering backwards is as its reduced coefficient has it
    return FileMedium(Material(name, _vector(reduced), _vector(absorbed), eta, "file", (g, g, g)), sources)


def _vector(values: Iterable[float]) -> tuple[float, float, float]:
    red, green, blue = values
    return red, green, blue


def _number(value: object, default: float) -> float:
    """Return a finite number of a file, or the default."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if is_number else default  # type: ignore[arg-type]


def _colour(value: object, default: float = 1.0) -> tuple[float, float, float]:
    """Return a colour of a file in [0, 1], or one of the default."""
    elements = value if isinstance(value, list) and len(value) == 3 else [default] * 3
    return _vector(min(max(_number(element, default), 0.0), 1.0) for element in elements)
