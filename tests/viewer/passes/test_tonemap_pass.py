"""The display transform on the GPU against float64."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from milkglass.core import display as tonemap
from milkglass.core.light import probe as environment
from milkglass.core.light.probe import Probe
from milkglass.viewer.display.registry import TRANSFORMS, transform
from milkglass.viewer.files.images import write_exr
from milkglass.viewer.gl.context import float_texture, latlong_texture
from milkglass.viewer.passes.tonemap import Background, TonemapPass
from milkglass.viewer.scene.camera import place_camera
from milkglass.viewer.scene.scene import EnvironmentSettings
from milkglass.viewer.scene.settings import CameraSettings, DisplaySettings
from tests.support.rendering import scene_of

PAPER = partial(DisplaySettings, key=0.18, transform="photographic")
SIZES = [(64, 48), (17, 33), (16, 16)]


@pytest.fixture(scope="module")
def tonemap_pass(context):
    return TonemapPass(context)


def hdr(size, seed=0, coverage=True):
    """(height, width, 4) float32: radiance over six decades, weighted by its coverage; rows bottom up, as in GL."""
    rng = np.random.default_rng(seed)
    width, height = size
    pixels = np.empty((height, width, 4), np.float32)
    pixels[..., :3] = 10.0 ** rng.uniform(-4.0, 2.0, (height, width, 1)) * rng.random((height, width, 3))
    pixels[..., 3] = rng.choice([0.0, 0.25, 0.5, 1.0], (height, width)) if coverage else 1.0
    pixels[..., :3] *= pixels[..., 3:]
    return pixels


def uploaded(context, pixels):
    texture = float_texture(context, pixels.shape[1::-1])
    texture.write(np.ascontiguousarray(pixels))
    return texture


def divided(pixels):
    alpha = pixels[..., 3].astype(np.float64)
    return pixels[..., :3] / np.where(alpha > 0.0, alpha, 1.0)[..., None], alpha


def shown(context, tonemap_pass, pixels, log_average, display, background=None, camera=None):
    """Bytes of the picture, (height, width, 4), rows bottom up."""
    size = pixels.shape[1::-1]
    background = background or Background(latlong_texture(context, np.zeros((1, 1, 3), np.float32)), 0.0, 0.0)
    camera = camera or place_camera(CameraSettings(), 50.0, size)
    out = context.simple_framebuffer(size, 4)
    tonemap_pass.render(uploaded(context, pixels), log_average, display, background, camera, out)
    return np.frombuffer(out.read(components=4, alignment=1), np.uint8).reshape(size[1], size[0], 4)


def as_bytes(srgb):
    return 255.0 * srgb


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_the_log_average_is_the_references(context, tonemap_pass, size):
    """Also where the picture is no multiple of the tiles that are summed."""
    pixels = hdr(size)
    rgb, alpha = divided(pixels)
    expected = tonemap.log_average(tonemap.brightest(rgb), alpha)
    assert tonemap_pass.log_average(uploaded(context, pixels)) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_the_log_average_scales_with_light(context, tonemap_pass, scale):
    pixels = hdr((64, 48))
    unit = tonemap_pass.log_average(uploaded(context, pixels))
    pixels[..., :3] *= np.float32(scale)
    assert tonemap_pass.log_average(uploaded(context, pixels)) == pytest.approx(scale * unit, rel=1e-4)


@pytest.mark.parametrize("coverage", [0.0, 1.0])
def test_nothing_lit_has_no_average_and_is_black(context, tonemap_pass, coverage):
    pixels = np.zeros((16, 16, 4), np.float32)
    pixels[..., 3] = coverage
    assert tonemap_pass.log_average(uploaded(context, pixels)) == 0.0
    assert np.all(shown(context, tonemap_pass, pixels, 0.0, DisplaySettings())[..., :3] == 0)


@pytest.mark.parametrize(("key", "white"), [(0.18, 3.0), (1.0, 0.5), (0.02, 100.0)])
def test_the_transform_is_the_references(context, tonemap_pass, key, white):
    pixels = hdr((64, 48), coverage=False)
    average = tonemap.log_average(tonemap.brightest(pixels[..., :3]), pixels[..., 3])
    expected = tonemap.srgb(tonemap.tone_map(pixels[..., :3], key / average, white))
    actual = shown(context, tonemap_pass, pixels, average, PAPER(key=key, white=white))
    assert np.abs(actual[..., :3] - as_bytes(expected)).max() <= 0.51
    assert np.all(actual[..., 3] == 255)
    assert len(np.unique(actual[..., :3])) > 100


def in_range(shape, least=0.1, seed=4):
    """Colours as objects have them: exposed radiance over four decades, no channel below `least` of the brightest."""
    rng = np.random.default_rng(seed)
    pixels = np.ones((*shape, 4), np.float32)
    pixels[..., :3] = 10.0 ** rng.uniform(-3.0, 1.0, (*shape, 1)) * rng.uniform(least, 1.0, (*shape, 3))
    return pixels


@pytest.mark.parametrize("name", [name for name in TRANSFORMS if not transform(name).in_shader])
def test_a_table_in_the_shader_is_the_transform(context, tonemap_pass, name):
    """Within one of 255 over rounding for colours of objects; where gamuts clip saturated ones, within a few."""
    for least, most in ((0.1, 1.8), (0.0, 4.5)):
        pixels = in_range((200, 300), least)
        expected = as_bytes(transform(name).encoded(pixels[..., :3], 3.0))
        actual = shown(context, tonemap_pass, pixels, 1.0, DisplaySettings(key=1.0, transform=name))
        off = np.abs(actual[..., :3] - expected).max(axis=-1)
        assert np.mean(off <= 0.5 + 1.0) > 0.998
        assert off.max() <= 0.5 + most
        assert off.mean() < 0.5
        assert len(np.unique(actual[..., :3])) > 200


@pytest.mark.parametrize("name", TRANSFORMS)
def test_a_stop_is_a_factor_of_two(context, tonemap_pass, name):
    pixels = in_range((32, 32))
    doubled = shown(context, tonemap_pass, pixels, 1.0, DisplaySettings(key=0.5, exposure=1.0, transform=name))
    expected = shown(context, tonemap_pass, pixels, 1.0, DisplaySettings(key=1.0, transform=name))
    np.testing.assert_array_equal(doubled, expected)


@pytest.mark.parametrize("name", TRANSFORMS)
def test_what_is_no_light_is_black_and_what_is_too_much_is_bright(context, tonemap_pass, name):
    """NaN, negative radiance and infinity reach no picture as such, and do not touch their neighbours' exposure."""
    pixels = np.ones((16, 16, 4), np.float32)
    for i, value in enumerate([np.nan, -1.0, -np.inf, np.inf, 3e38]):
        pixels[i, 0, :3] = value
        pixels[i, 1, 0] = value
    display = DisplaySettings(key=0.18, transform=name)
    assert tonemap_pass.log_average(uploaded(context, pixels[:4])) == pytest.approx(1.0, rel=0.02)
    actual = shown(context, tonemap_pass, pixels, 1.0, display)
    as_black = shown(context, tonemap_pass, np.where(pixels > 0.0, pixels, 0.0).astype(np.float32), 1.0, display)
    assert np.all(actual[:3, 0, :3] == 0)
    np.testing.assert_array_equal(actual[:3, 1], as_black[:3, 1])
    assert actual[3:5, 0, :3].min() > 250
    assert actual[3:5, 1, 0].min() > 240
    assert np.ptp(actual[6:].reshape(-1, 4), axis=0).max() == 0


