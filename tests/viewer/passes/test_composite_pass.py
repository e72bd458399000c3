"""What leaves the surface: F_t M / pi, highlights, coverage, antialiasing."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.material.fresnel import hemispherical_transmittance, transmittance
from milkglass.viewer.render.picture import Frame, PictureRequest, read_frame, read_image
from milkglass.viewer.scene.camera import pixel_offsets
from milkglass.viewer.scene.lights import DirectionalLight, PointLight
from tests.support.rendering import (
    BACK,
    FRONT,
    METHODS,
    OUTLIERS,
    MeshRenderer,
    RayCaster,
    inside,
    outliers,
    scene_of,
)
from tests.support.shapes import ball, plate

PROJECTIONS = ["camera.orthographic=true", "camera.orthographic=false"]
LAMPS = (
    DirectionalLight(FRONT, (3.0, 2.0, 1.0)),
    PointLight((60.0, 10.0, 80.0), (1e4, 2e4, 3e4)),
    DirectionalLight(BACK),
)
PARTS = ("position", "normal", "irradiance", "exitance", "subsurface", "specular")


def to_eye(renderer, scene, position):
    eye = renderer.light(scene).camera.eye
    towards = eye[:3] - eye[3] * position.astype(np.float64)
    return towards / np.linalg.norm(towards, axis=-1, keepdims=True)


def single_samples(renderer, scene, offsets) -> list[Frame]:
    """One frame a sample of the pixel."""
    lit = renderer.light(scene)
    gather = renderer.gather(lit, renderer.scatter(lit))
    requests = (PictureRequest((offset,), parts=True) for offset in offsets)
    return [read_frame(renderer.shade(scene, lit, gather, request), {}) for request in requests]


@pytest.mark.slow
@pytest.mark.parametrize("method", [*METHODS, "diffusion"])
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("eta", [1.0, 1.3, 1.5, 2.5])
def test_radiance_is_ft_times_exitance_by_its_normalisation(renderer_of, projection, eta, method):
    nodes = METHODS["ewald"] if method == "diffusion" else METHODS[method]
    scene = scene_of(projection, f"material.eta={eta}", *nodes, f"transport.method={method}", method="ewald")
    renderer = renderer_of("knot")
    frame = renderer.render(scene, samples=1)
    seen = frame.alpha == 1.0
    cosine = np.abs(np.einsum("ij,ij->i", frame.normal[seen], to_eye(renderer, scene, frame.position[seen])))
    expected = transmittance(eta, cosine)[:, None] * frame.exitance[seen]
    expected /= np.pi * (hemispherical_transmittance(eta) if method == "diffusion" else 1.0)
    # towards grazing F_t falls so steeply that float32 cosines tell
    assert outliers(frame.subsurface[seen], expected, rtol=1e-3, atol=1e-6) <= OUTLIERS


@pytest.mark.parametrize("shape", ["ball", "knot"])
@pytest.mark.parametrize("samples", [1, 4])
def test_radiance_is_the_sum_of_its_parts(renderer_of, shape, samples):
    frame = renderer_of(shape).render(scene_of(lights=LAMPS), samples=samples)
    np.testing.assert_allclose(frame.radiance, frame.subsurface + frame.specular, rtol=1e-5, atol=1e-7)
    for part in (frame.subsurface, frame.specular, frame.irradiance, frame.exitance):
        assert np.all(part >= 0.0)
        assert part.max() > 0.0
    nothing = frame.alpha == 0.0
    assert 0.2 < nothing.mean() < 0.8
    for name in ("radiance", *PARTS):
        assert np.all(getattr(frame, name)[nothing] == 0.0), name


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("light", LAMPS[:2], ids=["directional", "point"])
@pytest.mark.parametrize("shininess", [1.0, 20.0, 300.0])
def test_highlights_are_phongs(renderer_of, shapes, projection, light, shininess):
    """strength I max(0, r.l)^n on what faces the light and sees it; the ball hides nothing from itself."""
    renderer = renderer_of("ball")
    scene = scene_of(projection, f"specular.shininess={shininess}", "specular.strength=0.7", lights=(light,))
    frame = renderer.render(scene, samples=1)
    position, normal = frame.position.astype(np.float64), frame.normal.astype(np.float64)
    if isinstance(light, PointLight):
        away = np.array(light.position_mm) - position
        distance = np.linalg.norm(away, axis=-1, keepdims=True)
        to_light, arriving = away / distance, np.array(light.intensity) / distance**2
    else:
        to_light = np.broadcast_to(np.array(light.direction) / np.linalg.norm(light.direction), position.shape)
        arriving = np.broadcast_to(light.irradiance, position.shape)
    view = to_eye(renderer, scene, position)
    mirrored = 2.0 * np.einsum("...i,...i", normal, view)[..., None] * normal - view
    lobe = np.maximum(0.0, np.einsum("...i,...i", mirrored, to_light))
    facing = np.einsum("...i,...i", normal, to_light)
    expected = 0.7 * arriving * (lobe**shininess)[..., None]
    seen = inside(frame) & (np.abs(facing) > 0.08)  # off the terminator, where the shadow map filters
    expected[facing <= 0.0] = 0.0
    assert outliers(frame.specular[seen], expected[seen], rtol=2e-3, atol=1e-4 * expected[seen].max()) <= OUTLIERS


def test_highlights_add_up_and_scale(renderer_of):
    renderer = renderer_of("knot")
    each = [renderer.render(scene_of(lights=(light,)), samples=1).specular for light in LAMPS]
    together = renderer.render(scene_of(lights=LAMPS), samples=1).specular
    np.testing.assert_allclose(together, sum(each), rtol=1e-4, atol=1e-6)
    stronger = renderer.render(scene_of("specular.strength=0.6", lights=LAMPS), samples=1).specular
    np.testing.assert_allclose(stronger, 2.0 * together, rtol=1e-5, atol=1e-9)
    assert np.all(renderer.render(scene_of("specular.strength=0", lights=LAMPS), samples=1).specular == 0.0)


def test_shadows_hold_no_highlight(renderer_of, shapes):
    frame = renderer_of("knot").render(scene_of("specular.shininess=1"), samples=1)
    seen = inside(frame)
    rays = RayCaster(shapes["knot"])
    points, normals = frame.position[seen], frame.normal[seen]
    dark = rays.irradiance(points, normals, normals, DirectionalLight(FRONT), 1.5)[:, 0] == 0.0
    assert dark.sum() > 50
    assert np.mean(frame.specular[seen][dark].max(axis=1) > 1e-3) < 0.12  # the filtered edges of shadows
    assert np.median(frame.specular[seen][dark]) == 0.0


def test_alpha_is_the_share_of_samples_that_hit(renderer_of):
    renderer, scene = renderer_of("ball"), scene_of("display.image_size=[64, 64]")
    for samples in (1, 4, 8):
        alpha = renderer.render(scene, samples=samples).alpha
        np.testing.assert_allclose(alpha * samples, np.round(alpha * samples), atol=1e-4)
        assert alpha.max() == 1.0
        assert alpha[0, 0] == 0.0
    # zoom 1 frames the ball: its disc of pi / 4 of the picture
    assert alpha.mean() == pytest.approx(np.pi / 4.0, abs=0.01)


def test_antialiasing_is_the_mean_of_the_samples(renderer_of):
    """Radiance over the pixel, the other channels over its covered part."""
    renderer = renderer_of("knot")
    scene = scene_of("display.image_size=[64, 64]", lights=LAMPS)
    offsets = ((-0.4, 0.1), (0.0, -0.3), (0.45, 0.45))
    lit = renderer.light(scene)
    gather = renderer.gather(lit, renderer.scatter(lit))
    whole = read_frame(renderer.shade(scene, lit, gather, PictureRequest(offsets, parts=True)), {})
    each = single_samples(renderer, scene, offsets)
    for name in ("radiance", "subsurface", "specular"):
        mean = sum(getattr(one, name) for one in each) / 3
        np.testing.assert_allclose(getattr(whole, name), mean, rtol=1e-4, atol=1e-6, err_msg=name)
    hits = sum(one.alpha for one in each)
    np.testing.assert_allclose(whole.alpha, hits / 3, atol=1e-6)
    for name in ("position", "irradiance", "exitance"):
        mean = sum(getattr(one, name) for one in each) / np.maximum(hits, 1.0)[..., None]
        np.testing.assert_allclose(getattr(whole, name), mean, rtol=1e-4, atol=1e-4, err_msg=name)
    lengths = np.linalg.norm(whole.normal[whole.alpha > 0.0], axis=1)
    np.testing.assert_allclose(lengths, 1.0, atol=1e-4)


def test_an_offset_of_a_pixel_is_a_shift_by_a_pixel(renderer_of):
    """Rightwards and upwards, for the picture; rows run down."""
    centre, moved = single_samples(renderer_of("knot"), scene_of(), ((0.0, 0.0), (1.0, 2.0)))
    a, b = moved.alpha[:-2, 1:], centre.alpha[2:, :-1]
    assert np.mean(a != b) < 2e-3
    both = inside(replace(centre, alpha=centre.alpha))[2:, :-1] & (a == 1.0)
    assert outliers(moved.radiance[:-2, 1:][both], centre.radiance[2:, :-1][both], rtol=5e-3, atol=1e-3) < 0.02


def test_the_picture_does_not_depend_on_keeping_the_parts(renderer_of):
    renderer, scene = renderer_of("knot"), scene_of(lights=LAMPS)
    with_parts = renderer.render(scene, samples=2).image
    without = renderer.draw(scene, PictureRequest(pixel_offsets(2)))
    assert list(without.composite.textures) == ["radiance"]
    np.testing.assert_array_equal(read_image(without), with_parts)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 7])
def test_a_seed_gives_the_same_bits_again(context, shapes, renderer_of, seed):
    first = renderer_of("cube").render(scene_of(), samples=4, seed=seed)
    second = MeshRenderer(context, shapes["cube"]).render(scene_of(), samples=4, seed=seed)
    for name in ("radiance", "alpha", "image"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_a_rim_mirrors_what_is_seen_beside_it(renderer_of):
    """A ball before a plate, lit by a lamp alone: what a ray that grazes meets, with Fresnel's share, as if traced."""
    before, behind = ball(20.0), plate(60.0, 4.0)
    vertices = np.concatenate([before.vertices, behind.vertices - [0.0, 0.0, 25.0]])
    faces = np.concatenate([before.faces, behind.faces + len(before.vertices)])
    renderer = renderer_of(Mesh.of(vertices, np.concatenate([before.normals, behind.normals]), faces))
    front = (
        "camera.orthographic=true",
        "camera.azimuth_deg=0",
        "camera.zoom=2",
        "camera.elevation_deg=0",
        "display.image_size=[256, 256]",
    )
    frame = renderer.render(scene_of(*front, "material.eta=1.5", method="ewald"), samples=1)
    cosine = frame.normal[..., 2].astype(np.float64)
    rim = inside(frame) & (frame.position[..., 2] > -10.0) & (cosine > 0.05) & (cosine < 0.25)
    normal, position = frame.normal[rim].astype(np.float64), frame.position[rim].astype(np.float64)
    ray = 2.0 * cosine[rim][:, None] * normal - [0.0, 0.0, 1.0]
    met = position + (position[:, 2:] + 23.0) / -ray[:, 2:] * ray
    shown = np.stack(np.nonzero(frame.alpha), axis=1), frame.position[frame.alpha > 0.0][:, [1, 0]]
    lines = [np.polyfit(place, pixel, 1) for pixel, place in zip(shown[0].T, shown[1].T, strict=True)]
    row, column = (
        np.rint(np.polyval(line, met[:, axis])).astype(int) for line, axis in zip(lines, (1, 0), strict=True)
    )
    there = frame.exitance[row, column]
    leaving = transmittance(1.5, -ray[:, 2])[:, None] * there / np.pi
    expected = (1.0 - transmittance(1.5, cosine[rim]))[:, None] * leaving
    difference = np.abs(frame.specular[rim] - expected)[:, 0] / expected[:, 0]
    assert rim.sum() > 300
    assert np.median(difference) < 0.03
    assert np.quantile(difference, 0.9) < 0.1
