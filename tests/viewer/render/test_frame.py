"""The whole pipeline: invariants, what reruns when, and what the finished frame holds."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core import display
from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.viewer.files import images
from milkglass.viewer.render.renderer import render, render_image
from milkglass.viewer.scene.lights import DirectionalLight, PointLight
from milkglass.viewer.scene.scene import CameraSettings, MaterialSettings, SpecularSettings, apply_set
from tests.support.rendering import BACK, FRONT, METHODS, MeshRenderer, inside, outliers, relative_rms, scene_of

LAMPS = (DirectionalLight(FRONT, (3.0, 2.0, 1.0)), PointLight((-40.0, 30.0, -60.0), (2e4, 3e4, 4e4)))
CHANNELS = [
    *"RGBA",
    "depth.Z",
    *(f"{layer}.{axis}" for layer in ("position", "normal") for axis in "XYZ"),
    *(
        f"{layer}.{colour}"
        for layer in ("irradiance", "exitance", "subsurface", "specular", "unscattered", "scattered")
        for colour in "RGB"
    ),
]
EDGE_PIXELS = 5e-3  # share of the pixels that rounding may put on the other side of the outline


def scaled(light, s):
    if isinstance(light, DirectionalLight):
        return replace(light, irradiance=tuple(s * c for c in light.irradiance))
    return replace(light, intensity=tuple(s * c for c in light.intensity))


# Invariants


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shape", ["knot", "plate"])
def test_the_picture_is_linear_in_light(renderer_of, shape, method):
    renderer = renderer_of(shape)
    a, b = (renderer.render(scene_of(method=method, lights=(light,)), samples=1) for light in LAMPS)
    together = renderer.render(scene_of(method=method, lights=(LAMPS[0], scaled(LAMPS[1], 5.0))), samples=1)
    for name in ("radiance", "irradiance", "exitance", "subsurface", "specular"):
        expected = getattr(a, name).astype(np.float64) + 5.0 * getattr(b, name)
        np.testing.assert_allclose(
            getattr(together, name), expected, rtol=1e-4, atol=1e-5 * expected.max(), err_msg=name
        )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("s", [1e-6, 1e6])
def test_the_image_does_not_depend_on_the_unit_of_light(renderer_of, s, method):
    renderer = renderer_of("knot")
    one = renderer.render(scene_of(method=method, lights=LAMPS), samples=2)
    other = renderer.render(scene_of(method=method, lights=tuple(scaled(light, s) for light in LAMPS)), samples=2)
    np.testing.assert_allclose(other.radiance, s * one.radiance, rtol=1e-4, atol=1e-5 * s * one.radiance.max())
    assert np.abs(other.image.astype(int) - one.image).max() <= 1


def test_pictures_of_a_series_have_one_exposure(renderer_of):
    """A radiance has the same colour in each, however bright the others are: tone map of (key 2^stops / average) L."""
    renderer = renderer_of("knot")
    series = ("display.average=0.2", "display.exposure=-1", "display.transform=photographic")
    for s in (0.3, 1.0, 4.0):
        scene = apply_set(scene_of(lights=tuple(scaled(light, s) for light in LAMPS)), series)
        frame = renderer.render(scene, samples=1)
        inner, exposure = frame.alpha == 1.0, scene.display.key * 0.5 / 0.2
        expected = display.srgb(display.tone_map(frame.radiance[inner], exposure, scene.display.white))
        assert np.abs(frame.image[inner] - 255.0 * expected).max() <= 1.0
        automatic = replace(scene, display=replace(scene.display, average=None))
        kept = replace(scene, display=replace(scene.display, average=frame.log_average))
        assert np.array_equal(renderer.render(kept, samples=1).image, renderer.render(automatic, samples=1).image)


@pytest.mark.slow
@pytest.mark.parametrize("s", [1e-3, 0.1, 30.0, 1e3])
@pytest.mark.parametrize("method", METHODS)
def test_a_larger_object_of_a_thinner_material_looks_the_same(context, renderer_of, shapes, s, method):
    """Object x s, coefficients / s, lamps s times as far and s^2 times as strong."""
    sigma_s_prime, sigma_a = (2.62, 1.5, 0.4), (0.0041, 0.05, 0.2)
    coefficients = MaterialSettings(sigma_s_prime=sigma_s_prime, sigma_a=sigma_a, eta=1.4)
    one = renderer_of("knot").render(replace(scene_of(method=method, lights=LAMPS), material=coefficients), samples=1)
    thinner = replace(
        coefficients, sigma_s_prime=tuple(c / s for c in sigma_s_prime), sigma_a=tuple(c / s for c in sigma_a)
    )
    point = LAMPS[1]
    far = replace(
        point, position_mm=tuple(s * p for p in point.position_mm), intensity=tuple(s * s * i for i in point.intensity)
    )
    knot = shapes["knot"]
    larger = MeshRenderer(context, Mesh(knot.vertices * np.float32(s), knot.normals, knot.faces))
    other = larger.render(replace(scene_of(method=method, lights=(LAMPS[0], far)), material=thinner), samples=1)
    assert np.mean(one.alpha != other.alpha) < EDGE_PIXELS
    both = inside(one) & inside(other)
    np.testing.assert_allclose(other.position[both] / s, one.position[both], atol=2e-3)
    assert np.all(relative_rms(other.exitance[both], one.exitance[both]) < 1e-3)
    assert outliers(other.radiance[both], one.radiance[both], rtol=5e-3, atol=1e-3) < 5e-3


@pytest.mark.parametrize("turns", [1, 2, 3])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shape", ["knot", "cube"])
def test_rolling_the_camera_turns_the_picture(renderer_of, shape, method, turns):
    """And nothing else: the layers turn along, node on node, or stay with the object."""
    renderer, scene = renderer_of(shape), scene_of("camera.elevation_deg=25", method=method, lights=LAMPS)
    upright = renderer.render(scene, samples=1)
    rolled = renderer.render(replace(scene, camera=replace(scene.camera, roll_deg=90.0 * turns)), samples=1)
    assert np.mean(np.rot90(upright.alpha, turns) != rolled.alpha) < EDGE_PIXELS
    both = np.rot90(inside(upright), turns) & inside(rolled)
    for name in ("exitance", "radiance"):
        expected = np.rot90(getattr(upright, name), turns)[both]
        assert outliers(getattr(rolled, name)[both], expected, rtol=2e-3, atol=1e-3 * expected.max()) < 5e-3, name


@pytest.mark.parametrize("azimuth", [20.0, 200.0])
def test_a_half_turn_of_everything_changes_nothing(renderer_of, azimuth):
    """The plate maps onto itself by a half turn about y; lights and camera turn along."""
    renderer = renderer_of("plate")
    turned = tuple(replace(light, direction=tuple(np.array(light.direction) * [-1, 1, -1])) for light in LAMPS[:1])
    one = renderer.render(scene_of(f"camera.azimuth_deg={azimuth}", lights=LAMPS[:1]), samples=1)
    other = renderer.render(scene_of(f"camera.azimuth_deg={azimuth - 180.0}", lights=turned), samples=1)
    both = inside(one) & inside(other)
    assert np.all(relative_rms(other.radiance[both], one.radiance[both]) < 2e-3)


def test_the_image_has_its_size_and_its_first_row_on_top(renderer_of):
    frame = renderer_of("plate").render(scene_of("display.image_size=[96, 40]", "camera.azimuth_deg=0"), samples=1)
    assert frame.image.shape == (40, 96, 3)
    rows, columns = np.nonzero(frame.alpha == 1.0)
    top, bottom = rows.argmin(), rows.argmax()
    assert frame.position[rows[top], columns[top], 1] > frame.position[rows[bottom], columns[bottom], 1]
    left, right = columns.argmin(), columns.argmax()
    assert frame.position[rows[left], columns[left], 0] < frame.position[rows[right], columns[right], 0]


def test_pixels_lie_where_the_camera_sees_them(renderer_of):
    renderer, scene = renderer_of("knot"), scene_of("display.image_size=[96, 64]", "camera.roll_deg=10")
    frame, camera = renderer.render(scene, samples=1), renderer.light(scene).camera
    rows, columns = np.nonzero(frame.alpha == 1.0)
    clip = np.c_[frame.position[rows, columns], np.ones(len(rows))] @ camera.world_to_clip
    x, y = (clip[:, :2] / clip[:, 3:]).T
    np.testing.assert_allclose((x + 1.0) * 48.0, columns + 0.5, atol=0.02)
    np.testing.assert_allclose((1.0 - y) * 32.0, rows + 0.5, atol=0.02)


# Only what changed


SHADING = {"gbuffer", "composite", "exposure", "tone map"}
RELIT = {"flux", "deposit", "convolution", "layer volume"}
LOCAL = {"pixel terms", "pixel tables"}
PLACED = {"layer depth", "weights", "deposit", "spectra", "convolution", "layer volume"} | LOCAL
IRRADIANCE = {"irradiance of light 1", "irradiance of light 2"}


@pytest.mark.parametrize(
    ("assignment", "expected"),
    [
        ("specular.strength=0.3", set()),
        ("display.key=0.4", {"tone map"}),
        ("display.white=5", {"tone map"}),
        ('display.background="#123456"', {"tone map"}),
        ("specular.strength=0.1", SHADING - {"gbuffer"}),
        ("specular.shininess=12", SHADING - {"gbuffer"}),
        ("material.name=cream", SHADING - {"gbuffer"} | {"spectra", "convolution", "layer volume"} | LOCAL),
        ("material.eta=1.7", SHADING - {"gbuffer"} | {"spectra"} | LOCAL | IRRADIANCE | RELIT),
        ("camera.zoom=2", SHADING),
        ("camera.azimuth_deg=50", SHADING | PLACED),
        ("transport.layers=5", SHADING - {"gbuffer"} | PLACED | {"transport"}),
        (
            "transport.resolution=32",
            SHADING - {"gbuffer"} | PLACED | {"transport", "samples", "sample buffers"} | IRRADIANCE | RELIT,
        ),
    ],
)
def test_a_stage_runs_only_when_needed(renderer_of, assignment, expected):
    renderer = renderer_of("cube")
    before = scene_of("material.name=wholemilk", lights=LAMPS)
    renderer.render(before, samples=1)
    renderer.render(apply_set(before, [assignment]), samples=1)
    assert set(renderer.timings) == expected
    assert all(ms >= 0.0 for ms in renderer.timings.values())


def test_orbiting_convolves_nothing_where_the_layers_are_the_objects(renderer_of):
    """Ewald's layers do not turn with the camera."""
    renderer = renderer_of("cube")
    renderer.render(scene_of(method="ewald"), samples=1)
    renderer.render(scene_of("camera.azimuth_deg=50", method="ewald"), samples=1)
    assert set(renderer.timings) == SHADING


