"""The pictures of the pages, drawn again by the commands of the program: README.md, viewer/README.md.

    python -m tests.support.page_pictures [NAME ...]

draws all, or those named such as `lights`, into `.readme`. Third-party meshes, probes and the photograph come from the
folder that the tests read. `path_traced` is a command of README.md.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import trimesh

from milkglass.core.material.library import library, lookup
from milkglass.core.reference.photons import walk
from milkglass.viewer.gl.context import current, headless_context
from milkglass.viewer.render.picture import PictureRequest, read_image
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.camera import pixel_offsets
from milkglass.viewer.scene.lights import DirectionalLight
from milkglass.viewer.scene.scene import Scene, apply_set, default_scene
from milkglass.viewer.window.panel.panel import SECTIONS
from milkglass.viewer.window.replay import Headless
from tests.support.half_space import HalfSpace
from tests.support.paths import DATA, PACKAGES, ROOT

Pixels = npt.NDArray[np.uint8]

BUDDHA, DRAGON, BUNNY = (DATA / "meshes" / name for name in ("buddha_100k.ply", "dragon_100k.ply", "bunny_closed.ply"))
UFFIZI, GALILEO = (DATA / "hdr" / f"{name}.hdr" for name in ("uffizi_latlong_1200x600", "galileo_probe"))
PHOTO, MASK = DATA / "image" / "buddha_head.png", DATA / "image" / "buddha_head_mask.png"
ON_GROUND = ("--set", "ground.on=true", "--set", "ground.reflectance=0.15", "--background", "#2a2d30")
FIGURES = ROOT / "tests" / "figures"
SCENES = ROOT / "viewer" / "scenes"
PROGRAM = "milkglass.viewer.commands.cli"
MEASURED = "JMLH01", "NGD06"  # sources of the library
PLAIN = ("--background", "#000000")


class Studio:
    """A folder in which tiles of pictures are drawn."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._count = 0

    def tile(self, size: tuple[int, int], *options: object, command: str = "render") -> Pixels:
        """Return what `milkglass render` draws with options, columns x rows; `edit` has its photograph's size."""
        self._count += 1
        path = self.folder / f"{self._count}.png"
        sized = () if command == "edit" or "--scene" in options else ("--image-size", f"{size[0]}x{size[1]}")
        words = [command, *map(str, options), *sized, "--samples", "16", "--output", str(path)]
        environment = {**os.environ, "PYTHONPATH": str(PACKAGES)}
        subprocess.run([sys.executable, "-m", PROGRAM, *words], check=True, env=environment)
        return picture(path, size)

    def mesh(self, name: str, model: trimesh.Trimesh) -> Path:
        """Write a mesh and return its file."""
        path = self.folder / name
        model.export(path)
        return path


def picture(path: Path, size: tuple[int, int]) -> Pixels:
    """Return a picture file, scaled down to columns x rows, from its top."""
    found = cv2.imread(str(path))
    assert found is not None, path
    rows = min(found.shape[0], round(found.shape[1] * size[1] / size[0]))
    return np.asarray(cv2.resize(found[:rows], size, interpolation=cv2.INTER_AREA), np.uint8)


Drawing = Callable[[Studio], Pixels]


def beside(*tiles: Pixels) -> Pixels:
    """Return tiles in a row."""
    return np.concatenate(tiles, axis=1)


def hero(studio: Studio) -> Pixels:
    environment = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
    environment["PYTHONPATH"] = str(PACKAGES)
    subprocess.run([sys.executable, "-m", PROGRAM], check=True, env=environment, cwd=studio.folder)
    return picture(studio.folder / "milkglass.png", (1024, 1024))


def gallery(model: Path, name: str) -> Drawing:
    """Return what draws a model on a ground."""
    return lambda studio: studio.tile((640, 640), model, "--material", name, "--size-mm", 60, *ON_GROUND)


