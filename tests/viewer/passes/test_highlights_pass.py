"""Highlights of an environment that the object is in the way of, and its light behind thin parts."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.geometry.refine import interpolated
from milkglass.core.light.bake import opposite_points
from milkglass.core.light.maps import latlong_to_direction
from milkglass.viewer.assets.visibility import bake_visibility, refine
from milkglass.viewer.bench.lights import sky_pixels
from milkglass.viewer.passes.highlights import HighlightsPass, _packed
from milkglass.viewer.render.shading import Shading
from milkglass.viewer.scene.settings import MaterialSettings, SpecularSettings
from tests.support.occluding import around, highlights, places_of, rms, shaded_ball, write_probe
from tests.support.rendering import MeshRenderer, inside, scene_of
from tests.support.shapes import ball
from tests.support.solids import block, mesh_of

SHINY = SpecularSettings(strength=1.0, shininess=60.0)


@pytest.fixture(scope="module")
def sky(tmp_path_factory):
    return write_probe(tmp_path_factory.mktemp("probe") / "sky.exr", sky_pixels())


@pytest.fixture(scope="module")
def lit(context, sky):
    """A ball close above a slab in a sky: the renderer, the scene and its light."""
    renderer = MeshRenderer(context, shaded_ball())
    scene = replace(around(scene_of("camera.elevation_deg=20"), sky), specular=SHINY)
    return renderer, scene, renderer.light(scene)


def mirrored(normals, to_eye):
    return 2.0 * np.einsum("ij,ij->i", normals, to_eye)[:, None] * normals - to_eye


def test_the_shader_has_the_shares_of_core(context, lit):
    """At the mirrored ray itself, and near it to first order."""
    _, _, light = lit
    occlusion, lobes = light.occlusion, HighlightsPass(context)
    visibility, mesh = occlusion.baked.visibility, occlusion.baked.refined.mesh
    for shininess in (5.0, 60.0):
        buffer = lobes.run(occlusion, lobes.upload(visibility), shininess, light.camera)
        values = np.frombuffer(buffer.read(), np.float32).reshape(-1, 4).astype(float)
        to_eye = light.camera.eye[:3] - mesh.vertices
        to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
        normals = mesh.normals / np.linalg.norm(mesh.normals, axis=1, keepdims=True)
        some = np.flatnonzero(np.einsum("ij,ij->i", to_eye, normals) > 0.05)
        rays = mirrored(normals.astype(float), to_eye)
        at = values[:, 3] + np.einsum("ij,ij->i", values[:, :3], rays)
        expected = visibility.lobe_shares(rays, shininess)
        np.testing.assert_allclose(at[some], expected[some], atol=5e-3)
        assert expected[some].min() < 0.3
        turned = rays + np.random.default_rng(1).normal(0.0, 0.05, rays.shape)
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        linear = np.clip(values[:, 3] + np.einsum("ij,ij->i", values[:, :3], turned), 0.0, 1.0)
        exact = visibility.lobe_shares(turned, shininess)
        assert rms(linear[some], exact[some]) < 0.4 * rms(expected[some], exact[some])


def black(scene):
    """As it is, but dark inside: nothing of it is mirrored in itself."""
    return replace(scene, material=MaterialSettings(sigma_s_prime=(0.0,) * 3, sigma_a=(1.0,) * 3))


def test_highlights_are_those_of_rays(lit):
    renderer, scene, light = lit
    scene = black(scene)
    frame = renderer.render(scene, samples=1)
    seen = np.argwhere(inside(frame))
    seen = tuple(np.random.default_rng(3).choice(seen, 400, replace=False).T)
    points, normals = frame.position[seen].astype(float), frame.normal[seen].astype(float)
    to_eye = light.camera.eye[:3] - points
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    rays = mirrored(normals, to_eye)
    factor = 2.0 * np.pi / (SHINY.shininess + 1.0)
    expected = factor * highlights(renderer.model.mesh, places_of(points, normals), rays, sky_pixels(), SHINY.shininess)
    assert rms(frame.specular[seen], expected) < 0.10
    free = renderer.render(replace(scene, environment=replace(scene.environment, occluded=False)), samples=1)
    assert rms(free.specular[seen], expected) > 0.3


def test_highlights_turn_with_the_probe(context, tmp_path):
    """Radiance 1 + a . w has the mean 1 + (n + 1) / (n + 2) a . r in a lobe cos^n about r. A turn takes x to -z."""
    v, u = ((np.arange(n) + 0.5) / n for n in (64, 128))
    ways = latlong_to_direction(np.stack(np.meshgrid(u, v), axis=-1))
    renderer = MeshRenderer(context, ball())

    def specular(pixels, **settings):
        path = write_probe(tmp_path / f"{pixels[0, 0, 0]:.3f}.exr", pixels.astype(np.float32))
        scene = around(scene_of(), path, occluded=False, **settings)
        return renderer.render(replace(scene, specular=SHINY), samples=1)

    even, turned = specular(np.ones_like(ways)), specular(1.0 + 0.9 * ways, rotation_deg=90.0)
    seen = inside(even)
    to_eye = renderer.light(around(scene_of(), None)).camera.eye[:3] - even.position[seen]
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    rays = mirrored(even.normal[seen].astype(float), to_eye)
    expected = 1.0 + 0.9 * (SHINY.shininess + 1.0) / (SHINY.shininess + 2.0) * rays[:, [2, 1, 0]] * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(turned.specular[seen] / even.specular[seen], expected, atol=0.01)


def test_what_is_in_the_way_is_mirrored_as_bright_as_the_object(lit):
    renderer, scene, _ = lit
    frame, dark = (renderer.render(each, samples=1) for each in (scene, black(scene)))
    seen = inside(frame) & (frame.exitance.min(axis=-1) > 0.0)
    factor = 2.0 * np.pi / (SHINY.shininess + 1.0)
    blocked = (frame.specular - dark.specular)[seen] / (factor * frame.exitance[seen] / np.pi)
    assert np.ptp(blocked, axis=1).max() < 1e-2  # one share for all colours
    assert blocked.min() > -1e-2
    assert blocked.max() < 1.01
    assert (blocked > 0.9).any()
    assert np.median(blocked) < 0.5


@pytest.mark.slow
def test_a_convex_object_loses_no_highlight(context, sky):
    renderer = MeshRenderer(context, ball())
    scene = replace(around(scene_of(), sky), specular=SHINY)
    frames = [
        renderer.render(replace(scene, environment=replace(scene.environment, occluded=occluded)), samples=1)
        for occluded in (False, True)
    ]
    np.testing.assert_allclose(frames[1].specular, frames[0].specular, rtol=1e-5, atol=1e-7)


@pytest.mark.slow
def test_what_shows_no_highlight_evaluates_none(context, sky):
    renderer = MeshRenderer(context, ball())
    for scene in (
        replace(around(scene_of(), sky), specular=replace(SHINY, strength=0.0)),
        replace(around(scene_of(), sky, occluded=False), specular=SHINY),
        replace(scene_of(), specular=SHINY),
    ):
        renderer.render(scene, samples=1)
        assert not {"blocked highlights", "occluded highlights", "occlusion behind"} & set(renderer.timings)
    scene = replace(around(scene_of(), sky), specular=SHINY)
    for changed, runs in ((scene, True), (replace(scene, display=replace(scene.display, key=0.3)), False)):
        renderer.render(changed, samples=1)
        assert ("occluded highlights" in renderer.timings) is runs
    renderer.render(replace(scene, specular=replace(SHINY, shininess=20.0)), samples=1)
    assert "blocked highlights" not in renderer.timings
    assert "occluded highlights" in renderer.timings


def test_every_coefficient_has_a_place():
    blocked = np.arange(1, 82, dtype=np.float16)[None]
    assert np.count_nonzero(_packed(blocked)) == 81


def sheet_before_a_wall():
    """A sheet of 1 mm whose back side, in its middle, faces a near block."""
    return mesh_of(block((12.0, 12.0, 1.0)), block((9.0, 9.0, 2.0), (0.0, 0.0, -1.75)))


@pytest.mark.slow
def test_light_behind_a_sheet_is_that_of_its_other_side(context, tmp_path, monkeypatch):
    monkeypatch.setattr("milkglass.viewer.assets.visibility.LONGEST_EDGE", 0.1)
    monkeypatch.setattr("milkglass.core.light.bake.MIN_RAYS", 0)
    mesh = sheet_before_a_wall()
    baked = bake_visibility(refine(mesh))
    fine = baked.refined.mesh
    there = interpolated(*opposite_points(fine), fine.vertices)
    middle = (np.abs(fine.vertices[:, :2]).max(axis=1) < 3.0) & (fine.normals[:, 2] > 0.9) & (fine.vertices[:, 2] > 0)
    np.testing.assert_allclose(there[middle], fine.vertices[middle] - [0.0, 0.0, 1.0], atol=1e-3)

    # Front and back are white; little of the back's light comes in between sheet and block.
    front = np.zeros((32, 64, 3), np.float32)
    front[:, :16] = front[:, 48:] = 1.0
    small = "camera.azimuth_deg=0", "camera.elevation_deg=0", "display.image_size=[48, 48]"
    diffusion = "transport.resolution=20", "transport.method=diffusion", "transport.exchange=off"
    scene = scene_of(*small, *diffusion, "specular.strength=0")

    renderer = MeshRenderer(context, mesh)

    def exitance(pixels):
        path = write_probe(tmp_path / f"{pixels.mean():.2f}.exr", pixels)
        frame = renderer.render(around(scene, path), samples=1)
        return frame.exitance[(np.abs(frame.position[..., :2]).max(axis=-1) < 2.0) & inside(frame)]

    lit_in_front, lit_around = exitance(front), exitance(np.ones_like(front))
    monkeypatch.setattr(Shading, "_behind", lambda *_: None)
    renderer.stages.forget("composite")
    assert rms(lit_around, lit_in_front) < 0.5 * rms(exitance(np.ones_like(front)), lit_in_front)
