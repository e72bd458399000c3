"""What the bodies of a scene are of: the material, and parts that scatter light and have a material of their own."""

from collections.abc import Sequence

from milkglass.core.geometry.bodies import touching_kinds
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.material.medium import Medium, media
from milkglass.core.paths.resolution import scatters
from milkglass.core.transport.base import Matter
from milkglass.core.transport.methods import Method
from milkglass.viewer.scene.scene import Scene

ONE_MATERIAL = (
    "a part with a material of its own that scatters light needs transport diffusion and separate bodies; it is drawn"
    " in the scene's material"
)


def is_clear(method: Method, media: Sequence[Medium], mesh: Mesh) -> bool:
    """Return whether so little light scatters in an object that rays of sight find all there is to see."""
    return method.follows_sight and not scatters(media, mesh.mean_chord)


def of_one_kind(scene: Scene, mesh: Mesh, count: int, method: Method) -> Matter:
    """Return the matter of all bodies of a mesh, `count` of them."""
    of_channels = media(scene.material.resolve())
    return Matter(of_channels, range(count), chord=mesh.mean_chord, scatters=not is_clear(method, of_channels, mesh))


def of_kinds(scene: Scene, mesh: Mesh, ranges: Sequence[range], method: Method) -> tuple[Matter, ...]:
    """Return the matter of bodies, kind by kind, of which there are so many."""
    found, named = [], [("", scene.material), *scene.scattering_parts]
    for kind, ((name, material), bodies) in enumerate(zip(named, ranges, strict=True)):
        part, of_channels = Mesh(mesh.vertices, mesh.normals, mesh.faces[mesh.kinds == kind]), media(material.resolve())
        clear = is_clear(method, of_channels, part)
        found.append(Matter(of_channels, bodies, name, part.mean_chord, scatters=not clear))
    return tuple(found)


def touching(mesh: Mesh, matter: Sequence[Matter]) -> tuple[str, ...]:
    """Return sentences on parts that touch and both scatter light."""
    pairs = touching_kinds(mesh)
    names = [of_kind.name or "the material" for of_kind in matter]
    return tuple(
        f"{names[a]} and {names[b]} touch, and both scatter light: what passes from one into the other without having"
        " scattered is followed, what has is taken to cross a thin layer of air; move them apart to be rid of this"
        for a, b in pairs
        if matter[a].scatters and matter[b].scatters
    )