def test_white_is_what_becomes_white(context, tonemap_pass):
    """A grey of scaled luminance `white` maps to 1, a little less does not."""
    pixels = np.ones((16, 16, 4), np.float32)
    pixels[:, 8:, :3] = 0.97
    display = PAPER(key=3.0, white=3.0)
    actual = shown(context, tonemap_pass, pixels, 1.0, display)
    assert np.all(actual[:, :8, :3] == 255)
    assert np.all(actual[:, 8:, :3] < 255)


@pytest.mark.parametrize("name", ["black", "#000000", "#ffffff", "#336699", "#01f80A"])
def test_a_colour_behind_the_object_keeps_its_bytes(context, tonemap_pass, name):
    pixels = np.zeros((16, 16, 4), np.float32)
    actual = shown(context, tonemap_pass, pixels, 1.0, PAPER(background=name))
    expected = bytes.fromhex("000000" if name == "black" else name[1:])
    assert np.all(actual == np.frombuffer(expected + b"\xff", np.uint8))


@pytest.mark.parametrize("name", ["black", "#336699", "transparent"])
def test_a_partly_covered_pixel_mixes_in_linear_light(context, tonemap_pass, name):
    pixels = hdr((64, 48), seed=3)
    rgb, alpha = divided(pixels)
    average = tonemap.log_average(tonemap.brightest(rgb), alpha)
    object_ = np.clip(tonemap.tone_map(rgb, 0.18 / average, 3.0), 0.0, 1.0)
    actual = shown(context, tonemap_pass, pixels, average, PAPER(background=name))
    if name == "transparent":  # the object's own colour, and its coverage apart
        seen = alpha > 0.0
        assert np.abs(actual[seen, :3] - as_bytes(tonemap.srgb(object_[seen]))).max() <= 0.51
        assert np.abs(actual[..., 3] - as_bytes(alpha)).max() <= 0.51
        return
    encoded = np.zeros(3) if name == "black" else np.frombuffer(bytes.fromhex(name[1:]), np.uint8) / 255.0
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    mixed = alpha[..., None] * object_ + (1.0 - alpha[..., None]) * linear
    assert np.abs(actual[..., :3] - as_bytes(tonemap.srgb(mixed))).max() <= 0.51


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("rotation", [0.0, 75.0])
def test_the_probe_stands_behind_the_object(context, tonemap_pass, orthographic, rotation):
    """Each pixel looks the probe up along its own ray, tone-mapped with the object's exposure."""
    size = (48, 32)
    probe = Probe.from_pixels(np.random.default_rng(1).random((16, 32, 3), np.float32))
    camera = place_camera(CameraSettings(30.0, 20.0, 10.0, 60.0, 1.0, orthographic), 50.0, size)
    background = Background(latlong_texture(context, probe.latlong), rotation, 2.0)
    display = PAPER(background="environment")
    actual = shown(context, tonemap_pass, np.zeros((32, 48, 4), np.float32), 0.3, display, background, camera)

    x, y = np.meshgrid((np.arange(48) + 0.5) / 24 - 1.0, (np.arange(32) + 0.5) / 16 - 1.0)
    ones = np.ones_like(x)
    ends = [np.stack([x, y, z * ones, ones], axis=-1) @ np.linalg.inv(camera.world_to_clip) for z in (-1.0, 1.0)]
    near, far = (end[..., :3] / end[..., 3:] for end in ends)
    ray = (far - near) / np.linalg.norm(far - near, axis=-1, keepdims=True)
    a = np.radians(rotation)
    ray = ray @ np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])  # R_y(-a) of a row
    # texel centres lie at (i + 1/2) / h: not at the poles, as in a table of irradiance
    u, v = np.moveaxis(environment.direction_to_latlong(ray), -1, 0)
    radiance = 2.0 * bilinear(probe.latlong.astype(np.float64), u, v)
    expected = tonemap.srgb(tonemap.tone_map(radiance, 0.18 / 0.3, 3.0))
    assert np.abs(actual[..., :3] - as_bytes(expected)).max() <= 1.5
    if orthographic:
        assert np.ptp(actual.reshape(-1, 4).astype(int), axis=0).max() <= 1