def test_a_brighter_light_reruns_its_own_irradiance(renderer_of):
    renderer = renderer_of("cube")
    renderer.render(scene_of(lights=LAMPS), samples=1)
    renderer.render(scene_of(lights=(LAMPS[0], scaled(LAMPS[1], 2.0))), samples=1)
    expected = {"light 2", "irradiance of light 2"} | RELIT | SHADING - {"gbuffer"}
    assert set(renderer.timings) == expected


def test_a_new_image_size_keeps_the_light(renderer_of):
    renderer = renderer_of("cube")
    renderer.render(scene_of(), samples=1)
    renderer.render(scene_of("display.image_size=[64, 64]"), samples=1)
    targets = {"depth", "gbuffer targets", "light targets", "composite targets", "image"}
    assert set(renderer.timings) == SHADING | targets


@pytest.mark.slow
def test_a_kept_renderer_draws_what_a_new_one_draws(context, renderer_of, shapes):
    """Nothing of an earlier scene shows: the same bits after a detour through every kind of change."""
    renderer, scene = renderer_of("cube"), scene_of("camera.elevation_deg=30", lights=LAMPS)
    renderer.render(scene, samples=2)
    detours = ["display.key=1", "material.name=ketchup", "camera.azimuth_deg=99", "transport.layers=3", "camera.zoom=3"]
    detours += ["display.image_size=[40, 80]", "transport.resolution=20", "specular.shininess=3"]
    for assignment in [*detours, "transport.method=ewald"]:
        renderer.render(apply_set(scene, [assignment]), samples=1)
    renderer.render(replace(scene, lights=()), samples=1)
    again, fresh = renderer.render(scene, samples=2), MeshRenderer(context, shapes["cube"]).render(scene, samples=2)
    for name in ("radiance", "image", "exitance", "irradiance", "specular", "position", "normal", "alpha"):
        np.testing.assert_array_equal(getattr(again, name), getattr(fresh, name), err_msg=name)


