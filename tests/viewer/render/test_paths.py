"""Rays of sight in whole pictures."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.probe import Probe
from milkglass.core.material.fresnel import reflectance
from milkglass.core.stages import Stage
from milkglass.viewer.gl.context import read_rgba
from milkglass.viewer.render import tracing
from milkglass.viewer.render.picture import SCATTERED, Frame, PictureRequest
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.scene.camera import jittered, model_camera
from milkglass.viewer.scene.light_paths import ALL, PARTS
from milkglass.viewer.scene.lights import DirectionalLight, SpotLight
from milkglass.viewer.scene.scene import Scene, apply_set
from milkglass.viewer.scene.settings import CameraSettings, EnvironmentSettings, ModelSettings
from tests.support import solids
from tests.support.rendering import inside

CLEAR = ("material.sigma_s_prime=[0,0,0]", "material.sigma_a=[0,0.02,0.1]")
OPAQUE = ("material.name=marble",)
OFFSET = 0.3, -0.2  # of a sample
MURKY = "material.sigma_s_prime=[0.02,0.1,0.5]", "material.sigma_a=[0.01,0.02,0.1]"


@pytest.fixture(scope="module")
def mesh():
    return solids.mesh_of(solids.ball(15.0, subdivisions=5))


@pytest.fixture(scope="module")
def renderer(context):
    return Renderer(context)


def in_environment(mesh, radiance, *assignments: str) -> Scene:
    """Return a scene of a mesh in an environment of radiance (h, 2h, 3), without lamps."""
    environment = EnvironmentSettings(probe=Probe.from_pixels(radiance))
    scene = Scene(model=ModelSettings(mesh=mesh), environment=environment, lights=())
    return apply_set(scene, ["display.image_size=[96, 96]", "transport.resolution=24", *assignments])


def white(mesh, *assignments: str) -> Scene:
    return in_environment(mesh, np.ones((16, 32, 3), np.float32), *assignments)


def test_a_clear_ball_in_a_white_furnace_is_as_bright_as_what_it_lets_through(renderer, mesh):
    """Without absorption it is not to be seen; parts sum to the whole."""
    frame = renderer.render(white(mesh, *CLEAR), samples=2)
    seen = inside(frame)
    np.testing.assert_allclose(frame.radiance[seen][:, 0], 1.0, atol=2e-3)
    assert np.all(np.diff(frame.radiance[seen].mean(axis=0)) < 0.0)
    parts = frame.subsurface + frame.specular + frame.unscattered
    np.testing.assert_allclose(parts, frame.radiance, atol=1e-5)
    assert not frame.subsurface.any()


def test_outlines_have_the_rays_of_all_samples(renderer, mesh):
    """A ball of the index of air shows what is behind it, as much as it covers of each pixel."""
    frame = renderer.render(
        white(mesh, "material.eta=1", "material.sigma_s_prime=[0,0,0]", "material.sigma_a=[0,0,0]"), samples=9
    )
    assert np.count_nonzero((frame.alpha > 0.0) & (frame.alpha < 1.0)) > 0
    np.testing.assert_allclose(frame.radiance, np.repeat(frame.alpha[..., None], 3, axis=-1), atol=1e-5)


@pytest.mark.parametrize("orthographic", ["false", "true"])
def test_further_rays_of_a_pixel_meet_the_surface_as_its_samples_do(renderer, mesh, monkeypatch, orthographic):
    shown, further = [], []
    first, beside = tracing.seen_first, tracing.seen_beside

    def seen_first(*arguments):
        shown.append(first(*arguments))
        return shown[-1]

    def seen_beside(tree, pixels, size, clip):
        further.append(beside(tree, pixels, size, jittered(camera, OFFSET, size)))
        return beside(tree, pixels, size, clip)

    monkeypatch.setattr(tracing, "seen_first", seen_first)
    monkeypatch.setattr(tracing, "seen_beside", seen_beside)
    scene = white(mesh, *CLEAR, f"camera.orthographic={orthographic}")
    camera = model_camera(scene.camera, mesh, scene.display.image_size)
    renderer.draw(scene, PictureRequest((OFFSET, (0.1, 0.2))))
    pixels, sight = shown[0]
    numbers, same = further[0]
    assert len(numbers) > 0.99 * len(pixels)
    for name in ("points", "normals", "directions"):
        np.testing.assert_allclose(getattr(same, name), getattr(sight, name)[numbers], atol=5e-3)


def test_the_mirror_of_a_smooth_surface_is_fresnels(renderer, mesh):
    scene = white(mesh, *OPAQUE)
    frame = renderer.render(scene, samples=1)
    eye = model_camera(scene.camera, mesh, scene.display.image_size).eye
    to_eye = eye[:3] - frame.position
    to_eye /= np.linalg.norm(to_eye, axis=-1, keepdims=True)
    expected = reflectance(scene.material.resolve().eta, np.einsum("ijk,ijk->ij", to_eye, frame.normal))
    seen = inside(frame)
    np.testing.assert_allclose(frame.specular[seen], np.repeat(expected[seen][:, None], 3, axis=1), atol=2e-3)
    halved = renderer.render(apply_set(scene, ["specular.strength=0.5"]), samples=1)
    np.testing.assert_allclose(halved.specular, 0.5 * frame.specular, atol=1e-5)
    assert not frame.unscattered[seen].any()


@pytest.mark.parametrize("elevation", [0.0, 75.0])
def test_a_plate_of_a_few_free_paths_is_white_in_a_white_furnace_at_any_slant(renderer, elevation):
    """It is no Lambert surface: where much comes through, along its normal, less is sent out."""
    plate, free_paths = solids.mesh_of(solids.block((20.0, 20.0, 1.0))), (1.0, 2.0, 4.0)
    of_channels = f"material.sigma_s_prime={list(free_paths)}", "material.sigma_a=[0,0,0]"
    scene = white(plate, *of_channels, f"camera.elevation_deg={elevation}", "camera.azimuth_deg=0")
    frame = renderer.render(scene, samples=1)
    middle = (frame.alpha == 1.0) & (np.abs(frame.position[..., :2]).max(axis=-1) < 8.0)
    assert middle.any()
    assert (np.diff(frame.unscattered[middle].mean(axis=0)) < -0.01).all()
    np.testing.assert_allclose(frame.radiance[middle].mean(axis=0), 1.0, atol=0.02)


def test_what_is_behind_shows_upside_down_through_a_ball(renderer, mesh):
    sky = np.ones((32, 64, 3), np.float32) * np.linspace(2.0, 0.0, 32)[:, None, None].astype(np.float32)
    frame = renderer.render(
        in_environment(mesh, sky, *CLEAR, "camera.elevation_deg=0", "material.eta=1.5", "specular.strength=0"),
        samples=1,
    )
    upper, lower = (
        frame.unscattered[rows][frame.alpha[rows] == 1.0].mean(axis=0) for rows in (slice(0, 40), slice(56, 96))
    )
    assert np.all(upper < 0.8 * lower)


def test_a_lamp_is_seen_through_the_ball(renderer, mesh):
    """Behind a ball of the index of air, a disc as bright as its irradiance over its solid angle; once, not twice."""
    lamp = DirectionalLight((0.0, 0.0, -1.0), (1.0, 2.0, 3.0), angle_deg=6.0)
    scene = apply_set(white(mesh, *CLEAR), ["camera.azimuth_deg=0", "camera.elevation_deg=0", "material.eta=1"])
    scene = apply_set(scene, ["camera.view_angle_deg=30", "material.sigma_a=[0,0,0]"])
    scene = replace(scene, lights=(lamp,), environment=EnvironmentSettings())
    frame = renderer.render(scene, samples=1)
    radiance = np.array(lamp.irradiance) / (np.pi * np.sin(np.radians(3.0)) ** 2)
    np.testing.assert_allclose(frame.unscattered[48, 48], radiance, rtol=1e-3)
    assert not frame.unscattered[frame.alpha > 0.0].min()


def test_through_what_does_not_bend_light_the_ground_is_seen_as_it_is_drawn(renderer, mesh):
    """A ball of the index of air, on a spot's pool of light; from above, and as far as the plane does not fade."""
    spot = SpotLight(
        position_mm=(20.0, 80.0, 0.0), target_mm=(0.0, -15.0, 0.0), intensity=(6e4, 5e4, 4e4), cone_deg=15.0,
        softness=0.5,
    )  # fmt: skip
    lamps = DirectionalLight((0.5, 1.0, 0.2), (3.0, 2.0, 1.0), angle_deg=12.0), spot
    scene = white(mesh, *CLEAR, "material.eta=1", "material.sigma_a=[0,0,0]", "camera.elevation_deg=60")
    scene = replace(apply_set(scene, ["ground.on=true", "ground.color=[1,0.5,0.2]"]), lights=lamps)
    picture = renderer.draw(scene)
    drawn, seen = read_rgba(picture.ground), read_rgba(picture.composite.textures["radiance"])
    through = (seen[..., 3] == 1.0) & (drawn[..., 3] == 1.0)
    seen, drawn = seen[through][:, :3], drawn[through][:, :3]
    errors = np.abs(seen - drawn) / drawn.mean(axis=0)
    assert errors.mean() < 0.01
    assert np.quantile(errors, 0.95) < 0.05  # the rest is the sharp lamp's edge, between places of the map
    assert (drawn.std(axis=0) > 0.1 * drawn.mean(axis=0)).all()


