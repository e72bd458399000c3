"""The material that a picture was made of, from the picture: coefficients, and how sure they are."""

import json
from dataclasses import replace

import numpy as np
import pytest

import milkglass as mg
from milkglass.core.errors import InputError
from milkglass.viewer.commands import cli
from milkglass.viewer.files.images import write_exr, write_png
from milkglass.viewer.fit.pictures import Picture, read_picture
from milkglass.viewer.fit.separable import Modelled, Observed, Search
from milkglass.viewer.fit.views import View
from tests.support.solids import ball, mesh_of

TRUTH = mg.MaterialSettings(sigma_s_prime=(1.7, 2.0, 2.05), sigma_a=(0.02, 0.3, 0.1), eta=1.4)
SIZE = 48
FACTOR = 2.7  # of an exposure that nobody knows


def egg(*axes: float):
    part = ball(10.0)
    part.apply_scale(axes)
    return mesh_of(part)


@pytest.fixture(scope="module")
def scene():
    return mg.Scene(
        model=mg.ModelSettings(mesh=egg(1.0, 0.7, 0.6)),
        material=TRUTH,
        lights=(mg.DirectionalLight((0.4, 0.5, 0.77), (3.0, 2.0, 1.0)),),
        transport=mg.TransportSettings(resolution=20),
        display=mg.DisplaySettings(image_size=(SIZE, SIZE)),
    )


@pytest.fixture(scope="module")
def photograph(scene):
    """Linear pixels of the scene with 1 % noise."""
    radiance = FACTOR * mg.render(scene).radiance.astype(np.float64)
    return radiance * (1.0 + 0.01 * np.random.default_rng(3).standard_normal(radiance.shape))


@pytest.fixture(scope="module")
def start(scene):
    return replace(scene, material=mg.MaterialSettings(name="marble", eta=1.4))


@pytest.fixture(scope="module")
def fitted(start, photograph):
    return mg.fit(start, Picture.of(photograph))


def deviations(found: mg.Fit):
    for key in ("sigma_s_prime", "sigma_a"):
        yield np.log(np.array(getattr(found.material, key)) / getattr(TRUTH, key)), found.relative_errors[key]


@pytest.mark.gl
@pytest.mark.slow
def test_a_picture_gives_back_its_material_and_exposure(fitted):
    for deviation, error in deviations(fitted):
        assert np.all(np.abs(deviation) <= 2.0 * error)
        assert np.all(np.abs(deviation)[error < 0.03] < 0.05)
    assert abs(fitted.brightness[0] / FACTOR - 1.0) < 0.03
    assert fitted.misfit < 1.3
    assert fitted.renders <= 60


@pytest.mark.gl
@pytest.mark.slow
def test_the_fitted_scene_makes_the_picture(fitted, photograph, scene):
    drawn = mg.render(fitted.scene).radiance
    inside = np.zeros(drawn.shape[:2], bool)
    inside[fitted.pictures[0].max(axis=2) > 0.0] = True
    assert fitted.scene.material.eta == scene.material.eta
    assert np.sqrt(((drawn - photograph)[inside] ** 2).mean() / (photograph[inside] ** 2).mean()) < 0.02


@pytest.mark.gl
@pytest.mark.slow
def test_pictures_of_a_material_do_not_depend_on_the_one_before(scene):
    seen = View(scene, Picture.of(np.random.default_rng(0).random((SIZE, SIZE, 3))), False)
    materials = [TRUTH.resolve(), mg.materials["skim milk"], TRUTH.resolve()]
    first, _, again = (seen.modelled(material).scattered for material in materials)
    assert np.abs(again - first).max() < 1e-4 * first.mean()


@pytest.mark.gl
@pytest.mark.slow
def test_a_shifted_picture_is_no_confident_fit(start, photograph):
    found = mg.fit(start, Picture.of(np.roll(photograph, 9, axis=1)))
    assert any("does not explain the picture" in note for note in found.notes)


@pytest.mark.gl
@pytest.mark.slow
def test_the_command_writes_a_scene_and_a_report(start, photograph, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))  # a library of its own: other tests count materials
    saved = replace(start, model=mg.ModelSettings(builtin="sculpture"))
    saved.save("scene.toml")
    write_exr("seen.exr", {name: photograph[..., i].astype(np.float32) for i, name in enumerate("RGB")})
    monkeypatch.setattr("milkglass.viewer.fit.fitting.fit", lambda scenes, pictures, **_: fit_of(scenes[0], pictures))
    assert cli.main(["fit", "seen.exr", "--scene", "scene.toml", "-o", "fitted.toml", "--name", "pudding"]) == 0
    assert mg.Scene.load("fitted.toml").material.sigma_a == (0.1, 0.2, 0.3)
    assert json.loads((tmp_path / "fitted.json").read_text())["material"]["sigma_a"] == [0.1, 0.2, 0.3]
    assert (tmp_path / "fitted.png").is_file()
    assert mg.materials["pudding"].sigma_a == (0.1, 0.2, 0.3)


def fit_of(scene, pictures):
    """Return a fit that nothing was rendered for."""
    material = replace(TRUTH, sigma_a=(0.1, 0.2, 0.3))
    images = tuple(picture.pixels for picture in pictures)
    return mg.Fit(
        material.resolve(), replace(scene, material=material), ("a",) * 7, 1e-4 * np.eye(7), np.ones(1), images, images,
        images, 1.0, (), 0,
    )  # fmt: skip


