"""Bodies joined and separated while the scene is drawn."""

import numpy as np
import pytest

from milkglass.viewer.scene.scene import apply_set
from milkglass.viewer.window.panel.transport import solved
from milkglass.viewer.window.view.drawing import developed
from tests.support.driving import PICTURE, Driver, headless_picture, small_scene, write_pair

PIXELS = {"gbuffer", "composite", "exposure", "tone map"}
LIT = {f"{what}light {i}" for what in ("", "shadow of ", "irradiance of ") for i in (1, 2)} | {"flux"}
SEPARATED = {"body marks", "body layers", "body windows", "body samples", "body flux", "bodies", "separate transport"}
TRANSPORT = {"transport", "weights", "deposit", "spectra", "convolution", "layer volume", "pixel terms", "pixel tables"}


@pytest.fixture
def driver(context, tmp_path):
    driver = Driver(small_scene(write_pair(tmp_path / "pair.ply")))
    yield driver
    driver.close()


def put(driver, *assignments):
    driver.session.put(apply_set(driver.session.scene, assignments))


@pytest.mark.slow
@pytest.mark.parametrize(("method", "lit"), [("layered", set()), ("ewald", LIT)])
def test_separating_neither_loads_nor_samples_again(driver, method, lit):
    """Only the sheets of ewald need shadow maps that tell bodies apart."""
    put(driver, f"transport.method={method}", "transport.layers=4")
    joined = driver.picture()
    put(driver, "model.bodies=separate")
    assert driver.stages() == PIXELS | lit | SEPARATED | TRANSPORT | {"find bodies"}
    assert np.any(driver.picture() != joined)
    put(driver, "model.bodies=joined")
    kept = {"weights", "spectra"} if lit else {"weights", "deposit", "spectra", "convolution"}
    assert driver.stages() == PIXELS | lit | TRANSPORT - kept
    np.testing.assert_array_equal(driver.picture(), joined)


@pytest.mark.slow
def test_a_change_of_separate_bodies_runs_what_depends_on_it(driver):
    put(driver, "model.bodies=separate")
    driver.settle()
    moved = {"body layers", "body windows", "body samples", "bodies", "layer depth"}
    transport = TRANSPORT - {"transport"}
    for assignments, expected in (
        (["display.key=0.3"], {"tone map"}),
        (["camera.zoom=1.2"], PIXELS),
        (["material.sigma_s_prime=[1.0,2.0,3.0]", "material.sigma_a=[0.1,0.2,0.3]", "material.eta=1.61"],
         PIXELS | {"spectra", "convolution", "bodies", "layer volume", "pixel terms", "pixel tables"}),
        (["camera.azimuth_deg=50"], PIXELS | transport | moved),
        (["transport.method=ewald", "transport.resolution=32"], None),
        (["camera.azimuth_deg=90"], PIXELS),
    ):  # fmt: skip
        put(driver, *assignments)
        ran = driver.stages()
        assert expected is None or ran == expected, assignments


@pytest.mark.slow
@pytest.mark.parametrize("method", ["layered", "ewald", "diffusion"])
def test_changes_in_a_hurry_end_in_the_picture_of_their_sum(driver, method):
    rng = np.random.default_rng(2)
    put(driver, f"transport.method={method}", "transport.resolution=32")
    for _ in range(60):
        kind = rng.integers(4)
        if kind == 0:
            put(driver, f"model.bodies={rng.choice(['joined', 'separate'])}")
        elif kind == 1:
            put(driver, f"camera.azimuth_deg={rng.uniform(-180, 180):.2f}")
        elif kind == 2:
            put(driver, f"material.name={rng.choice(['jade', 'ketchup', 'marble'])}")
        else:
            put(driver, f"model.size_mm={rng.choice([20, 60])}")
        driver.frames(int(rng.integers(1, 4)))
    put(driver, "model.bodies=separate")
    off = np.abs(driver.picture().astype(int) - headless_picture(driver.session.scene, PICTURE))
    assert off.max() <= (2 if method == "diffusion" else 0)  # a start of other light ends elsewhere in its tolerance


def test_layers_show_all_bodies_together(driver):
    put(driver, "model.bodies=separate")
    driver.settle()
    finished = driver.view.live.finished
    incoming, outgoing = finished.incoming(), finished.outgoing()
    assert incoming.shape == outgoing.shape == (3, *finished.lit.grid.shape)
    assert finished.scattered.volume.shape[1:] == finished.scattered.atlas.shape
    np.testing.assert_allclose(incoming.sum(axis=(1, 2, 3)), finished.lit.flux.sum(axis=0), rtol=1e-4)
    assert outgoing[:, incoming.sum(axis=0) > 0.0].min() > 0.0
    driver.session.view.show = "layer out"
    driver.settle()
    key, texture = driver.view.layer_map
    expected = developed(np.moveaxis(outgoing[:, 0], 0, -1), outgoing, key[3])
    np.testing.assert_array_equal(np.frombuffer(texture.read(), np.uint8).reshape(expected.shape), expected)


@pytest.mark.slow
def test_diffusion_in_separate_bodies(driver):
    """Solved body by body: what depends on a change runs again, for all of them; layers show them together."""
    put(driver, "transport.method=diffusion", "transport.resolution=32", "model.bodies=joined")
    joined, start = driver.picture(), driver.session.scene
    put(driver, "model.bodies=separate")
    ran = driver.stages()
    assert ran >= {
        "find bodies",
        "body marks",
        "body layers",
        "body windows",
        "separate transport",
        "solution",
        "bodies",
    }
    assert not ran & {"samples", "model"}
    finished = driver.view.live.finished
    assert len(finished.scattered.parts) == 2
    assert solved(finished.scattered, complete=finished.complete).startswith("solved: R to ")
    outgoing = finished.outgoing()
    assert outgoing.shape == (3, *finished.lit.grid.shape)
    leaving = sum(
        part.two_A_M[0] @ part.boundary.patches.areas / (2.0 * part.media[0].extrapolation_factor)
        for part in finished.scattered.parts
    )
    assert outgoing[0].sum() == pytest.approx(leaving, rel=1e-3)
    for assignments, expected in (
        (["camera.azimuth_deg=50"], PIXELS),
        (["material.name=wax"], PIXELS | {"spectra", "sources of R", "sources of G", "sources of B", "solution"}),
    ):
        put(driver, *assignments)
        ran = driver.stages()
        assert ran >= expected
        assert not ran & {"boundary", "body layers", "separate transport", "rays"}
    driver.session.put(start)
    assert np.abs(driver.picture().astype(int) - joined).max() <= 2


@pytest.mark.slow
def test_a_drag_in_separate_bodies_shows_coarse_solutions_and_ends_in_the_fine_one(driver):
    put(driver, "transport.method=diffusion", "transport.resolution=64", "model.bodies=separate")
    driver.settle()
    live, seen = driver.view.live, set()
    gather = live.renderer.gather

    def see(lit, result):
        seen.add((result.grid.width, result.waiting))
        return gather(lit, result)

    live.renderer.gather = see
    driver.drag(driver.place("material.sigma_a.R"), (30.0, 0.0))
    driver.settle()
    fine = live.finished.lit.grid.width
    assert (fine, False) in seen
    assert any(width < fine for width, _ in seen)
    assert not any(waiting for _, waiting in seen)
    off = np.abs(driver.picture().astype(int) - headless_picture(driver.session.scene, PICTURE))
    assert off.max() <= 2
