"""The error report: its reference against closed forms and the even cover, its files, its command line."""

import json
import math
import threading
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from milkglass.core.errors import InputError
from milkglass.core.light.probe import Probe
from milkglass.core.material import library as materials
from milkglass.core.reference.deviation import Deviation
from milkglass.viewer.bench.lights import sky_pixels
from milkglass.viewer.commands import cli
from milkglass.viewer.commands.report import summary
from milkglass.viewer.error.map import FOOT_PIXELS, error_map
from milkglass.viewer.error.report import error_report, map_path
from milkglass.viewer.error.visible import Illumination, VisiblePoints, measure, visible_points
from milkglass.viewer.files import images
from milkglass.viewer.scene.lights import DirectionalLight, PointLight, SpotLight
from milkglass.viewer.scene.scene import EnvironmentSettings, MaterialSettings, TransportSettings
from tests.support.occluding import shaded_ball
from tests.support.rendering import BACK, FRONT, MeshRenderer, scene_of, seen_at, surface_points
from tests.support.shapes import ball
from tests.support.solids import mesh_of, plates, sheet

MARBLE = materials.lookup("marble")


# Points and deviation


def test_points_show_the_object_and_follow_the_seed():
    rng = np.random.default_rng(0)
    alpha = (rng.random((20, 30)) > 0.5).astype(np.float32)
    position, exitance = rng.random((20, 30, 3)), rng.random((20, 30, 3))
    first = visible_points(alpha, position, exitance, 100, seed=1)
    assert np.all(alpha[first.rows, first.columns] == 1.0)
    assert len({*zip(first.rows.tolist(), first.columns.tolist(), strict=True)}) == 100
    np.testing.assert_array_equal(first.positions, position[first.rows, first.columns])
    np.testing.assert_array_equal(first.exitance, exitance[first.rows, first.columns])
    again, other = (visible_points(alpha, position, exitance, 100, seed=s) for s in (1, 2))
    np.testing.assert_array_equal(again.rows, first.rows)
    assert np.any(other.rows != first.rows)
    assert len(visible_points(alpha, position, exitance, 10_000).rows) == alpha.sum()


def test_nothing_visible_is_an_input_error():
    with pytest.raises(InputError, match="does not show the object"):
        visible_points(np.zeros((4, 4)), np.zeros((4, 4, 3)), np.zeros((4, 4, 3)))


def test_deviation_of_known_errors():
    reference = np.array([[1.0, 2.0, 0.0], [3.0, 2.0, 0.0]])
    d = Deviation.of(1.1 * reference, reference)
    np.testing.assert_allclose(d.rms, [0.1, 0.1, 0.0])
    np.testing.assert_allclose(d.ratio, [1.1, 1.1, 1.0])
    assert d.rms_together == pytest.approx(0.1)
    assert d.p99[1] == pytest.approx(0.1)


def test_measure_runs_in_a_thread_and_stops_when_progress_raises(monkeypatch):
    monkeypatch.setattr("milkglass.viewer.error.visible.BATCH_POINTS", 10)
    mesh, shares, results = ball(subdivisions=3), [], []
    light = Illumination((DirectionalLight(FRONT),), None, np.eye(3), 1.0)
    seen = seen_at(surface_points(mesh, 23))
    thread = threading.Thread(target=lambda: results.append(measure(seen, mesh, light, MARBLE, shares.append)))
    thread.start()
    thread.join()
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert results[0].reference.shape == (23, 3)
    assert np.all(results[0].reference > 0.0)

    def stop(share):
        raise InterruptedError

    with pytest.raises(InterruptedError):
        measure(seen, mesh, light, MARBLE, stop)