def test_a_frame_lists_the_stages_in_the_order_of_the_pipeline(context, shapes):
    frame = MeshRenderer(context, shapes["cube"]).render(scene_of(), samples=1)
    order = ["model", "samples", "shadow of light 1", "irradiance of light 1", "flux", "layer depth"]
    assert [name for name in frame.timings if name in order] == order
    order = ["weights", "deposit", "spectra", "convolution"]
    assert [name for name in frame.timings if name in order] == order


def test_progress_is_told_once_a_step(renderer_of):
    said = []
    renderer_of("cube").render(scene_of(), samples=1, progress=said.append)
    assert said[0] == "loading the model"
    assert said[-1] == "drawing"
    assert len(said) == len(set(said))


# No light


@pytest.mark.parametrize("lights", [(), (DirectionalLight(FRONT, (0.0, 0.0, 0.0)),)], ids=["none", "black"])
def test_no_light_is_black_and_finite(renderer_of, lights):
    frame = renderer_of("knot").render(scene_of(lights=lights), samples=2)
    assert np.all(frame.image == 0)
    for name in ("radiance", "irradiance", "exitance", "subsurface", "specular"):
        assert np.all(getattr(frame, name) == 0.0), name
    assert frame.alpha.max() == 1.0


# Files


def test_an_exr_holds_every_channel(renderer_of, tmp_path):
    frame = renderer_of("knot").render(scene_of(lights=LAMPS), samples=4)
    frame.save(tmp_path / "frame.exr")
    channels = images.read_channels(tmp_path / "frame.exr")
    assert sorted(channels) == sorted(CHANNELS)
    assert list(channels)[:4] == list("RGBA")
    assert all(plane.dtype == np.float32 and plane.shape == (128, 128) for plane in channels.values())
    empty = channels["A"] == 0.0
    assert 0.1 < empty.mean() < 0.9
    for name, plane in channels.items():
        assert np.all(plane[empty] == 0.0), name
        assert np.all(np.isfinite(plane)), name
        np.testing.assert_array_equal(plane, frame.channels()[name])
    for i, colour in enumerate("RGB"):
        np.testing.assert_array_equal(channels[colour], frame.radiance[..., i])
        np.testing.assert_array_equal(channels[f"irradiance.{colour}"], frame.irradiance[..., i])
    np.testing.assert_array_equal(channels["position.Z"], frame.position[..., 2])