def test_pictures_of_the_parts_of_light_add_up(renderer, mesh):
    """Each alone; blue is not resolved, and has all of its scattered light in one of them."""
    scene = white(mesh, "material.sigma_s_prime=[0.02,0.1,5]", "material.sigma_a=[0.01,0.02,0.1]")

    def rendered(parts: str) -> Frame:
        return renderer.render(apply_set(scene, [f"transport.light_paths={parts}"]), samples=1)

    whole = rendered("auto")
    alone = {part: rendered(part) for part in PARTS}
    np.testing.assert_allclose(sum(frame.radiance for frame in alone.values()), whole.radiance, atol=1e-5)
    for part, layer in zip(PARTS, ("specular", "unscattered", "scattered", "scattered"), strict=True):
        others = [other for other in ("specular", "unscattered", "scattered") if other != layer]
        assert getattr(alone[part], layer).any()
        assert not any(getattr(alone[part], other).any() for other in others)
    assert not alone["once"].scattered[..., 2].any()
    np.testing.assert_allclose(rendered("often+once").scattered, whole.scattered, atol=1e-6)
    for part in SCATTERED:
        shown = renderer.draw(scene, PictureRequest(show=part)).composite.textures["subsurface"]
        np.testing.assert_array_equal(read_rgba(shown)[..., :3], alone[part].scattered)


