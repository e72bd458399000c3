"""Lights with a size through the shaders: soft shadows against rays, no leaks, highlights, what runs when."""

from dataclasses import replace

import numpy as np
import pytest

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.geometry.samples import SurfaceSamples
from milkglass.core.material.fresnel import transmittance
from milkglass.core.reference.equation import Occluder
from milkglass.core.reference.sources import SourcePieces
from milkglass.core.stages import Stage, Stages
from milkglass.viewer.error.photons import obstacle
from milkglass.viewer.error.visible import Illumination
from milkglass.viewer.gl.buffers import MeshBuffers, SampleBuffers
from milkglass.viewer.live.draft import STEPS_A_FRAME, Detail
from milkglass.viewer.passes.irradiance import SampleIrradiancePass
from milkglass.viewer.passes.shadow_depth import DepthTiles
from milkglass.viewer.passes.soft_shadows import SoftShadow
from milkglass.viewer.render.picture import PictureRequest, read_image
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.render.sources import LampSources
from milkglass.viewer.scene.camera import pixel_offsets
from milkglass.viewer.scene.lights import DirectionalLight, PointLight, RectangleLight, SphereLight, SpotLight
from milkglass.viewer.scene.lights.sub_lights import PARTS
from milkglass.viewer.scene.scene import apply_set
from milkglass.viewer.scene.settings import ModelSettings
from tests.support import area_lights
from tests.support.occluding import Places
from tests.support.rendering import inside, random_samples, relative_rms, scene_of
from tests.support.ring_light import RingLight
from tests.support.shapes import ball, cube
from tests.support.skins import picture, write_ball

ETA = 1.5
SIZED = {  # for an object of 20 mm
    "disc": DirectionalLight((0.5, 0.7, 0.6), angle_deg=12.0),
    "sun": DirectionalLight((-0.5, 0.7, 0.6), angle_deg=0.6),
    "sphere": SphereLight((24.0, 28.0, 30.0), radius_mm=12.0),
    "rectangle": RectangleLight((-12.0, 16.0, -36.0), size_mm=(24.0, 24.0)),
    "panel": RectangleLight((0.0, 0.0, 12.0), size_mm=(20.0, 20.0)),  # nearly touching
}


@pytest.fixture(scope="module")
def irradiance_of(context):
    """Return E of a light at samples of a mesh, (n, 3)."""
    lamps, run = LampSources(context, Stages()), SampleIrradiancePass(context)

    def irradiance(mesh, samples, light, draft=False):
        source = lamps.source(light, Stage.LIGHT.of(1), mesh, MeshBuffers(context, mesh), None, draft)
        return run.run(SampleBuffers(context, samples), source, ETA)

    return irradiance


def samples_at(points, normals):
    return SurfaceSamples(np.float32(points), np.float32(normals), np.ones(len(points), np.float32))


@pytest.mark.slow
@pytest.mark.parametrize("name", SIZED)
def test_soft_shadows_against_rays(irradiance_of, shapes, name):
    """Mean absolute error below 4 % of the mean, a draft's below 8 %."""
    mesh, light = shapes["knot"], SIZED[name]
    places = Places(mesh, 400)
    expected = area_lights.irradiance(mesh, places, light, ETA)
    for draft, most in ((False, 0.04), (True, 0.08)):
        found = irradiance_of(mesh, samples_at(places.points, places.normals), light, draft)
        assert np.abs(found[:, 0] - expected).mean() < most * expected.mean(), draft
        assert found.mean() == pytest.approx(expected.mean(), rel=0.4 * most)


def box_of_walls(side=100.0, wall=1.0):
    """A closed box with walls: the outer cube, and the inner one turned inside out; and samples on its inside."""
    outer, inner = cube(side), cube(side - 2.0 * wall)
    vertices = np.concatenate([outer.vertices, inner.vertices])
    normals = np.concatenate([outer.normals, -inner.normals])
    mesh = Mesh(vertices, normals, np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.vertices)]))
    samples, _ = random_samples(inner, 20_000)
    return mesh, samples_at(samples.points, -samples.normals)