def test_black_material_and_no_light_have_no_error():
    mesh = ball(subdivisions=2)
    black = materials.Material("test", (0.0,) * 3, (1.0,) * 3, 1.3, "test")
    for lights, found in (((DirectionalLight(FRONT),), black), ((), MARBLE)):
        result = measure(seen_at(surface_points(mesh, 9)), mesh, Illumination(lights, None, np.eye(3), 1.0), found)
        assert result.deviation.rms == result.deviation.p99 == (0.0, 0.0, 0.0)
        assert not result.at_points.any()


# The map


def test_map_has_a_dot_for_every_point_and_a_scale():
    alpha = np.ones((500, 600))
    exitance = np.full((500, 600, 3), 0.5)
    seen = VisiblePoints(np.array([100, 400]), np.array([100, 500]), np.zeros((2, 3)), np.array([[1.0] * 3, [1.3] * 3]))
    light = Illumination((), None, np.eye(3), 1.0)
    result = replace(measure(seen, ball(subdivisions=1), light, MARBLE), reference=np.ones((2, 3)))
    picture = error_map(result, alpha, exitance)
    assert picture.shape == (500 + FOOT_PIXELS, 600, 3)
    assert np.ptp(picture[300, 300].astype(int)) == 0  # grey
    right, wrong = picture[100, 100].astype(int), picture[400, 500].astype(int)
    assert right[2] > right[1] + 50  # violet
    assert wrong[1] > wrong[0] + 50  # green, at 0.6 of the scale


def test_small_pictures_are_enlarged():
    seen = VisiblePoints(np.array([3]), np.array([7]), np.zeros((1, 3)), np.ones((1, 3)))
    result = measure(seen, ball(subdivisions=1), Illumination((), None, np.eye(3), 1.0), MARBLE)
    assert error_map(result, np.ones((16, 20)), np.ones((16, 20, 3))).shape == (27 * 16 + FOOT_PIXELS, 27 * 20, 3)


# The report


@pytest.fixture(scope="module")
def report(renderer_of):
    scene = replace(scene_of("material.name=skimmilk"), transport=TransportSettings("ewald", error_target=0.02))
    return error_report(renderer_of("ball"), scene, points=60)


def test_report_tells_what_was_chosen_and_how_far_it_is(report):
    content = report.content
    assert content["transport"]["method"] == "ewald"
    assert content["transport"]["error_target"] == 0.02
    assert 0.0 < content["transport"]["predicted_error"] <= 0.02
    assert content["transport"]["nodes"][2] == content["transport"]["layers"]
    assert content["reference"]["points"] == 60
    assert content["material"]["name"] == "Skimmilk"
    error = content["error"]
    assert all(0.0 < share < 0.02 for share in error["rms"])
    assert all(rms < p99 < 0.08 for rms, p99 in zip(error["rms"], error["p99"], strict=True))
    np.testing.assert_allclose(error["mean_ratio"], 1.0, atol=0.01)
    assert content["timings_ms"]


def test_report_is_written_whole_with_its_map(report, tmp_path):
    path = tmp_path / "error.json"
    report.save(path)
    assert {p.name for p in tmp_path.iterdir()} == {"error.json", "error.png"}
    assert json.loads(path.read_text()) == report.content
    np.testing.assert_array_equal(images.read_image(map_path(path)), report.map)


def test_report_that_cannot_be_written_leaves_nothing(report, tmp_path):
    (tmp_path / "error.png").mkdir()
    for path in (tmp_path / "error.json", tmp_path / "no" / "error.json", tmp_path / "error.txt"):
        with pytest.raises(InputError):
            report.save(path)
    assert [p.name for p in tmp_path.iterdir()] == ["error.png"]


def test_layered_transport_has_a_report_without_a_prediction(renderer_of):
    scene = scene_of("transport.layers=4", "transport.resolution=32", "display.image_size=[64, 64]")
    content = error_report(renderer_of("ball"), scene, points=20).content
    assert content["transport"]["predicted_error"] is None
    assert content["transport"]["layers"] == 4
    assert max(content["error"]["rms"]) > 0.02
    json.dumps(content, allow_nan=False)


