"""Pictures beside traced paths: refusals, the arithmetic of the comparison, and a ball where Mitsuba is installed."""

import importlib.util
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from milkglass.core.errors import InputError
from milkglass.core.light.probe import Probe, lookup
from milkglass.core.material import fresnel
from milkglass.viewer.bench.shapes import bowl
from milkglass.viewer.commands import cli
from milkglass.viewer.error import mitsuba_paths, path_traced
from milkglass.viewer.files import images
from milkglass.viewer.scene.camera import model_camera, world_to_probe
from milkglass.viewer.scene.lights import DirectionalLight, PointLight
from milkglass.viewer.scene.settings import EnvironmentSettings, MaterialSettings
from tests.support.rendering import FRONT, MeshRenderer, scene_of
from tests.support.shapes import ball
from tests.support.skies import directions, sky
from tests.support.solids import plates


def test_without_mitsuba_one_sentence_names_the_extra(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert cli.main(["render", "--output", "a.png", "--path-traced", "b.exr"]) == 2
    assert capsys.readouterr().err == 'milkglass: --path-traced needs Mitsuba 3: pip install "milkglass[mitsuba]".\n'
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("scene", "name", "expected"),
    [
        (scene_of(), "a.png", "must end in .exr"),
        (scene_of(), "picture.exr", "would write over --output"),
        (scene_of(lights=()), "a.exr", "needs light"),
        (
            scene_of("environment.builtin=studio", "environment.occluded=false", lights=()),
            "a.exr",
            "leave environment.occluded on",
        ),
        (scene_of(lights=(DirectionalLight(FRONT), PointLight((0.0, 0.0, 50.0)))), "a.exr", "remove the point lights"),
        (scene_of("camera.orthographic=true"), "a.exr", "perspective cameras only"),
    ],
)
def test_what_cannot_be_traced_is_refused(tmp_path, scene, name, expected):
    with pytest.raises(InputError, match=expected):
        path_traced.check(scene, tmp_path / name, [str(tmp_path / "picture.exr")])


def test_noise_is_taken_off():
    rng = np.random.default_rng(0)
    truth = 1.0 + rng.random((240, 240, 3))
    halves = truth + rng.normal(0.0, 2.0, (2, 240, 240, 3))
    used = np.ones((240, 240), np.bool_)
    found = path_traced.compare(1.1 * truth, halves, used)
    np.testing.assert_allclose(found.rms, 0.1, atol=0.02)
    np.testing.assert_allclose(found.ratio, 1.1, atol=0.01)
    np.testing.assert_allclose(found.noise, 2.0 / np.sqrt(2.0) / 20.0 / 1.5, rtol=0.2)
    used[:, :200] = False  # there may be anything
    halves[:, :, :200] = 1e3
    np.testing.assert_allclose(path_traced.compare(1.1 * truth, halves, used).ratio, 1.1, atol=0.03)
    with pytest.raises(InputError, match="too little of the object"):
        path_traced.compare(truth, halves, np.zeros((240, 240), np.bool_))


def test_an_rms_that_noise_explains_is_below_the_noise():
    rng = np.random.default_rng(1)
    truth = 1.0 + rng.random((240, 240, 3))
    halves = truth + rng.normal(0.0, 2.0, (2, 240, 240, 3))
    found = path_traced.compare(truth * [1.0, 1.0, 1.5], halves, np.ones((240, 240), np.bool_))
    assert found.rms[:2] == (0.0, 0.0)
    text = str(found)
    assert text.startswith("rms below the noise, below the noise, ")
    assert "0.0 %" not in text
    result = path_traced.PathTracedResult(found)
    assert "is not told apart" in str(result)
    told = replace(result, alone=found, again_share=(0.1, 0.2, 0.3))
    assert "Transport alone, without light between parts (10.0, 20.0, 30.0 % of it): rms below" in str(told)


def test_the_strip_has_both_pictures_and_their_difference_at_one_exposure():
    ours, traced = np.full((100, 120, 3), 0.2), np.full((100, 120, 3), 0.2)
    ours[:, :60] *= 2.0
    picture = path_traced.strip(ours, traced)
    assert picture.shape == (500, 1800, 3)
    ours_shown, traced_shown, difference = (picture[300:, i : i + 600] for i in (0, 600, 1200))
    np.testing.assert_array_equal(ours_shown[:, 300:], traced_shown[:, 300:])
    assert (ours_shown[:, :300] > traced_shown[:, :300]).all()
    assert np.ptp(difference[:, 300:]) == 0
    assert (difference[:, :300] > difference[0, 400]).all()


def test_an_llvm_that_aborts_leaves_the_scalar_variant(monkeypatch):
    for returncode, expected in ((-6, mitsuba_paths.SCALAR), (0, mitsuba_paths.VECTORISED)):
        done = subprocess.CompletedProcess([], returncode)
        monkeypatch.setattr(mitsuba_paths.subprocess, "run", lambda *_args, done=done, **_options: done)
        assert mitsuba_paths.variant.__wrapped__() == expected


# With Mitsuba


@pytest.fixture
def vectorised():
    pytest.importorskip("mitsuba", reason="the path tracer is an extra")
    if mitsuba_paths.variant() != mitsuba_paths.VECTORISED:
        pytest.skip("LLVM is absent or too old")