@pytest.mark.parametrize(
    "light",
    [
        DirectionalLight((0.3, 0.4, 1.0)),
        DirectionalLight((0.02, 0.01, 1.0)),
        DirectionalLight((0.3, 0.4, 1.0), angle_deg=0.5),
        DirectionalLight((0.02, 0.4, 1.0), angle_deg=15.0),
        PointLight((60.0, 90.0, 150.0)),
        PointLight((0.0, 0.0, 55.0)),
        SphereLight((60.0, 90.0, 150.0), radius_mm=60.0),
        SphereLight((0.0, 20.0, 70.0), radius_mm=15.0),
        RectangleLight((0.0, 100.0, 90.0), size_mm=(150.0, 80.0)),
        RectangleLight((0.0, 5.0, 60.0), size_mm=(60.0, 60.0)),
        SpotLight((80.0, 90.0, 150.0), cone_deg=40.0),
        SpotLight((0.0, 3.0, 70.0), cone_deg=120.0),
    ],
    ids=lambda light: light.KIND,
)
def test_no_light_leaks_into_a_closed_box(irradiance_of, light):
    """Of 100 mm, with walls of 1 mm: E = 0 at 20,000 places inside."""
    mesh, samples = box_of_walls()
    assert np.all(irradiance_of(mesh, samples, light) == 0.0)


@pytest.mark.parametrize("light", [SIZED["disc"], SIZED["sphere"], SpotLight((20.0, 20.0, 30.0), cone_deg=70.0)])
def test_a_ball_has_no_acne(irradiance_of, light):
    """Convex: wherever all of the light is above the horizon, all of it arrives."""
    mesh = ball(20.0, 6)
    samples, _ = random_samples(mesh, 20_000)
    points, normals = samples.points.astype(np.float64), samples.normals.astype(np.float64)
    if isinstance(light, DirectionalLight):
        towards, half = np.broadcast_to(light.direction, points.shape), np.radians(0.5 * light.angle_deg)
    else:
        towards = light.position_mm - points
        half = np.arctan(getattr(light, "radius_mm", 0.0) / np.linalg.norm(towards, axis=1))
    towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", normals, towards)
    clear = np.arcsin(np.clip(cosine, -1.0, 1.0)) > half + np.radians(15.0)
    actual = irradiance_of(mesh, samples, light)[:, 0]
    facing = 3.0
    if not isinstance(light, DirectionalLight):
        facing = light.intensity[0] / np.square(light.position_mm - points).sum(axis=1)
    # F_t and the cosine vary over a large light; E of its centre is near it except where light grazes.
    expected = facing * cosine * transmittance(ETA, np.clip(cosine, 0.0, 1.0))
    np.testing.assert_allclose(actual[clear], expected[clear], rtol=0.06, atol=0.01 * expected.max())
    assert np.all(actual[np.arcsin(np.clip(cosine, -1.0, 1.0)) < -half - np.radians(1.0)] == 0.0)


def test_a_new_kind_shines_from_its_sub_lights(irradiance_of):
    """A ball before a ring that the shaders know nothing of: the sum of its patches, where all are seen or none."""
    light, mesh = RingLight((10.0, 20.0, 80.0), radius_mm=25.0), ball(20.0, 6)
    samples, _ = random_samples(mesh, 2_000)
    count = light.sub_light_count(mesh.radius)
    assert count > PARTS
    expected, lowest, highest = np.zeros(len(samples)), np.ones(len(samples)), -np.ones(len(samples))
    for place in light.sub_lights(count).vectors:
        towards = place - samples.points
        distance = np.linalg.norm(towards, axis=1)
        cosine = np.einsum("ij,ij->i", samples.normals, towards) / distance
        lowest, highest = np.minimum(lowest, cosine), np.maximum(highest, cosine)
        facing, along = np.maximum(cosine, 0.0), -(towards @ light.axes[2]) / distance
        expected += light.intensity[0] / count * transmittance(ETA, facing) * facing * along / distance**2
    actual = irradiance_of(mesh, samples, light)[:, 0]
    np.testing.assert_allclose(actual[lowest > 0.15], expected[lowest > 0.15], rtol=1e-3)
    assert np.all(actual[highest < 0.0] == 0.0)