def bilinear(pixels, u, v):
    height, width, _ = pixels.shape
    x, y = u * width - 0.5, v * height - 0.5
    i, j = np.floor(y).astype(int), np.floor(x).astype(int)
    fy, fx = (y - i)[..., None], (x - j)[..., None]
    rows, columns = (np.clip(i + k, 0, height - 1) for k in (0, 1)), ((j + k) % width for k in (0, 1))
    (i0, i1), (j0, j1) = rows, columns
    upper = (1 - fx) * pixels[i0, j0] + fx * pixels[i0, j1]
    return (1 - fy) * upper + fy * ((1 - fx) * pixels[i1, j0] + fx * pixels[i1, j1])


@pytest.mark.parametrize("name", TRANSFORMS)
@pytest.mark.parametrize("background", ["#336699", "transparent"])
def test_pixels_that_the_object_has_to_itself_are_as_if_they_were_mixed(context, tonemap_pass, name, background):
    """Another program draws those, over the object's depth, whose colours take no way through linear light."""
    pixels = in_range((32, 32))
    pixels[:, 16:] = 0.0
    radiance, camera = uploaded(context, pixels), place_camera(CameraSettings(), 50.0, (32, 32))
    display, seen = DisplaySettings(key=1.0, transform=name, background=background), []
    for beside_depth in (False, True):
        target = context.framebuffer([context.texture((32, 32), 4)], context.depth_renderbuffer((32, 32)))
        target.clear(depth=1.0)
        target.clear(depth=0.5, viewport=(0, 0, 16, 32))  # the object
        target.depth_mask = False
        behind = Background(radiance, 0.0, 0.0, beside_depth)
        tonemap_pass.render(radiance, 1.0, display, behind, camera, target)
        seen.append(np.frombuffer(target.read(components=4), np.uint8).reshape(32, 32, 4).astype(int))
    assert np.abs(seen[0] - seen[1]).max() <= 1
    assert np.ptp(seen[1][:, :16, :3]) > 100


