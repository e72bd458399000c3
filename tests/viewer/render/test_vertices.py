"""Pictures from light at the vertices, in a drag: they look as those at rest, and see no lamp again."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from milkglass.core.geometry.mesh import Mesh
from milkglass.viewer.bench.shapes import SHAPES
from milkglass.viewer.passes.irradiance import PixelIrradiancePass
from milkglass.viewer.render.picture import PictureRequest, read_image
from milkglass.viewer.render.vertices import without_gaps
from milkglass.viewer.scene.camera import model_camera
from milkglass.viewer.scene.lights import DirectionalLight, PointLight, SphereLight, SpotLight
from milkglass.viewer.scene.scene import apply_set
from tests.support.rendering import BACK, MeshRenderer, scene_of
from tests.support.shapes import cube

pytestmark = pytest.mark.gl
MOST_RMS = 2.0  # of 255
LAMPS = (
    DirectionalLight(BACK, angle_deg=12.0),
    SphereLight((40.0, 30.0, 60.0), radius_mm=8.0),
    PointLight((-60.0, 20.0, 40.0)),
)


class Moved:
    """A lit scene that is drawn from several cameras."""

    def __init__(self, context, mesh: Mesh, scene):
        self.renderer, self.scene = MeshRenderer(context, mesh), scene
        self.change()

    def change(self, *assignments: str):
        """Light the scene with other settings, `assignments` as of ``--set``, and scatter the light."""
        self.scene = apply_set(self.scene, list(assignments))
        self.lit = self.renderer.light(self.scene)
        self.gather = self.renderer.gather(self.lit, self.renderer.scatter(self.lit))

    def draw(self, azimuth: float, *, at_vertices: bool):
        """The picture, (H, W, 3) uint8, as it is drawn in a drag or at rest."""
        scene = replace(self.scene, camera=replace(self.scene.camera, azimuth_deg=azimuth))
        camera = model_camera(scene.camera, self.lit.model.whole, scene.display.image_size)
        picture = self.renderer.shade(
            scene, replace(self.lit, camera=camera), self.gather, PictureRequest(at_vertices=at_vertices)
        )
        return read_image(picture)

    @property
    def why(self) -> str:
        return self.renderer.pixels_alone(self.scene, self.lit, self.gather)


def rms(a: np.ndarray, b: np.ndarray) -> float:
    """Difference of two pictures on the object, of 255."""
    on_object = (b != b[0, 0]).any(axis=-1)
    assert np.count_nonzero(binary_erosion(on_object)) > 1000
    return float(np.sqrt(np.square(a.astype(float) - b)[on_object].mean()))


@pytest.mark.parametrize(
    ("method", "assignments"),
    [
        ("ewald", ()),
        ("layered", ("ground.on=true", "display.background=#2a2d30")),
        ("layered", ("specular.model=phong", "camera.orthographic=true")),
        ("layered", ("environment.builtin=studio", "display.background=environment")),
    ],
    ids=["lamps", "ground", "lobes", "environment"],
)
def test_a_picture_of_a_moving_camera_does_not_pop(context, method, assignments):
    lights = () if "environment.builtin=studio" in assignments else LAMPS
    moved = Moved(context, SHAPES["knot"](), scene_of(*assignments, method=method, lights=lights))
    assert moved.why == ""
    moved.draw(20.0, at_vertices=False)  # what light was there before
    for azimuth in (20.0, 140.0):
        assert rms(moved.draw(azimuth, at_vertices=True), moved.draw(azimuth, at_vertices=False)) <= MOST_RMS


def test_a_camera_that_moves_lights_nothing_again(context, monkeypatch):
    moved, lit = Moved(context, SHAPES["knot"](), scene_of(lights=LAMPS)), []
    steps = PixelIrradiancePass.steps
    monkeypatch.setattr(PixelIrradiancePass, "steps", lambda self, *rest: lit.append(1) or steps(self, *rest))
    moved.draw(20.0, at_vertices=False)
    moved.draw(20.0, at_vertices=True)
    lit.clear()
    pictures = [moved.draw(azimuth, at_vertices=True) for azimuth in (40.0, 60.0, 80.0)]
    assert not lit
    assert len({picture.tobytes() for picture in pictures}) == 3
    moved.draw(80.0, at_vertices=False)
    assert lit


@pytest.mark.parametrize(("method", "assignments"), [("ewald", ()), ("layered", ("environment.builtin=studio",))])
def test_other_matter_is_drawn_at_vertices_and_sees_no_lamp_again(context, monkeypatch, method, assignments):
    lamps = LAMPS if method == "ewald" else LAMPS[:1]
    moved, stored = Moved(context, SHAPES["knot"](), scene_of(*assignments, method=method, lights=lamps)), []
    steps = PixelIrradiancePass.steps

    def counted(self, gbuffer, sources, gather, highlights, camera, target, *rest):
        stored.append(target.stores)
        return steps(self, gbuffer, sources, gather, highlights, camera, target, *rest)

    monkeypatch.setattr(PixelIrradiancePass, "steps", counted)
    moved.draw(20.0, at_vertices=False)
    before = moved.draw(20.0, at_vertices=True)
    assert stored.count(True) >= len(lamps)  # an environment may have some of its own
    stored.clear()
    moved.change("material.sigma_s_prime=[1.5, 2.0, 1.0]", "material.sigma_a=[0.02, 0.1, 0.3]")
    after = moved.draw(20.0, at_vertices=True)
    assert stored == [False]  # of vertices, with no shadow
    assert rms(after, before) > 10.0
    assert rms(after, moved.draw(20.0, at_vertices=False)) <= MOST_RMS


def test_pixels_at_rest_are_as_if_nothing_had_moved(context):
    moved = Moved(context, SHAPES["knot"](), scene_of(lights=LAMPS))
    before = moved.draw(20.0, at_vertices=False)
    assert (moved.draw(50.0, at_vertices=True) != before).any()
    assert np.array_equal(moved.draw(20.0, at_vertices=False), before)


def test_light_that_changed_is_not_put_on_vertices_for_one_picture(context):
    moved = Moved(context, SHAPES["knot"](), scene_of(lights=LAMPS[:1]))
    first = moved.draw(20.0, at_vertices=True)
    assert np.array_equal(first, moved.draw(20.0, at_vertices=False))


@pytest.mark.parametrize("case", ["coarse", "spot", "many"])
def test_what_vertices_do_not_know_is_drawn_by_pixels(context, case):
    spot = SpotLight((40.0, 30.0, 60.0))
    many = tuple(DirectionalLight((np.cos(i), np.sin(i), 1.0)) for i in range(7))
    mesh = cube() if case == "coarse" else SHAPES["knot"]()
    lights = {"coarse": LAMPS[:1], "spot": (spot,), "many": many}[case]
    moved = Moved(context, mesh, scene_of(lights=lights))
    assert {"coarse": "pixels long", "spot": "spot lights", "many": "more than 6"}[case] in moved.why
    still = moved.draw(20.0, at_vertices=False)
    assert np.array_equal(moved.draw(20.0, at_vertices=True), still)


def test_a_vertex_without_exitance_takes_that_of_its_neighbours():
    mesh = SHAPES["ball"]()
    exitance = np.tile(np.float32([1.0, 2.0, 0.0]), (len(mesh.vertices), 1))
    lacking = exitance.copy()
    lacking[[5, 400]] = 0.0
    assert np.array_equal(without_gaps(lacking, mesh), exitance)  # where all is dark it stays so
    assert not lacking[5].any()