# Pictures


def test_samples_of_a_pixel_share_sub_lights_out(renderer_of):
    """All of four see each as often as all of three, who can share nothing: nothing is lost, and pictures agree."""
    scene = scene_of(lights=(SIZED["disc"],))
    three, four = (renderer_of("knot").render(scene, samples=n) for n in (3, 4))
    seen = inside(three, 3)
    assert np.all(relative_rms(four.irradiance[seen], three.irradiance[seen]) < 0.05)
    np.testing.assert_allclose(four.irradiance[seen].mean(axis=0), three.irradiance[seen].mean(axis=0), rtol=5e-3)


@pytest.mark.slow
def test_pixels_and_samples_see_the_same(renderer_of, irradiance_of, shapes):
    for light in (SIZED["rectangle"], SpotLight((15.0, 20.0, 40.0), cone_deg=12.0)):
        frame = renderer_of("knot").render(scene_of("camera.azimuth_deg=190", lights=(light,)), samples=1)
        seen = inside(frame)
        points, normals = frame.position[seen], frame.normal[seen]
        expected = irradiance_of(shapes["knot"], samples_at(points, normals), light)
        assert np.all(relative_rms(frame.irradiance[seen], expected) < 0.02)  # samples filter less
        np.testing.assert_allclose(frame.irradiance[seen].mean(axis=0), expected.mean(axis=0), rtol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("model", "shininess"), [("phong", 10), ("phong", 2000), ("normalized", 300)])
def test_the_highlight_of_a_disc_is_whole_and_smooth(renderer_of, model, shininess):
    """As much light as of a sharp light, and no dots of sub-lights: one maximum across it."""
    looks = f"specular.model={model}", f"specular.shininess={shininess}", "camera.orthographic=true", "camera.zoom=1.5"
    direction, big = (0.3, 0.3, 1.0), "display.image_size=[192, 192]"
    frames = [
        renderer_of("ball").render(scene_of(*looks, big, lights=(DirectionalLight(direction, angle_deg=a),)), samples=4)
        for a in (0.0, 14.0)
    ]
    sharp, soft = (frame.specular[..., 0].astype(np.float64) for frame in frames)
    assert soft.sum() == pytest.approx(sharp.sum(), rel=0.06)
    assert soft.max() < (1.0 if shininess > 100 else 1.05) * sharp.max()
    row = soft[np.unravel_index(soft.argmax(), soft.shape)[0]]
    bright = row > 0.5 * row.max()
    steps = np.diff(row[bright]) / row.max()
    rises = np.flatnonzero(steps > 0.03)
    falls = np.flatnonzero(steps < -0.03)
    assert not len(rises) or not len(falls) or rises.max() < falls.min()


@pytest.mark.parametrize(
    ("light", "radiance"),
    [
        (DirectionalLight((0.3, 0.4, 1.0), (1.0,) * 3, angle_deg=30.0), 1.0 / (np.pi * np.sin(np.radians(15.0)) ** 2)),
        (SphereLight((18.0, 24.0, 40.0), (1e3,) * 3, radius_mm=12.0), 1e3 / (np.pi * 12.0**2)),
    ],
)
def test_a_smooth_surface_mirrors_a_disc_of_light_with_its_edge(renderer_of, light, radiance):
    scene = scene_of("specular.model=normalized", "camera.orthographic=true", lights=(light,))
    frame = renderer_of("ball").render(scene, samples=1)
    seen = inside(frame)
    points, normals = frame.position[seen].astype(float), frame.normal[seen].astype(float)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    to_eye = np.asarray(renderer_of("ball").light(scene).camera.eye[:3], float)
    cosine = normals @ to_eye
    rays = 2.0 * cosine[:, None] * normals - to_eye
    near = isinstance(light, SphereLight)
    to_centre = np.array(light.position_mm) - points if near else np.array([light.direction])
    distance = np.linalg.norm(to_centre, axis=1)
    radius = np.arcsin(light.radius_mm / distance) if near else np.radians(15.0)
    angle = np.arccos(np.clip(np.sum(rays * to_centre, axis=1) / distance, -1.0, 1.0))
    whole, none = angle < radius - 0.02, (angle > radius + 0.02) & (cosine > 0.5)  # rims mirror the object
    mirrored = frame.specular[seen][:, 0]
    assert whole.sum() > 50
    expected = (1.0 - transmittance(scene.material.resolve().eta, cosine)) * radiance
    np.testing.assert_allclose(mirrored[whole], expected[whole], rtol=0.02)
    assert mirrored[none].max() < 1e-3 * expected[whole].mean()