# In whole frames


def test_a_frame_is_exposed_for_the_object_alone(renderer_of):
    """The log-average weighs pixels by coverage, so empty surroundings do not brighten the object."""
    renderer = renderer_of("ball")
    for zoom in (1.0, 0.5):
        frame = renderer.render(scene_of(f"camera.zoom={zoom}"), samples=2)
        seen = frame.alpha > 0.0
        rgb = frame.radiance[seen].astype(np.float64) / frame.alpha[seen, None]
        average = tonemap.log_average(tonemap.brightest(rgb), frame.alpha[seen])
        expected = tonemap.srgb(tonemap.tone_map(rgb, 0.18 / average, 3.0))
        whole = frame.alpha[seen] == 1.0
        assert np.abs(frame.image[seen][whole] - as_bytes(expected[whole])).max() <= 0.6


@pytest.mark.slow
def test_the_background_does_not_touch_the_object(renderer_of, few_rays, tmp_path):
    pixels = np.random.default_rng(2).random((16, 32, 3), np.float32)
    write_exr(tmp_path / "probe.exr", dict(zip("RGB", np.moveaxis(pixels, -1, 0), strict=True)))
    renderer = renderer_of("knot")
    lit = replace(scene_of(), environment=EnvironmentSettings(tmp_path / "probe.exr"))
    images = {}
    for name in ("black", "#102030", "transparent", "environment"):
        frame = renderer.render(replace(lit, display=replace(lit.display, background=name)), samples=2)
        images[name] = frame.image
        np.testing.assert_array_equal(frame.image[frame.alpha == 1.0, :3], images["black"][frame.alpha == 1.0])
    assert images["transparent"].shape[2] == 4
    np.testing.assert_allclose(images["transparent"][..., 3], 255.0 * frame.alpha, atol=0.51)
    empty = frame.alpha == 0.0
    assert np.all(images["black"][empty] == 0)
    assert np.all(images["#102030"][empty] == [0x10, 0x20, 0x30])
    assert np.all(images["transparent"][empty] == 0)
    assert images["environment"][empty].std() > 5.0
