from milkglass.viewer.scene.scene import Scene, apply_set
from milkglass.viewer.window.view.labels import told_apart


def test_states_are_called_by_what_they_differ_in():
    scene = Scene()
    for change, expected in (
        ("material.name=jade", ("Marble", "jade")),
        ("transport.method=layered", ("diffusion", "layered")),
        ("transport.resolution=40", ("resolution auto", "resolution 40")),
        ("display.exposure=1.5", ("exposure 0", "exposure 1.5")),
        ("camera.zoom=2", ("Marble", "Marble")),
    ):
        assert told_apart(scene, apply_set(scene, [change])) == expected, change