@pytest.mark.parametrize("name", SIZED)
def test_reports_cast_rays_to_all_of_a_light(renderer_of, shapes, name):
    """What the error of a picture is measured against has the light that pictures have."""
    places = Places(shapes["knot"], 300)
    sources = SourcePieces(places.points, places.normals, places.face_normals, np.ones(300))
    expected = area_lights.irradiance(shapes["knot"], places, SIZED[name], ETA)
    found = Illumination.of((SIZED[name],), ETA).irradiance(Occluder(shapes["knot"]), sources, ETA)
    assert np.abs(found[:, 0] - expected).mean() < 0.02 * expected.mean()


def test_colours_and_relief_meet_a_small_light_as_a_sharp_one(context, tmp_path):
    pixels = np.random.default_rng(2).integers(60, 255, (8, 8, 3)).astype(np.uint8)
    model = ModelSettings(path=write_ball(tmp_path / "ball.glb", picture(pixels)), size_mm=20.0)
    renderer = Renderer(context)
    sharp, small = (
        renderer.render(replace(scene_of("detail.albedo=before", lights=(light,)), model=model), samples=1)
        for light in (DirectionalLight((0.3, 0.4, 1.0)), DirectionalLight((0.3, 0.4, 1.0), angle_deg=0.1))
    )
    seen = inside(sharp)
    assert np.all(relative_rms(small.irradiance[seen], sharp.irradiance[seen]) < 0.02)
    assert np.all(relative_rms(small.specular[seen], sharp.specular[seen]) < 0.02)
    assert np.std(sharp.irradiance[seen]) > 0.2


def test_photons_come_from_distant_lights(renderer_of):
    for name, why in (
        ("sphere", "photons come from distant lights only, and the scene has a sphere light"),
        ("disc", None),
    ):
        scene = scene_of(lights=(SIZED[name],))
        assert obstacle(scene, renderer_of("cube").light(scene)) == why


def test_thin_parts_glow_with_a_panel_behind(renderer_of):
    """As much as with the point light that it nearly is."""
    place, intensity = (0.0, 0.0, -120.0), (4e4,) * 3
    panel = RectangleLight(place, intensity, size_mm=(20.0, 20.0))
    frames = [
        renderer_of("plate").render(scene_of("material.name=skimmilk", method="ewald", lights=(light,)), samples=1)
        for light in (PointLight(place, intensity), panel)
    ]
    seen = inside(frames[0], 4)
    point, soft = (frame.exitance[seen] for frame in frames)
    assert point.mean() > 0.01
    assert np.all(relative_rms(soft, point) < 0.04)


def test_what_runs_again(renderer_of):
    renderer = renderer_of("cube")
    lamp, off = replace(SIZED["disc"], angle_deg=9.0), replace(SIZED["sphere"], on=False)
    black = replace(SIZED["rectangle"], intensity=(0.0, 0.0, 0.0))
    renderer.render(scene_of(lights=(lamp, off, black)), samples=1)
    cast = {stage for stage in renderer.timings if stage.startswith("shadow")}
    assert cast == {"shadow of light 1"}  # none of what does not shine
    renderer.render(scene_of("camera.azimuth_deg=60", lights=(lamp,)), samples=1)
    assert not {"shadow of light 1", "irradiance of light 1"} & renderer.timings.keys()
    renderer.render(scene_of(lights=(replace(lamp, irradiance=(5.0,) * 3),)), samples=1)
    assert "shadow of light 1" not in renderer.timings
    held = replace(lamp, fixed_to="camera")
    renderer.render(scene_of(lights=(held,)), samples=1)
    before = renderer.render(scene_of("camera.azimuth_deg=0", lights=(held,)), samples=1)
    assert {"shadow of light 1", "irradiance of light 1"} <= renderer.timings.keys()
    after = renderer.render(scene_of("camera.azimuth_deg=90", lights=(held,)), samples=1)  # a cube looks the same
    assert np.all(relative_rms(after.irradiance[inside(after)], before.irradiance[inside(before)]) < 0.04)