@pytest.mark.parametrize(("background", "components"), [("black", 3), ("#204060", 3), ("transparent", 4)])
def test_a_png_is_the_image(renderer_of, tmp_path, background, components):
    frame = renderer_of("knot").render(scene_of(f'display.background="{background}"'), samples=4)
    frame.save(tmp_path / "frame.png")
    pixels = images.read_image(tmp_path / "frame.png")
    assert pixels.shape == (128, 128, components)
    np.testing.assert_array_equal(pixels, frame.image)
    if components == 4:
        np.testing.assert_allclose(pixels[..., 3] / 255.0, frame.alpha, atol=0.51 / 255.0)
        assert 0 < np.count_nonzero((pixels[..., 3] > 0) & (pixels[..., 3] < 255)) < 4000


@pytest.mark.slow
def test_the_python_interface_of_the_readme(context, tmp_path, monkeypatch):
    """`import milkglass as mg` and a scene of dataclasses."""
    from milkglass import Frame, Scene, render
    from milkglass.viewer.render import renderer as frame_module

    monkeypatch.setattr(frame_module, "headless_context", lambda: context)
    scene = Scene(
        camera=CameraSettings(zoom=1.5),
        material=MaterialSettings(name="jade"),
        specular=SpecularSettings(strength=0.0),
        lights=(DirectionalLight(BACK),),
        display=scene_of().display,
        transport=scene_of().transport,
    )
    frame = render(scene, samples=1)
    assert isinstance(frame, Frame)
    assert frame.warnings == ()
    assert frame.image.std() > 10.0


@pytest.mark.slow
def test_the_image_alone_is_the_frames_image_and_writes_png_only(context, model, tmp_path):
    scene = scene_of("display.image_size=[64, 48]", "display.background=transparent", f"model.path={model}")
    still, frame = render_image(scene, samples=2), render(scene, samples=2)
    np.testing.assert_array_equal(still.image, frame.image)
    assert still.quality == frame.quality
    still.save(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"must end in .png"):
        still.save(tmp_path / "a.exr")
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]
