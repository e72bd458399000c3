"""Colours and relief of surfaces through the whole chain, against what they must do to E and M."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from milkglass.core.geometry.texture import linear
from milkglass.core.material.fresnel import transmittance
from milkglass.viewer.error.report import error_report
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.lights import DirectionalLight
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.settings import ModelSettings
from tests.support.rendering import inside, relative_rms, scene_of
from tests.support.skins import FLAT, ball_with_map, picture, write_ball, write_slab

C = 137  # a byte
COLOUR = float(linear(C / 255.0))
HEAD_ON = (DirectionalLight((0.0, 0.0, 1.0)),)
DIFFUSION = ["transport.method=diffusion", "transport.resolution=24"]
FRONT_VIEW = ["camera.azimuth_deg=0", "camera.elevation_deg=0"]


@pytest.fixture(scope="module")
def renderer(context):
    return Renderer(context)


def of(path, *assignments, **options) -> Scene:
    return replace(scene_of(*assignments, **options), model=ModelSettings(path=path, size_mm=20.0))


def shot(renderer, path, *assignments, **options):
    return renderer.render(of(path, *assignments, **options), samples=1)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["layered", "ewald", "diffusion"])
def test_one_colour_everywhere_is_a_factor_wherever_it_acts(renderer, tmp_path, method):
    path = write_ball(tmp_path / "ball.glb", picture((C, C, C)))
    options = {"method": method} if method != "diffusion" else {}
    # Highlights of the other model mirror, at rims, what leaves.
    more = ["specular.model=phong", *(DIFFUSION if method == "diffusion" else [])]
    plain = shot(renderer, path, *more, "detail.albedo=off", **options)
    assert not any("detail" in stage or "tint" in stage for stage in plain.timings)
    hit = inside(plain)
    for mode, power in (("before", 1.0), ("half", 0.5), ("after", 0.0)):
        frame = shot(renderer, path, *more, f"detail.albedo={mode}", **options)
        # llvmpipe decodes sRGB within 0.3 %; `diffusion` is solved to 3e-4 of the right side, from another start.
        near = {"rtol": 5e-3, "atol": 1e-3 * float(plain.exitance.max())}
        np.testing.assert_allclose(frame.irradiance[hit], COLOUR**power * plain.irradiance[hit], rtol=5e-3)
        np.testing.assert_allclose(frame.exitance[hit], COLOUR * plain.exitance[hit], **near)
        np.testing.assert_allclose(frame.subsurface[hit], COLOUR * plain.subsurface[hit], **near)
        np.testing.assert_array_equal(frame.specular, plain.specular)


def test_colours_of_a_texture_arrive_where_they_belong(renderer, tmp_path):
    pixels = np.random.default_rng(2).integers(60, 255, (8, 8, 3)).astype(np.uint8)
    path = write_slab(tmp_path / "slab.glb", picture(pixels))
    options = [*FRONT_VIEW, "camera.orthographic=true"]
    frame = shot(renderer, path, *options, "detail.albedo=before", lights=HEAD_ON)
    plain = shot(renderer, path, *options, "detail.albedo=off", lights=HEAD_ON)
    place = frame.position[..., :2] / 20.0 * 8.0 + 4.0 - 0.5  # texels from the lower left, centres at whole numbers
    hit = inside(frame) & (frame.normal[..., 2] > 0.9) & ((place > 0.05) & (place < 6.95)).all(axis=-1)
    (j, i), (fx, fy) = np.floor(place[hit]).astype(int).T, np.mod(place[hit], 1.0).T[..., None]
    up = linear(pixels[::-1] / 255.0)
    lower, upper = ((1.0 - fx) * up[i + k, j] + fx * up[i + k, j + 1] for k in (0, 1))
    expected = ((1.0 - fy) * lower + fy * upper) * plain.irradiance[hit]
    assert hit.sum() > 2000
    np.testing.assert_allclose(frame.irradiance[hit], expected, rtol=0.02)


@pytest.mark.parametrize("method", ["layered", "ewald"])
def test_colours_of_vertices_arrive_at_pixels_and_samples(renderer, tmp_path, method):
    """Behind a shape that shows no texture of its own: its left half is black before scattering."""
    vertices, faces, _ = ball_with_map()
    colours = np.tile(np.where(vertices[:, :1] > 0.0, 255, 0), (1, 4)).astype(np.uint8)
    trimesh.Trimesh(vertices, faces, vertex_colors=colours, process=False).export(tmp_path / "ball.ply")
    frame = shot(renderer, tmp_path / "ball.ply", *FRONT_VIEW, "detail.albedo=before", method=method, lights=HEAD_ON)
    hit, x = inside(frame), frame.position[..., 0]
    assert frame.irradiance[hit & (x < -2.0)].max() == 0.0
    assert frame.irradiance[hit & (x > 2.0)].min() > 0.0
    far = [frame.exitance[hit & (side * x > 5.0)].mean(axis=0) for side in (-1.0, 1.0)]
    assert (far[0] < 0.1 * far[1]).all()
    assert (far[0] > 0.0).all()  # scattered over there


def test_a_flat_normal_map_changes_nothing_and_none_is_not_drawn(renderer, tmp_path):
    flat = shot(renderer, write_ball(tmp_path / "flat.glb", normal=picture(FLAT)))
    none = shot(renderer, write_ball(tmp_path / "none.glb"))
    assert "detail of pixels" in flat.timings
    assert "detail of pixels" not in none.timings
    for name in ("irradiance", "exitance", "specular"):
        np.testing.assert_allclose(getattr(flat, name), getattr(none, name), rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("strength", [1.0, 0.5])
def test_a_tilted_normal_map_has_the_cosine_and_fresnel_of_its_normal(renderer, tmp_path, strength):
    byte = np.array([128 + 60, 128 + 30, 128 + 108])
    path = write_slab(tmp_path / "slab.glb", normal=picture(byte))
    lights = (DirectionalLight((0.4, -0.3, 0.8), (3.0, 2.0, 1.0)),)
    frame = shot(renderer, path, *FRONT_VIEW, f"detail.normal_strength={strength}", lights=lights)
    normal = (byte - 128.0) * [strength, strength, 1.0]
    cosine = normal @ lights[0].direction / np.linalg.norm(normal) / np.linalg.norm(lights[0].direction)
    hit = inside(frame, 4) & (frame.normal[..., 2] > 0.9)
    expected = transmittance(1.5, cosine) * cosine * np.array(lights[0].irradiance)
    np.testing.assert_allclose(frame.irradiance[hit], np.tile(expected, (hit.sum(), 1)), rtol=0.01)
    np.testing.assert_allclose(frame.normal[hit], np.tile([0.0, 0.0, 1.0], (hit.sum(), 1)), atol=1e-5)  # the shape's
    # Samples too: in the middle of a plate far wider than the mean free path M / E is as if nothing were tilted.
    plain = shot(renderer, path, *FRONT_VIEW, "detail.normal_strength=0", lights=lights)
    ratio = frame.irradiance[hit].mean(axis=0) / plain.irradiance[hit].mean(axis=0)
    np.testing.assert_allclose(frame.exitance[hit].mean(axis=0) / plain.exitance[hit].mean(axis=0), ratio, rtol=0.06)


def test_relief_lets_no_light_through_the_surface(renderer, tmp_path):
    path = write_slab(tmp_path / "slab.glb", normal=picture((250, 128, 150)))
    lights = (DirectionalLight((1.0, 0.0, -0.1)),)  # it grazes the other side; the relief turns towards it
    frame = shot(renderer, path, *FRONT_VIEW, "specular.strength=1", lights=lights)
    top = inside(frame) & (frame.normal[..., 2] > 0.9)
    assert frame.irradiance[top].max() == 0.0
    assert frame.specular[top].max() == 0.0


def test_texture_coordinates_without_an_area_have_no_relief(renderer, tmp_path):
    vertices, faces, uv = ball_with_map()
    material = trimesh.visual.material.PBRMaterial(normalTexture=picture((250, 40, 150)))
    visual = trimesh.visual.TextureVisuals(uv=0.0 * uv, material=material)
    trimesh.Trimesh(vertices, faces, process=False, visual=visual).export(tmp_path / "point.glb")
    frame = shot(renderer, tmp_path / "point.glb")
    none = shot(renderer, write_ball(tmp_path / "none.glb"))
    assert all(np.isfinite(plane).all() for plane in frame.channels().values())
    np.testing.assert_allclose(frame.irradiance, none.irradiance, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["half", "after"])
def test_the_report_sums_what_the_picture_shows(renderer, tmp_path, mode):
    dots = np.full((16, 32, 3), 255, np.uint8)
    dots[:, ::2] = (90, 20, 160)
    path = write_ball(tmp_path / "ball.glb", picture(dots), picture((150, 140, 240)))
    scene = of(path, f"detail.albedo={mode}", "transport.resolution=60", "material.name=skim milk", method="ewald")
    report = error_report(renderer, scene, points=60, photons=1000)
    assert report.content["error"]["rms_together"] < 0.02
    assert report.content["material"]["colours"] == mode
    assert "colours" in report.content["transport_error"]["not_measured"]


@pytest.mark.slow
def test_a_thin_sheet_has_the_colour_of_its_other_side(renderer, tmp_path):
    box = trimesh.creation.box((2.0, 2.0, 0.02)).subdivide().subdivide().subdivide()
    behind = box.vertices[:, 2] < 0.0
    box.visual.vertex_colors = np.where(behind[:, None], [C, C, C, 255], [255, 255, 255, 255]).astype(np.uint8)
    box.export(tmp_path / "sheet.ply")
    lights = (DirectionalLight((0.0, 0.0, -1.0)),)
    options = [*FRONT_VIEW, "material.name=marble"]
    for more in ({"method": "ewald"}, {}):
        assignments = [*options, *([] if more else DIFFUSION)]
        frame = shot(renderer, tmp_path / "sheet.ply", *assignments, "detail.albedo=before", lights=lights, **more)
        plain = shot(renderer, tmp_path / "sheet.ply", *assignments, "detail.albedo=off", lights=lights, **more)
        hit = inside(frame, 4)
        ratio = frame.exitance[hit].mean(axis=0) / plain.exitance[hit].mean(axis=0)
        # The colours of a sheet thinner than the nodes are known as the mean of its sides, at worst.
        assert (ratio < 0.5 * (1.0 + COLOUR) * 1.05).all()
        assert (ratio > COLOUR * 0.95).all()
    assert relative_rms(frame.exitance[hit], plain.exitance[hit]).min() > 0.1