def colours(studio: Studio) -> Pixels:
    model = trimesh.load_mesh(BUNNY)
    x, y, z = 6.0 * model.vertices.T / np.ptp(model.vertices, axis=0).max()
    bent = (
        x
        + 0.5 * y
        + 0.9 * np.sin(1.1 * y + 0.7 * z)
        + 0.5 * np.sin(2.3 * z + 1.3 * x)
        + 0.2 * np.sin(5.0 * y - 3.0 * x)
    )
    vein = np.exp(-np.square(np.sin(1.7 * bent) / 0.22))
    model.visual.vertex_colors = (255.0 * (1.0 - vein[:, None] * [0.8, 0.75, 0.65])).astype(np.uint8)
    veined = studio.mesh("veined.ply", model)
    options = veined, "--material", "white marble", "--size-mm", 60, *PLAIN
    return beside(
        *[studio.tile((340, 340), *options, "--set", f"detail.albedo={on}") for on in ("before", "half", "after")]
    )


def bodies(studio: Studio) -> Pixels:
    plates = [trimesh.creation.box((20.0, 20.0, 2.0)) for _ in range(2)]
    plates[1].apply_translation((0.0, 0.0, -2.5))
    options = (
        studio.mesh("plates.ply", trimesh.util.concatenate(plates)), "--material", "marble", "--size-mm", 20, *PLAIN,
        "--light", "directional:0.1,0.2,-1:3,3,3", "--camera-azimuth", -35, "--camera-elevation", 15,
    )  # fmt: skip
    apart = "--set", "model.bodies=separate"
    kinds = ("--set", "model.bodies=joined"), apart, (*apart, "--set", "transport.exchange=off")
    return beside(*[studio.tile((320, 320), *options, *kind) for kind in kinds])


def dilution(studio: Studio) -> Pixels:
    options = BUNNY, "--material", "lowfat milk", "--size-mm", 60, *PLAIN
    return beside(
        *[
            studio.tile((228, 228), *options, "--set", f"material.water={water}")
            for water in (0.0, 0.8, 0.95, 0.99, 0.998)
        ]
    )


def profiles(studio: Studio) -> Pixels:
    table = photon_table(studio.folder / "photons.csv", "skin1")
    options = (
        BUNNY, "--material", "skin1", "--size-mm", 40, "--transport", "ewald", *PLAIN,
        "--light", "directional:-0.75,0.55,0.35:3,3,3:angle_deg=12", "--set", "specular.strength=0",
    )  # fmt: skip
    names = "dipole", "better_dipole", "photon_beam", "burley", "gaussians", "table"
    tiles = [
        studio.tile((280, 280), *options, "--profile", name, "--set", f"material.profile_table={table}")
        for name in names
    ]
    return np.concatenate([beside(*tiles[:3]), beside(*tiles[3:])])


def photon_table(path: Path, name: str) -> Path:
    """Write what photons in a half space of a material are let out by as a table of a profile, and return it."""
    medium, edges = lookup(name), np.concatenate([[0.0], np.geomspace(0.02, 15.0, 40)])
    columns = [np.sqrt(edges[1:] * np.maximum(edges[:-1], 0.5 * edges[1]))]
    for scattering, absorption in zip(medium.sigma_s_prime, medium.sigma_a, strict=True):
        extinction = scattering + absorption
        rings = HalfSpace(edges * extinction)
        found = walk(rings, 1.0, (scattering / extinction,), medium.eta, (0.0, 0.0, -1.0), 400_000, seed=1)
        share = found.scattered[:, :-1, 0].mean(axis=0) / found.entered.sum()
        columns.append(np.minimum.accumulate(np.maximum(share / rings.areas[:-1], 1e-9)) * extinction**2)
    rows = np.vstack([np.stack(columns, axis=1), [1.2 * edges[-1], 0.0, 0.0, 0.0]])
    np.savetxt(path, rows, "%.8g", ",", header="radius_mm, R, G, B", comments="")
    return path


def lights(studio: Studio) -> Pixels:
    floor = trimesh.creation.box((220.0, 10.0, 220.0))
    post = trimesh.creation.box((24.0, 80.0, 24.0))
    post.apply_translation((0.0, 45.0, 0.0))
    ball = trimesh.creation.icosphere(4, 22.0)
    ball.apply_translation((-62.0, 27.0, 10.0))
    path = studio.mesh("post.ply", trimesh.util.concatenate([floor, post, ball]))
    scene = (
        path,
        "--material",
        "marble",
        "--size-mm",
        220,
        *PLAIN,
        "--camera-elevation",
        28,
        "--set",
        "display.exposure=-0.4",
    )
    tiles = [
        studio.tile((320, 320), *scene, "--light", light)
        for light in (
            "point:90,140,60:40000,40000,40000",
            "sphere:90,140,60:40000,40000,40000:radius_mm=35",
            "spot:0,200,50:60000,60000,60000:cone_deg=40:softness=0.3",
        )
    ]
    panel = "rectangle:-40,60,-130:60000,60000,60000:size_mm=160,160"
    return beside(*tiles, studio.tile((320, 320), "--material", "jade", *PLAIN, "--light", panel))