def test_an_object_shows_itself_in_its_mirror_whatever_is_shown_of_it(renderer):
    """Two balls, whose parts add up too."""
    pair = solids.mesh_of(solids.ball(8.0), solids.ball(6.0, (14.5, 0, 0), subdivisions=2))
    scene = apply_set(white(pair, *MURKY), ["transport.resolution=16"])
    shown = [apply_set(scene, [f"transport.light_paths={parts}"]) for parts in (ALL, *PARTS)]
    frames = [renderer.render(scene, samples=1) for scene in shown]
    np.testing.assert_allclose(sum(frame.radiance for frame in frames[1:]), frames[0].radiance, atol=1e-5)


def test_under_lamps_alone_an_object_shows_itself_in_its_mirror_as_in_a_dim_room(renderer):
    pair = solids.mesh_of(solids.ball(8.0), solids.ball(6.0, (14.5, 0, 0), subdivisions=2))
    lamps = (DirectionalLight((0.4, 0.5, 0.8), (3.0, 3.0, 3.0), angle_deg=60.0),)
    dim = replace(in_environment(pair, np.full((16, 32, 3), 1e-6, np.float32), *MURKY), lights=lamps)
    dark = replace(dim, environment=EnvironmentSettings())
    seen, expected = (renderer.render(scene, samples=1) for scene in (dark, dim))
    np.testing.assert_allclose(seen.specular, expected.specular, atol=2e-3)  # what scatters is what other beams tell