@pytest.mark.slow
def test_environment_alone_is_measured(renderer_of, tmp_path):
    ones = np.ones((16, 32), np.float32)
    images.write_exr(tmp_path / "white.exr", dict.fromkeys("RGB", ones))
    scene = scene_of("material.name=skimmilk", "display.image_size=[64, 64]", lights=(), method="ewald")
    scene = replace(scene, environment=EnvironmentSettings(tmp_path / "white.exr"))
    assert Probe.from_pixels(np.ones((16, 32, 3), np.float32)).mean_radiance == pytest.approx(1.0)
    assert max(error_report(renderer_of("ball"), scene, points=30).content["error"]["rms"]) < 0.01


@pytest.mark.slow
def test_an_occluded_environment_is_compared_with_rays(context, tmp_path):
    images.write_exr(tmp_path / "sky.exr", dict(zip("RGB", np.moveaxis(sky_pixels(), -1, 0), strict=True)))
    scene = scene_of("display.image_size=[64, 64]", "environment.rotation_deg=75", lights=())
    renderer = MeshRenderer(context, shaded_ball())
    found = {}
    for occluded in (True, False):
        environment = replace(scene.environment, path=tmp_path / "sky.exr", occluded=occluded)
        content = error_report(renderer, replace(scene, environment=environment), points=10).content
        found[occluded] = content["environment"]
    assert max(found[True]["rms"]) < 0.05
    assert min(found[True]["rms_not_occluded"]) > 0.2
    assert found[True]["flux_ratio"] == pytest.approx([1.0] * 3, abs=0.02)
    assert found[False] == {"lamps": found[True]["lamps"], "occluded": False}
    assert "environment" not in error_report(renderer, scene_of("display.image_size=[64, 64]"), points=10).content


# The error against transport

MILKY = "material.name=skimmilk", "display.image_size=[64, 64]", "transport.resolution=40"


@pytest.fixture(scope="module")
def of_transport(renderer_of):
    """Method -> the report's second half, for skim milk lit from behind."""

    def measured(method: str):
        scene = scene_of(*MILKY, f"transport.method={method}", lights=(DirectionalLight(BACK),), method="ewald")
        return error_report(renderer_of("ball"), scene, points=10, photons=20_000, seed=3).content

    return {method: measured(method) for method in ("diffusion", "ewald")}


@pytest.mark.slow
def test_diffusion_is_near_photons_and_the_dipole_is_not(of_transport):
    found = {method: content["transport_error"] for method, content in of_transport.items()}
    assert max(found["diffusion"]["rms"]) < 0.08
    assert min(found["ewald"]["rms"]) > 0.1
    for error in found.values():
        assert error["photons"] == 20_000
        assert error["regions"] > 100
        assert error["seconds"] > 0.0
        for name in ("rms", "noise", "bias", "dark"):
            assert len(error[name]) == 3
        for name in ("rms_error", "bias_error", "dark_error"):
            assert all(0.0 < share < 0.05 for share in error[name])
        assert error["between_parts"] == {name: [0.0] * 3 for name in ("share", "rms", "noise")}  # a ball is convex
        assert error["whole"] == {name: error[name] for name in error["whole"]}
    assert found["diffusion"]["noise"] == found["ewald"]["noise"]  # the same photons


