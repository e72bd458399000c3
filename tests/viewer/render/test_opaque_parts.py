"""A part of a file that is opaque by a material of its own: a holder that does not glow beside wax that does."""

from pathlib import Path

import trimesh

from milkglass.viewer.render.renderer import render
from milkglass.viewer.scene.scene import Scene, apply_set

SMALL = ["display.image_size=[48,48]", "transport.resolution=16", "camera.azimuth_deg=0", "camera.elevation_deg=0"]
BEHIND = "lights=[{kind='directional',direction=[0.0,0.3,-1.0]}]"


def test_an_opaque_part_does_not_glow(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    for name, extents, height in (("wax", (2.0, 6.0, 2.0), 4.0), ("steel", (6.0, 1.0, 2.0), 0.0)):
        part = trimesh.creation.box(extents, trimesh.transformations.translation_matrix((0.0, height, 0.0)))
        part.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(name=name))
        scene.add_geometry(part, geom_name=name)
    scene.export(tmp_path / "candle.glb")
    model = [f'model.path="{tmp_path / "candle.glb"}"', "model.size_mm=30", "material.name=wax", BEHIND]
    opaque = ["materials.steel.sigma_s_prime=[0,0,0]", "materials.steel.sigma_a=[1000,1000,1000]"]
    glow = []
    for settings in (model, [*model, *opaque]):
        frame = render(apply_set(Scene(), [*SMALL, *settings]), samples=1)
        seen = frame.alpha > 0.9
        low = seen & (frame.position[..., 1] < frame.position[seen][:, 1].min() + 3.0)
        high = seen & (frame.position[..., 1] > 0.0)
        glow.append((frame.exitance[low].mean(), frame.exitance[high].mean()))
    (lower, upper), (holder, wax) = glow
    assert lower > 0.0 < upper
    assert holder == 0.0 < wax