def test_an_open_surface_says_that_it_has_no_parts_of_light(renderer):
    mesh = solids.mesh_of(solids.ball(15.0))
    scene = white(Mesh.of(mesh.vertices, mesh.normals, mesh.faces[500:]), *OPAQUE, "transport.light_paths=once")
    frame = renderer.render(scene, samples=1)
    assert any("are asked for" in warning for warning in frame.warnings)
    assert not frame.radiance.any()


@pytest.mark.parametrize("method", ["ewald", "layered"])
def test_the_papers_methods_follow_no_rays(renderer, mesh, method):
    frame = renderer.render(white(mesh, *OPAQUE, f"transport.method={method}"), samples=1)
    assert not frame.unscattered.any()
    assert frame.parts == ()


def drafted_and_followed(renderer, scene) -> list[dict[str, np.ndarray]]:
    """Return the parts of a picture's radiance, (n, 3) each of pixels within the object, as drafted and by rays."""
    lit = renderer.light(scene)
    gather = renderer.gather(lit, renderer.scatter(lit))
    pictures = []
    for drafts in (True, False):
        picture = renderer.shade(scene, lit, gather, PictureRequest(parts=True, drafts_sight=drafts))
        values = {name: read_rgba(texture) for name, texture in picture.composite.textures.items()}
        pictures.append({name: value[values["radiance"][..., 3] == 1.0][:, :3] for name, value in values.items()})
    return pictures


def test_a_draft_of_a_clear_ball_loses_no_light(renderer, mesh):
    drafted, _ = drafted_and_followed(renderer, white(mesh, *CLEAR, "material.sigma_a=[0,0,0]"))
    np.testing.assert_allclose(drafted["radiance"], 1.0, atol=1e-3)


def test_after_a_draft_the_next_view_shows_the_front_of_the_surface(renderer, mesh):
    """Of closed surfaces others draw the front alone, and a draft the back."""
    scene = white(replace(mesh, outward=True), *CLEAR)
    drafted_and_followed(renderer, scene)
    frame = renderer.render(replace(scene, camera=replace(scene.camera, azimuth_deg=70.0)), samples=1)
    eye = model_camera(replace(scene.camera, azimuth_deg=70.0), mesh, (96, 96)).eye
    seen = inside(frame)
    assert (np.einsum("ij,ij->i", frame.normal[seen], eye[:3] - eye[3] * frame.position[seen]) > 0.0).all()


def test_a_draft_of_a_convex_ball_is_what_rays_find(renderer, mesh):
    """It sees all there is to see of it but what forward peaks blur; rays that are nearly trapped take other ways."""
    sky = np.ones((32, 64, 3), np.float32) * np.linspace(2.0, 0.5, 32)[:, None, None].astype(np.float32)
    drafted, followed = drafted_and_followed(renderer, in_environment(mesh, sky, *MURKY, "material.g=[0.5,0.5,0.5]"))
    for part, rms in (("specular", 1e-3), ("unscattered", 0.08), ("subsurface", 0.05), ("radiance", 0.05)):
        error = drafted[part] - followed[part]
        assert np.sqrt(np.mean(error**2)) < rms * np.sqrt(np.mean(followed[part] ** 2)), part