@pytest.mark.slow
def test_light_between_parts_is_told_apart(context):
    """Of two plates one shades the other: transport alone is right, whether a picture has the light between or not."""
    renderer, found = MeshRenderer(context, plates(4.0, 4.0)), {}
    for exchange in ("off", "on"):
        settings = *MILKY, "transport.method=diffusion", f"transport.exchange={exchange}"
        scene = scene_of(*settings, lights=(DirectionalLight((0.0, 0.2, 1.0)),), method="ewald")
        report = error_report(renderer, scene, points=10, photons=50_000)
        found[exchange] = report.content["transport_error"]
    without, with_it = found["off"], found["on"]
    assert with_it["rms"] == pytest.approx(without["rms"], abs=0.01)
    assert max(without["rms"]) < 0.1
    share = without["between_parts"]["share"]
    assert with_it["between_parts"]["share"] == share  # the same photons
    assert min(share) > 0.05
    assert max(without["between_parts"]["noise"]) < 0.03
    assert without["whole"]["bias"] == pytest.approx([-part for part in share], abs=0.05)
    for missing, added in zip(without["between_parts"]["rms"], with_it["between_parts"]["rms"], strict=True):
        assert added < 0.3 * missing
    line = summary(report, "a.json").splitlines()[1]
    assert ", light between parts " in line
    assert " % of the light), both " in line


@pytest.mark.slow
@pytest.mark.parametrize(
    "light", [{"lights": (DirectionalLight(FRONT, angle_deg=40.0),)}, {"lights": (), "environment": "overcast"}]
)
def test_wide_lamps_and_surroundings_are_compared_with_photons(renderer_of, light):
    scene = scene_of(*MILKY, "transport.method=diffusion", lights=light["lights"], method="ewald")
    if "environment" in light:
        scene = replace(scene, environment=EnvironmentSettings(builtin=light["environment"]))
    error = error_report(renderer_of("ball"), scene, points=10, photons=40_000).content["transport_error"]
    assert max(error["rms"]) < 0.08
    assert max(np.abs(error["bias"])) < 0.05


@pytest.mark.slow
def test_equation_1_is_no_error_of_diffusion(of_transport):
    assert "error" in of_transport["ewald"]
    assert "difference" not in of_transport["ewald"]
    assert "error" not in of_transport["diffusion"]
    assert max(of_transport["diffusion"]["difference"]["rms"]) > 0.1


@pytest.mark.slow
def test_lines_on_the_terminal_say_which_error_is_which(of_transport, report):
    def lines(content):
        return summary(replace(report, content=content), "a.json").splitlines()

    assert lines(of_transport["diffusion"])[0].startswith(
        "Difference of exitance from equation (1), which this transport does not solve"
    )
    first, second = lines(of_transport["ewald"])
    assert first.startswith("Error of exitance at 10 visible points: rms ")
    assert second.startswith("Error against a walk of photons, over the whole surface: transport inside rms ")
    assert len(lines(report.content)) == 1
    part = {"rms": [0.1, None, None], "bias": [0.01, None, None], "share": [0.2, None, None]}
    dark = part | {"between_parts": part, "whole": part}
    assert (
        "transport inside rms 10.00, -, - %, light between parts 10.00, -, - % (which is 20.00, -, - %"
        in lines({**of_transport["ewald"], "transport_error": dark})[1]
    )


def of_coefficients(scene, *sigma_s_prime: float):
    material = MaterialSettings(name=None, sigma_s_prime=sigma_s_prime, sigma_a=(0.05, 1.0, 1.0), eta=1.3)
    return replace(scene, material=material)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scattering", "lights", "reason"),
    [
        (1.0, (DirectionalLight(FRONT), PointLight((0.0, 0.0, 50.0))), "the scene has a point light"),
        (1.0, (), "the scene has no light"),
    ],
)
def test_what_photons_cannot_tell_is_said(renderer_of, scattering, lights, reason):
    scene = of_coefficients(scene_of(*MILKY, lights=lights), *(scattering,) * 3)
    report = error_report(renderer_of("ball"), scene, points=5, photons=10)
    found = report.content["transport_error"]
    assert list(found) == ["not_measured"]
    assert reason in found["not_measured"]
    assert summary(report, "a.json").splitlines()[1].startswith("Error against transport was not measured: ")