def of_coefficients(scene, sigma_s_prime, sigma_a):
    return replace(scene, material=MaterialSettings(name=None, sigma_s_prime=sigma_s_prime, sigma_a=sigma_a, eta=1.3))


SMALL = "transport.method=diffusion", "display.image_size=[48, 48]"


@pytest.mark.slow
@pytest.mark.parametrize("variant", [mitsuba_paths.SCALAR, mitsuba_paths.VECTORISED])
def test_a_ball_is_what_paths_say(renderer_of, tmp_path, monkeypatch, variant):
    pytest.importorskip("mitsuba", reason="the path tracer is an extra")
    if variant == mitsuba_paths.VECTORISED and mitsuba_paths.variant() != variant:
        pytest.skip("LLVM is absent or too old")
    monkeypatch.setattr(mitsuba_paths, "variant", lambda: variant)
    scene = of_coefficients(
        scene_of(*SMALL, lights=(DirectionalLight(FRONT, angle_deg=40.0),), method="ewald"),
        (0.45, 0.47, 0.49),
        (0.05, 0.03, 0.01),
    )
    mesh = ball()
    frame = renderer_of(mesh).render(scene)
    subject = path_traced.subject_of(scene, mesh, None)
    found = path_traced.trace(scene, subject, (frame, frame), tmp_path / "paths.exr", 512)
    assert all(rms < max(0.1, 3.0 * noise) for rms, noise in zip(found.whole.rms, found.whole.noise, strict=True))
    np.testing.assert_allclose(found.whole.ratio, 1.0, atol=0.08)
    layers = images.read_channels(tmp_path / "paths.exr")
    assert "difference.R" in layers
    assert images.read_image(tmp_path / "paths.png").shape == (480, 1440, 3)
    if variant == mitsuba_paths.VECTORISED:
        assert found.again_share == (0.0, 0.0, 0.0)  # a ball is convex
        assert found.alone == found.whole
    else:
        assert found.alone is None


@pytest.mark.slow
def test_paths_in_white_surroundings_see_white(vectorised, context):
    """Without absorption radiance is 1 in all directions, between parts too: what is seen of it is F_t."""
    scene = of_coefficients(scene_of(*SMALL, lights=(), method="ewald"), (6.0, 8.0, 12.0), (0.0,) * 3)
    mesh = bowl()
    white = Probe.from_pixels(np.ones((16, 32, 3), np.float32))
    scene = replace(scene, environment=EnvironmentSettings(probe=white))
    traced = mitsuba_paths.trace(path_traced.subject_of(scene, mesh, white), 256, 0)
    frame = MeshRenderer(context, mesh).render(scene, samples=1)
    camera = model_camera(scene.camera, mesh, (48, 48))
    seen = binary_erosion(frame.alpha == 1.0, iterations=2)
    towards = camera.eye[:3] - frame.position[seen]
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", towards, frame.normal[seen])
    expected = fresnel.transmittance(1.3, cosine)
    np.testing.assert_allclose(traced.whole[seen].mean(axis=0), expected.mean(), rtol=0.03)
    assert (traced.again[seen].mean(axis=0) > 0.02).all()


@pytest.mark.slow
def test_transport_alone_is_judged_by_paths_that_never_come_back(vectorised, context, tmp_path):
    scene = of_coefficients(
        scene_of(
            *SMALL, "camera.azimuth_deg=60", lights=(DirectionalLight((0.6, 0.3, 1.0), angle_deg=60.0),), method="ewald"
        ),
        (1.0, 1.0, 1.0),
        (0.01, 0.02, 0.05),
    )
    mesh = plates(4.0, 4.0)
    renderer = MeshRenderer(context, mesh)
    off = replace(scene, transport=replace(scene.transport, exchange="off"))
    frames = renderer.render(scene), renderer.render(off)
    found = path_traced.trace(scene, path_traced.subject_of(scene, mesh, None), frames, tmp_path / "a.exr", 1024)
    np.testing.assert_allclose(found.alone.ratio, 1.0, atol=0.08)
    assert min(found.again_share) > 0.03


@pytest.mark.slow
def test_surroundings_are_turned_as_the_pictures(vectorised):
    import mitsuba as mi

    mi.set_variant(mitsuba_paths.VECTORISED)
    probe = Probe.from_pixels(sky(((0.3, 0.6, -0.5), 40.0, (9.0, 6.0, 3.0)), height=64))
    towards = directions(4000)
    mesh = ball()
    scene = replace(scene_of(lights=()), environment=EnvironmentSettings(probe=probe, rotation_deg=75.0))
    found = mi.load_dict(
        {"type": "scene", **mitsuba_paths._surroundings(mi, path_traced.subject_of(scene, mesh, probe))}
    )
    leaving = mi.SurfaceInteraction3f()
    leaving.wi = -mi.Vector3f(*towards.T)
    radiance = np.asarray(found.environment().eval(leaving)).T
    wanted = lookup(probe.latlong, towards @ world_to_probe(75.0))
    assert np.mean(wanted[:, 0] > 8.0) > 0.02  # in the disc
    assert np.mean(np.abs(radiance[:, 0] - wanted[:, 0]) < 0.2) > 0.99