def test_rays_are_followed_where_a_scene_needs_them_and_it_says_why(renderer, mesh):
    def parts(*assignments: str, lamps: bool = False) -> list[str]:
        scene = white(mesh, *assignments)
        if lamps:
            scene = replace(scene, environment=EnvironmentSettings(), lights=(DirectionalLight((0.0, 0.0, 1.0)),))
        return [why.split(",")[0].split(" (")[0] for why in renderer.render(scene, samples=1).parts]

    lamplit, itself = "mirror: highlights of lamps alone", "mirror: rays"
    diffuse = ["once: none", "often: none", "surface: diffusion"]
    nothing, none = ["once: none", "often: none", "surface: none"], "unscattered: none"
    assert parts(*OPAQUE, lamps=True) == [lamplit, none, *diffuse]
    assert parts(*OPAQUE, "specular.shininess=50") == ["mirror: highlights", none, *diffuse]
    assert parts(*OPAQUE, "specular.shininess=600") == ["mirror: rays", none, *diffuse]
    assert parts(*OPAQUE, "transport.light_paths=often") == ["mirror: not shown", none, *diffuse]
    assert parts(*CLEAR, "specular.shininess=50") == ["mirror: highlights", "unscattered: rays", *nothing]
    assert parts(*CLEAR, lamps=True) == [itself, "unscattered: rays", *nothing]
    murky = *CLEAR, "material.sigma_s_prime=[0.01,0.01,0.01]"
    followed = ["once: beams and rays", "often: flights", "surface: none"]
    assert parts(*murky, lamps=True) == [itself, "unscattered: rays", *followed]
    murky = *CLEAR, "material.sigma_s_prime=[0.01,0.01,5]"
    assert parts(*murky)[2:] == ["once: beams and rays", "often: flights", "surface: diffusion"]


def test_under_lamps_alone_opaque_bodies_are_mirrored_in_each_other(renderer):
    """F_r of what leaves the ball above, where rays mirrored in the one below meet it: of what its own pixels show."""
    radius, above = 10.0, np.array([0.0, 21.0, 0.0])
    mesh = solids.mesh_of(*(solids.ball(radius, at=at, subdivisions=5) for at in (np.zeros(3), above)))
    lamp = DirectionalLight((0.0, -0.6, 0.8), (3.0, 3.0, 3.0), angle_deg=20.0)  # shines on it from below
    scene = Scene(model=ModelSettings(mesh=mesh), lights=(lamp,), camera=CameraSettings(0.0, 0.0))
    scene = apply_set(scene, [*OPAQUE, "display.image_size=[128, 128]", "transport.resolution=24"])
    frame = renderer.render(scene, samples=1)
    camera, eta = model_camera(scene.camera, mesh, (128, 128)), scene.material.resolve().eta
    seen = inside(frame)
    points, normals, leaving, mirrored = (
        plane[seen].astype(np.float64) for plane in (frame.position, frame.normal, frame.subsurface, frame.specular)
    )
    sight = points - camera.eye[:3] / camera.eye[3]
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    facing = -np.einsum("ij,ij->i", sight, normals)
    rays, to_centre = sight + 2.0 * facing[:, None] * normals, above - points
    middle = np.einsum("ij,ij->i", rays, to_centre)
    inside_by = middle**2 - np.sum(to_centre**2, axis=1) + radius**2
    met = points + (middle - np.sqrt(np.maximum(inside_by, 0.0)))[:, None] * rays
    distance, pixel = cKDTree(points).query(met)
    below = points[:, 1] < above[1] - radius
    shown = below & (middle > 0.0) & (inside_by > 0.1 * radius**2) & (distance < 0.02 * radius)
    pixel, arriving = pixel[shown], -np.einsum("ij,ij->i", rays[shown], met[shown] - above) / radius
    turned = (1.0 - reflectance(eta, arriving)) / (1.0 - reflectance(eta, facing[pixel]))
    expected = (reflectance(eta, facing[shown]) * turned)[:, None] * leaving[pixel]
    assert len(pixel) > 40
    assert np.mean(np.abs(mirrored[shown] / expected - 1.0) < 0.02) > 0.9  # two show the lamp, mirrored twice


DIFFUSED = {Stage.BOUNDARY, Stage.SOURCES_R, Stage.SPECTRA, Stage.SOLUTION}
ONCE, OFTEN = {Stage.FIRST_VOLUME, Stage.RESOLVED}, {Stage.RETURNS, Stage.SECOND_VOLUME, Stage.OFTEN_SCATTERED}
ALL_WAYS, FORWARD = {Stage.EVEN_BEAMS, Stage.EVENNESS}, {Stage.ONWARDS, Stage.EXITS}
HAZY = "material.sigma_s_prime=[0.1,0.1,0.1]", "material.sigma_a=[0.01,0.01,0.01]"
DARK = "material.sigma_s_prime=[0.001,0.001,0.001]", "material.sigma_a=[0.1,0.1,0.1]"
BEAMS = {Stage.BEAMS, Stage.BEAMS_AROUND}