@pytest.mark.slow
def test_clear_matter_is_compared_with_paths_from_the_eye(renderer_of):
    scene = of_coefficients(scene_of("transport.method=diffusion", method="ewald"), 0.0, 0.0, 0.0)
    report = error_report(renderer_of("ball"), scene, points=5, photons=3000)
    found = report.content["transport_error"]
    assert found["by"] == "paths from the eye"
    assert found["scattered"]["ratio"] == [None, None, None]
    line = summary(report, "a.json").splitlines()[-1]
    assert line.startswith(
        f"Radiance of {found['blocks']} blocks of pixels against {found['paths']} paths from the eye"
    )
    assert "By paths from the eye, since light loses its course about 0.96 times" in line
    json.dumps(report.content, allow_nan=False)
    spot = replace(scene, lights=(SpotLight((0.0, 0.0, 50.0)),))
    content = error_report(renderer_of("ball"), spot, points=5, photons=10).content["transport_error"]
    assert list(content) == ["not_measured"]


@pytest.mark.slow
def test_an_open_mesh_has_no_photons(context):
    scene = scene_of(*MILKY, "transport.method=diffusion", method="ewald")
    content = error_report(MeshRenderer(context, mesh_of(sheet(0.0))), scene, points=5, photons=10).content
    assert "closed meshes only" in content["transport_error"]["not_measured"]
    assert content["transport"]["method"] == "ewald"  # and the error is that
    assert "error" in content


def test_a_channel_without_light_is_no_number(renderer_of):
    scene = of_coefficients(scene_of(*MILKY, method="ewald"), 1.0, 0.0, 0.0)
    content = error_report(renderer_of("ball"), scene, points=5, photons=500).content
    assert content["transport_error"]["bias"][1:] == [None, None]
    json.dumps(content, allow_nan=False)


# The command line


@pytest.mark.slow
@pytest.mark.gl
def test_command_writes_pictures_report_and_map(context, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    trimesh.creation.torus(1.0, 0.4, 24, 12).export(tmp_path / "ring.ply")
    small = "ring.ply --size-mm 20 --transport ewald --resolution 32 --image-size 64x64 --material skimmilk --samples 2"
    small += " --report-points 20 --report-photons 500"
    assert cli.main(["render", "--output", "a.png", "--report", "error.json", *small.split()]) == 0
    assert {p.name for p in tmp_path.iterdir()} == {"ring.ply", "a.png", "error.json", "error.png"}
    content = json.loads((tmp_path / "error.json").read_text())
    assert content["reference"]["points"] == 20
    assert {"model", "convolution", "gbuffer", "tone map"} <= content["timings_ms"].keys()
    assert all(math.isfinite(share) for share in content["error"]["rms"])
    line = capsys.readouterr().out
    assert line.startswith("Error of exitance at 20 visible points: rms ")
    assert "see error.json.\nError against a walk of photons, over the whole surface: transport inside rms " in line
    assert content["transport_error"]["photons"] == 500


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("--output a.png --report error.txt", "error.txt must end in .json"),
        ("--output a.png --report no/error.json", "The folder no does not exist"),
        ("--output a.png --report a.json", "--report a.json would write a.png over --output a.png"),
        ("--output b.png --reference a.png --report a.json", "--report a.json would write a.png over the reference"),
        ("--output a.png --report error.json --report-photons -1", "invalid value for '--report-photons'"),
        ("--output a.png --report error.json --report-points 0", "invalid value for '--report-points'"),
    ],
)
def test_bad_reports_are_one_sentence_and_code_2(tmp_path, capsys, monkeypatch, line, expected):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["render", *line.split()]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"milkglass: {expected}")
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.gl
def test_a_picture_without_the_object_writes_nothing(context, tmp_path, capsys, monkeypatch):
    """A speck between two pixels."""
    monkeypatch.chdir(tmp_path)
    line = "render --output a.png --report e.json --image-size 16x16 --camera-zoom 0.01 --transport layered --layers 1"
    assert cli.main([*line.split(), "--resolution", "16", "--camera-view-angle", "120"]) == 2
    assert "does not show the object" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