def test_sharp_lights_keep_the_cheap_shaders(renderer_of):
    renderer = renderer_of("cube")
    lit = renderer.light(scene_of(lights=(DirectionalLight((0.3, 0.4, 1.0)), PointLight((0.0, 50.0, 50.0)))))
    assert not any(isinstance(source.shadow, SoftShadow) for source in lit.sources)
    assert renderer.light(scene_of(lights=(SIZED["sun"],))).sources[0].is_soft


def test_while_a_light_is_dragged_it_has_few_sub_lights(driver):
    live, session = driver.view.live, driver.session
    session.edit_lights([SphereLight((100.0, 120.0, 150.0), radius_mm=60.0)])
    driver.settle()
    whole = len(live.lit.sources[0].shadow.lights)
    scene = session.scene
    moved = replace(scene, lights=(replace(scene.lights[0], position_mm=(90.0, 120.0, 150.0)),))
    live.renderer.stages.begin()  # with no allowance: all at once
    live._light(apply_set(moved, []), Detail(draft=True))
    assert len(live.lit.sources[0].shadow.lights) < whole
    live._light(moved, Detail(draft=False))
    assert len(live.lit.sources[0].shadow.lights) == whole
    live._light(apply_set(moved, ["material.name=ketchup"]), Detail(draft=True))
    assert len(live.lit.sources[0].shadow.lights) == whole  # a material leaves shadows alone


@pytest.mark.slow
def test_a_large_light_comes_to_rest_over_several_frames(driver, context, monkeypatch):
    """No frame draws more than its share of shadow maps; another edit starts again; the end is the headless picture."""
    live, session, drawn = driver.view.live, driver.session, []
    monkeypatch.setattr("milkglass.viewer.live.draft.STEP_SECONDS", 60.0)  # counted, whatever the machine
    tiles = DepthTiles.steps

    def counted(self, texture, columns, side, matrices, *rest):
        steps = tiles(self, texture, columns, side, matrices, *rest)
        if len(matrices) <= few:  # a draft's
            return (yield from steps)
        while True:
            drawn[-1][1] += 1
            try:
                next(steps)
            except StopIteration as end:
                return end.value
            yield

    monkeypatch.setattr(DepthTiles, "steps", counted)
    first, second = (RectangleLight((x, 0.0, 62.0), size_mm=(90.0, 90.0)) for x in (10.0, -10.0))
    few, whole = (first.sub_light_count(50.0, draft=draft) for draft in (True, False))
    assert whole > 4 * STEPS_A_FRAME

    def frame():
        drawn.append([session.scene.lights[0], 0])
        driver.frames(1)

    session.edit_lights([first])
    for _ in range(3):
        frame()
    assert live.working
    assert len(live.lit.sources[0].shadow.lights) == few  # meanwhile a draft is up
    session.edit_lights([second])
    while not drawn or len(live.lit.sources[0].shadow.lights) != whole or live._lit_for.drafted:
        frame()
        assert len(drawn) < 60
    driver.settle()
    assert max(tiles for _, tiles in drawn) <= STEPS_A_FRAME + 1
    assert sum(tiles for light, tiles in drawn if light == first) < whole  # the rest was given up
    assert sum(tiles for light, tiles in drawn if light == second) >= whole
    still = Renderer(context).draw(driver.view.shown, PictureRequest(pixel_offsets(4)))
    assert np.abs(read_image(still).astype(int) - read_image(driver.view.picture).astype(int)).max() <= 1
