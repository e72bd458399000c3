"""Who draws for a window: `Live` asks its developer for the camera, the size and the picture."""

from dataclasses import replace

import pytest

from milkglass.viewer.live.developer import ToneMap
from milkglass.viewer.live.draft import Detail
from milkglass.viewer.live.live import Live
from milkglass.viewer.render.picture import PictureRequest
from milkglass.viewer.scene.camera import pixel_offsets
from tests.support.driving import small_scene, write_knot

SIZE = (24, 16)


class SmallPictures:
    """Develops pictures of one size, marks them, and keeps what it was asked for; none of them while it is `shut`."""

    def __init__(self):
        self.shut, self.requests, self.lights = False, [], []

    def placed(self, scene, lit):
        return None if self.shut else replace(scene, display=replace(scene.display, image_size=SIZE))

    def develop(self, renderer, scene, lit, finished, request):
        self.requests.append(request)
        self.lights.append(finished.lit)
        return replace(ToneMap().develop(renderer, scene, lit, finished, request), remarks=("developed",))


@pytest.fixture
def developed(context, tmp_path):
    developer = SmallPictures()
    live = Live(context, lambda: None, developer=developer)
    yield live, developer, small_scene(write_knot(tmp_path / "knot.ply"))
    live.close()


def drawn(live, scene, detail, show="radiance"):
    for _ in range(50):
        picture = live.draw(scene, detail, show, 0.25)
        if picture is not None and not live.working:
            return picture
        live.wait()
    raise AssertionError("the picture does not come to rest")


@pytest.mark.slow
def test_a_picture_is_what_the_developer_makes(developed):
    live, developer, scene = developed
    picture = drawn(live, scene, Detail(False, 2, True))
    assert picture.image.size == SIZE
    assert picture.remarks == ("developed",)
    assert developer.requests[-1] == PictureRequest(pixel_offsets(2), exposure_for=0.25)
    assert developer.lights[-1] is live.finished.lit
    drawn(live, scene, Detail(), "exitance")
    assert developer.requests[-1] == PictureRequest(show="exitance", exposure_for=0.25, quick=True)
    assert developer.requests[-1].keeps_parts


def test_nothing_is_drawn_where_the_developer_has_no_place_for_it(developed):
    live, developer, scene = developed
    developer.shut = True
    for _ in range(20):
        assert live.draw(scene, Detail()) is None
        live.wait()
    assert live.finished is not None
    assert not developer.requests
    developer.shut = False
    assert live.draw(scene, Detail()) is not None