BAD = [
    ("", "missing argument 'PICTURE...'"),
    ("seen.exr -o fitted.toml", "missing option '--scene'"),
    ("no.exr --scene scene.toml -o fitted.toml", "no.exr does not exist"),
    ("text.exr --scene scene.toml -o fitted.toml", "text.exr cannot be read"),
    ("seen.exr --scene no.toml -o fitted.toml", "no.toml: cannot read the scene file"),
    ("seen.exr --scene scene.toml -o fitted.txt", "fitted.txt must end in .toml"),
    ("seen.exr --scene scene.toml -o scene.toml", "over scene scene.toml"),
    ("seen.png --scene scene.toml -o seen.toml", "over picture seen.png"),
    ("seen.exr --scene scene.toml -o fitted.toml --exposure high", "it must be one of lights, free, known"),
    ("seen.exr --scene scene.toml -o fitted.toml --mask small.png", "make the mask of the same picture"),
    ("seen.exr --scene scene.toml -o fitted.toml --mask a.png --mask b.png", "there are 2 masks and 1 pictures"),
    ("black.png --scene scene.toml -o fitted.toml", "black or clipped wherever it counts"),
    ("seen.exr --scene scene.toml -o fitted.toml --name jade", "library"),
    ("seen.exr --scene dark.toml -o fitted.toml", "no light of the scene shines"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("fit")
    mg.Scene(display=mg.DisplaySettings(image_size=(SIZE, SIZE))).save(made / "scene.toml")
    mg.Scene(lights=()).save(made / "dark.toml")
    grey = np.linspace(0.0, 1.0, SIZE * SIZE, dtype=np.float32).reshape(SIZE, SIZE)
    write_exr(made / "seen.exr", dict.fromkeys("RGB", grey))
    write_png(made / "seen.png", np.repeat((255 * grey).astype(np.uint8)[..., None], 3, axis=2))
    write_png(made / "black.png", np.zeros((SIZE, SIZE, 3), np.uint8))
    write_png(made / "small.png", np.full((20, 20, 1), 255, np.uint8))
    (made / "text.exr").write_text("no picture")
    return made


@pytest.mark.parametrize(("line", "sentence"), BAD)
def test_bad_input_is_a_sentence_and_nothing_is_written(line, sentence, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    before = sorted(folder.iterdir())
    assert cli.main(["fit", *line.split()]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1
    assert sorted(folder.iterdir()) == before


def test_pictures_are_decoded_and_clipped_pixels_do_not_count(tmp_path):
    stored = np.full((16, 20, 3), 188, np.uint8)
    stored[2:6, 3:9] = 255
    write_png(tmp_path / "seen.png", stored)
    seen = read_picture(tmp_path / "seen.png")
    assert seen.pixels[0, 0, 0] == pytest.approx(0.503, abs=2e-3)
    assert not seen.counts[3, 4].any()
    assert not seen.counts[0, 0].any() or seen.counts[0, 0].all()


def test_reduced_pixels_are_means_over_their_areas():
    values = np.random.default_rng(0).random((24, 36, 3))
    seen = Picture.of(values)
    half = seen.reduced((18, 16))
    assert half.pixels.shape == (16, 18, 3)
    np.testing.assert_allclose(half.pixels.mean(axis=(0, 1)), values.mean(axis=(0, 1)))
    np.testing.assert_allclose(seen.reduced((18, 12 + 4)).pixels[:, 0], half.pixels[:, 0])


def exponentials(x):
    """Pictures b exp(-u t) + exp(-v s) of coordinates u, v of each channel."""
    t = np.linspace(0.0, 1.0, 400)
    values = np.stack([np.exp(-np.exp(u) * t) + 0.5 * np.exp(-np.exp(v) * t[::-1]) for u, v in x], axis=1)
    return Modelled(values[None], np.zeros((1, 400, 3)))


def observed(values):
    index = np.arange(len(values))
    return Observed(values, np.ones(values.shape, bool), np.stack([index[:-1], index[1:]]), [index // 10, index // 40])


@pytest.mark.parametrize("known", [False, True])
def test_separable_least_squares_finds_coordinates_and_brightness(known):
    truth = np.array([[0.5, 1.0], [-0.2, 0.3], [1.0, 0.0]])
    values = (1.0 if known else 7.0) * exponentials(truth).scattered[0]
    values *= 1.0 + 0.003 * np.random.default_rng(1).standard_normal(values.shape)
    search = Search(exponentials, observed(values), np.full(2, -5.0), np.full(2, 5.0), known)
    found = search.solve(truth + 0.6)
    errors = np.sqrt(np.diag(found.covariance))[:6].reshape(3, 2)
    assert search.is_settled
    assert np.all(np.abs(found.x - truth) <= 3.0 * errors)
    assert found.brightness[0] == pytest.approx(1.0 if known else 7.0, rel=0.03)


def test_what_the_model_cannot_explain_makes_errors_larger():
    truth = np.zeros((3, 2))
    plain = exponentials(truth).scattered[0] * (1.0 + 0.003 * np.random.default_rng(1).standard_normal((400, 3)))
    waves = plain * (1.0 + 0.2 * np.sin(np.arange(400) / 8.0)[:, None])
    errors = []
    for values in (plain, waves):
        search = Search(exponentials, observed(values), np.full(2, -5.0), np.full(2, 5.0))
        errors.append(np.sqrt(np.diag(search.solve(truth).covariance)))
    assert np.all(errors[1] > 3.0 * errors[0])


def test_scenes_and_pictures_must_go_together(start):
    seen = Picture.of(np.random.default_rng(0).random((16, 16, 3)))
    with pytest.raises(InputError, match="2 scenes and 1 pictures"):
        mg.fit([start, start], seen)
    with pytest.raises(InputError, match="no picture"):
        mg.fit(start, [])
    with pytest.raises(InputError, match="exposure is high"):
        mg.fit(start, seen, exposure="high")