@pytest.mark.parametrize(
    ("material", "run", "spared"),
    [
        *((name, set(), DIFFUSED | ONCE | OFTEN | BEAMS) for name in ("Coke", "Sprite", "Merlot", "Chardonnay")),
        (DARK, BEAMS | ONCE, OFTEN | {Stage.SOURCES_R, Stage.SOURCES_G, Stage.SOURCES_B}),
        (HAZY, BEAMS | ONCE | OFTEN | ALL_WAYS, FORWARD),
        ("Shampoo", BEAMS | ONCE | OFTEN | FORWARD | {Stage.SOURCES_R}, ALL_WAYS | {Stage.SOURCES_G, Stage.SOURCES_B}),
        ("marble", DIFFUSED, BEAMS | ONCE | OFTEN | ALL_WAYS),
    ],
)
def test_a_material_runs_what_it_needs(context, mesh, material, run, spared):
    """Drinks of a scattering below 1/200 are rays alone, without a product; an albedo below 1/50 spares diffusion."""
    renderer = Renderer(context)
    given = material if isinstance(material, tuple) else (f"material.name={material}",)
    frame = renderer.render(white(mesh, *given), samples=1)
    assert run <= frame.timings.keys()
    assert not spared & frame.timings.keys()
    if not run:
        assert not renderer.transport_stages.timings
        assert not frame.exitance.any()
    assert frame.radiance[inside(frame)].min() > 0.0


def test_even_light_is_solved_for_once_a_material(context, mesh):
    """Another light or camera asks nothing more of it; another material asks for its solution, along the same rays."""
    renderer, half = Renderer(context), np.ones((16, 32, 3), np.float32)
    half[:8] = 0.2
    lit = in_environment(mesh, half, *HAZY)
    scenes = (
        white(mesh, *HAZY),
        lit,
        apply_set(lit, ["camera.azimuth_deg=40"]),
        apply_set(lit, ["material.sigma_a=[0.02,0.01,0.01]"]),
    )
    shown = [renderer.render(scene, samples=1).timings.keys() for scene in scenes]
    asked = [ALL_WAYS & stages for stages in shown]
    assert asked == [ALL_WAYS, set(), set(), {Stage.EVENNESS}]
    assert [Stage.OFTEN_SCATTERED in stages for stages in shown] == [True, True, False, True]


@pytest.mark.parametrize(
    ("scattering", "absorption", "rtol"), [(0.005 / (4.0 / 3.0 * 15.0), 0.0, 0.01), (0.02 * 0.1, 0.98 * 0.1, 0.002)]
)
def test_what_is_left_out_is_little(renderer, mesh, scattering, absorption, rtol):
    """On either side of where light that scatters, and that scatters twice, is left out."""
    scenes = [
        white(mesh, f"material.sigma_s_prime={[s * scattering] * 3}", f"material.sigma_a={[absorption] * 3}")
        for s in (0.97, 1.03)
    ]
    without, whole = (renderer.render(scene, samples=1) for scene in scenes)
    assert sum(s.split(":")[1].startswith(" none") for s in without.parts) > sum(
        s.split(":")[1].startswith(" none") for s in whole.parts
    )
    seen = inside(whole)
    np.testing.assert_allclose(without.radiance[seen].mean(), whole.radiance[seen].mean(), rtol=rtol)


def test_more_samples_than_rays_are_the_same_picture(renderer, mesh):
    few, many = (renderer.render(white(mesh, *CLEAR), samples=samples) for samples in (4, 10))
    seen = inside(few) & inside(many)
    np.testing.assert_allclose(few.unscattered[seen], many.unscattered[seen], atol=0.02)