def occlusion(studio: Studio) -> Pixels:
    options = (
        BUDDHA, "--material", "marble", "--size-mm", 60, "--environment", UFFIZI, *PLAIN, "--camera-azimuth", 0,
        "--set", "transport.exchange=off",
    )  # fmt: skip
    return beside(
        *[studio.tile((380, 720), *options, "--set", f"environment.occluded={on}") for on in ("false", "true")]
    )


def highlights(studio: Studio) -> Pixels:
    options = (
        DRAGON,
        "--material",
        "jade",
        "--size-mm",
        60,
        "--environment",
        UFFIZI,
        *PLAIN,
        "--set",
        "specular.shininess=60",
    )
    return beside(
        *[studio.tile((560, 420), *options, "--set", f"environment.occluded={on}") for on in ("false", "true")]
    )


def galileo(studio: Studio) -> Pixels:
    options = DRAGON, "--material", "marble", "--size-mm", 60, "--environment", GALILEO, *PLAIN
    kinds = (
        ("--set", "specular.strength=0", "--set", "environment.extract=false"),
        ("--set", "environment.extract=false"),
        (),
    )
    return beside(*[studio.tile((420, 320), *options, *kind) for kind in kinds])


def measured(_: Studio) -> Pixels:
    """Draw every measured material, all at one exposure, its name below it."""
    found = [item for item in library() if item.source in MEASURED]
    renderer, side, columns = Renderer(), 148, 8
    common = [
        f"model.path={BUNNY}", "model.size_mm=60", f"environment.path={UFFIZI}", "display.background=environment",
        "display.background_blur_deg=4", f"display.image_size=[{2 * side},{2 * side}]", "lights=[]",
    ]  # fmt: skip
    tiles, exposure = [], None
    for item in found:
        request = PictureRequest(pixel_offsets(4), exposure_for=exposure)
        drawn = renderer.draw(apply_set(Scene(), [*common, f"material.name={item.name}"]), request)
        exposure = drawn.log_average if exposure is None else exposure
        image = cv2.cvtColor(read_image(drawn), cv2.COLOR_RGB2BGR)
        tile = cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA)
        label = np.full((18, side, 3), 24, np.uint8)
        cv2.putText(label, item.name, (3, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.36, (230, 230, 230), 1, cv2.LINE_AA)
        tiles.append(np.concatenate([tile, label]))
    tiles += [np.full_like(tiles[0], 24)] * (-len(tiles) % columns)
    return np.concatenate([beside(*tiles[i : i + columns]) for i in range(0, len(tiles), columns)])


def environments(studio: Studio) -> Pixels:
    options = (
        "--material", "jade", "--background", "environment", "--set", "display.background_blur_deg=15",
        "--set", "ground.on=true", "--set", "ground.reflectance=0.25",
    )  # fmt: skip
    names = "studio", "backlight", "window", "overcast"
    return beside(*[studio.tile((320, 320), *options, "--environment", name) for name in names])


def glasses(studio: Studio) -> Pixels:
    """Draw the vessels of the scene files, each at the same height, from pixels of twice the size."""
    sizes = {"apple_juice": (560, 560), "wine_bottle": (373, 560), "milk": (560, 560)}
    return beside(
        *[
            studio.tile(size, "--scene", SCENES / f"{name}.toml", "--image-size", f"{2 * size[0]}x{2 * size[1]}")
            for name, size in sizes.items()
        ]
    )


def in_window(scene: Scene, size: tuple[int, int], sections: tuple[str, ...], *commands: str) -> Pixels:
    """Return what a window of columns x rows shows of a scene, with sections of its panel open, after commands."""
    for section in SECTIONS:
        section.starts_open = section.title in sections
    with current(headless_context()), closing(Headless(scene, size)) as replay:
        replay.settle()
        for command in commands:
            replay.app.commands.run(command)
            replay.settle()
        replay.app.commands.run("dismiss")
        replay.frame()
        data = np.frombuffer(replay.target.read(components=3, alignment=1), np.uint8)
    return np.ascontiguousarray(data.reshape(size[1], size[0], 3)[::-1, :, ::-1])


def window(studio: Studio) -> Pixels:
    scene = apply_set(default_scene(), [f"model.path={BUDDHA}", "model.size_mm=60", "material.name=jade"])
    key = DirectionalLight((-0.5, 0.35, -0.8), (8.0, 7.0, 5.6), angle_deg=12.0)
    lit = replace(scene, lights=(key, *scene.lights[1:]))
    return in_window(lit, (1280, 800), ("Material", "Lights"))


def error_live(studio: Studio) -> Pixels:
    scene = apply_set(default_scene(), ["transport.method=ewald"])
    return in_window(scene, (1280, 800), ("Light transport", "Error"), "toggle_measure")


def profile_view(studio: Studio) -> Pixels:
    scene = apply_set(default_scene(), ["material.name=skin1", "model.size_mm=40", "transport.method=ewald"])
    return in_window(scene, (765, 660), (), "toggle_panel", "toggle_profiles")


def figure(name: str, size: tuple[int, int], *options: object) -> Drawing:
    """Return what draws one of the paper's figures from its scene file."""
    return lambda studio: studio.tile(size, *options, "--scene", FIGURES / f"{name}.toml")


def photograph(size: tuple[int, int]) -> Drawing:
    """Return what shows the upper part of the photograph itself."""
    return lambda _: picture(PHOTO, size)


def edited(name: str, size: tuple[int, int]) -> Drawing:
    """Return what draws the upper part of the photograph with its object in a material."""
    options = PHOTO, "--mask", MASK, "--scene", FIGURES / "figure3.toml", "--material", name
    return lambda studio: studio.tile(size, *options, command="edit")


def row(*tiles: Drawing) -> Drawing:
    """Return what draws tiles in a row."""
    return lambda studio: beside(*[tile(studio) for tile in tiles])


PICTURES: dict[str, Drawing] = {
    "hero.png": hero,
    "window.png": window,
    "dragon_marble.png": gallery(DRAGON, "marble"),
    "buddha_skimmilk.png": gallery(BUDDHA, "skim milk"),
    "bunny_wax.png": gallery(BUNNY, "wax"),
    "colours.png": colours,
    "bodies.png": bodies,
    "dilution.png": dilution,
    "profiles.png": profiles,
    "lights.png": lights,
    "occlusion.png": occlusion,
    "highlights.png": highlights,
    "galileo.png": galileo,
    "environments.png": environments,
    "measured.jpg": measured,
    "glasses.jpg": glasses,
    "error_live.png": error_live,
    "profile_view.png": profile_view,
    "photograph.jpg": row(photograph((230, 352)), *[edited(name, (230, 352)) for name in ("jade", "marble", "wax")]),
    "figure3.jpg": row(*[edited(name, (314, 480)) for name in ("marble", "jade", "wax")]),
    "figure4.jpg": row(
        *[figure(f"figure4_{name}", (380, 570), BUDDHA, "--environment", UFFIZI) for name in ("ketchup", "milk")]
    ),
    "figure5.jpg": row(
        figure("figure5_jade", (300, 450), BUDDHA),
        figure("figure5_jade", (300, 450), BUDDHA, "--transport", "layered", "--layers", 4, "--resolution", 256),
        figure("figure5_marble", (600, 450), DRAGON, "--environment", GALILEO),
    ),
}


def main(names: list[str]) -> None:
    """Draw the pictures of some names, without suffix; all of them where none is given."""
    for name, draw in PICTURES.items():
        path = ROOT / ".readme" / name
        if names and path.stem not in names:
            continue
        with tempfile.TemporaryDirectory() as folder:
            cv2.imwrite(str(path), draw(Studio(Path(folder))))
        print(path.name)  # noqa: T201


if __name__ == "__main__":
    main(sys.argv[1:])
