"""Sweep files: which pictures they mean, and what is refused."""

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.sweep.sweep import Sweep


@pytest.fixture
def written(tmp_path):
    """Writes a sweep file and returns what it means."""

    def write(text, **tables):
        for name, content in tables.items():
            (tmp_path / f"{name}.csv").write_text(content, encoding="utf-8")
        (tmp_path / "many.toml").write_text(text, encoding="utf-8")
        return Sweep.load(tmp_path / "many.toml")

    return write


def test_a_grid_is_the_product_of_its_keys_the_last_changing_fastest(written):
    sweep = written('[grid]\n"material.name" = ["jade", "marble"]\nmodel.size_mm = [10, 20, 40]\n')
    assert sweep.count == 6
    rows = list(sweep.rows())
    assert [(row.values["material.name"], row.values["model.size_mm"]) for row in rows] == [
        (name, size) for name in ("jade", "marble") for size in (10, 20, 40)
    ]
    assert rows[5].scene.material.name == "Marble"
    assert rows[5].scene.model.size_mm == 40.0
    assert rows[5].name == "00005"


def test_a_draw_stays_the_same_whatever_else_is_drawn(written):
    text = '[random]\ncount = {count}\nseed = 3\n"model.size_mm" = {{low = 10, high = 1000, scale = "log"}}\n'
    few, many = written(text.format(count=5)), written(text.format(count=40) + '"camera.azimuth_deg" = {low=0,high=90}')
    sizes = [row.values["model.size_mm"] for row in many.rows()]
    assert [row.values["model.size_mm"] for row in few.rows()] == sizes[:5]
    assert 10.0 <= min(sizes) < 30.0
    assert 300.0 < max(sizes) <= 1000.0


def test_draws_of_a_sequence_cover_the_range_evenly(written):
    keys = "model.size_mm = {low = 1, high = 2}\nspecular.strength = {low = 0, high = 1}"
    sweep = written(f'[random]\ncount = 64\nsequence = "sobol"\n{keys}')
    drawn = np.array([list(row.values.values()) for row in sweep.rows()]) - (1.0, 0.0)
    assert (np.histogram2d(*drawn.T, bins=4, range=[(0, 1)] * 2)[0] >= 3).all()  # 4 of 64 points a cell, on average


@pytest.mark.parametrize(("channels", "alike"), [("together", True), ("each", False)])
def test_channels_are_drawn_together_or_each(written, channels, alike):
    draw = f'{{low = [1, 2, 3], high = [2, 4, 6], channels = "{channels}"}}'
    sweep = written(f'[random]\ncount = 3\n"ground.color" = {{low = 0.1, high = 1}}\n"lights.0.irradiance" = {draw}\n')
    for row in sweep.rows():
        red, green, blue = row.values["lights.0.irradiance"]
        assert (green == pytest.approx(2 * red) and blue == pytest.approx(3 * red)) == alike
        assert len(set(row.values["ground.color"])) == 3


def test_values_come_from_a_table(written):
    sweep = written('table = "t.csv"\n', t="name,material.name,display.key\nfirst,jade,0.4\nsecond,,0.5\n")
    first, second = sweep.rows()
    assert (first.scene.material.name, first.scene.display.key) == ("jade", 0.4)
    assert (second.scene.material.name, second.scene.display.key) == (Scene().material.name, 0.5)


def test_keys_of_one_light_vary(written):
    sweep = written('[grid]\n"lights.1.irradiance" = [[0, 0, 0], [1, 2, 3]]\n')
    first, second = (row.scene.all_lights() for row in sweep.rows())
    assert second[1].irradiance == (1.0, 2.0, 3.0)
    assert first[0] == second[0] == Scene().all_lights()[0]


def test_an_object_that_turns_is_the_camera_and_the_light_turned_back(written):
    sweep = written('[turntable]\nframes = 4\nturns = "object"\nelevation_deg = 20\n')
    scene = sweep.row(1).scene
    assert scene.camera.azimuth_deg == pytest.approx(30.0 - 90.0)
    assert scene.camera.elevation_deg == 20.0
    assert scene.environment.rotation_deg == pytest.approx(-90.0)
    x, y, z = Scene().all_lights()[0].direction
    assert scene.all_lights()[0].direction == pytest.approx((-z, y, x))  # by -90 degrees about +y


def test_pictures_of_one_state_are_together(written):
    sweep = written('[grid]\n"camera.zoom" = [1, 2]\n"material.name" = ["jade", "marble"]\n[turntable]\nframes = 2\n')
    assert list(sweep.groups()) == [(0, 1, 4, 5), (2, 3, 6, 7)]
    for group in sweep.groups():
        assert len({sweep.row(index).scene.material.name for index in group}) == 1


def test_names_follow_a_template(written):
    varied = '[grid]\n"material.name" = ["whole milk"]\n[turntable]\nframes = 2\n'
    sweep = written(varied + '[output]\nname = "{material.name}/{turn_deg:03.0f}"')
    assert [row.name for row in sweep.rows()] == ["whole-milk/000", "whole-milk/180"]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "nothing varies"),
        ('grid = 3', "grid must be a table"),
        ('[gird]\nmodel.size_mm = [1]', 'did you mean "grid"'),
        ('[grid]\nmodel.size_mm = []', "grid.model.size_mm must be a list of at least one value"),
        ('[grid]\nmodel.size = [1]', 'did you mean "model.size_mm"'),
        ('[grid]\nmodel.size_mm = [1, -2]', "grid.model.size_mm must be a number from 0.001"),
        ('[grid]\n"lights.7.irradiance" = [[1,1,1]]', "the base scene has 2 lights"),
        ('[random]\nmodel.size_mm = {low = 1, high = 2}', "random.count is missing"),
        ('[random]\ncount = 2\nmodel.size_mm = {low = 3, high = 2}', "low must not be above high"),
        ('[random]\ncount = 2\nspecular.strength = {low = 0, high = 2, scale = "log"}', "needs a low above 0"),
        ('[random]\ncount = 2\nmaterial.name = {low = 0, high = 2}', "is no number"),
        ('[random]\ncount = 2\nmodel.size_mm = {low = 1, hihg = 2}', "hihg is unknown"),
        ('[grid]\nmodel.size_mm = [1]\n[random]\ncount = 2\nmodel.size_mm = {low = 1, high = 2}', "varies twice"),
        ('[turntable]\nframes = 0', "turntable.frames must be a whole number from 1"),
        ('[turntable]\n[output]\nfiles = ["jpg"]', '"jpg" is none of'),
        ('[turntable]\n[output]\nname = "a"', "pictures 0 and 1 would both be a"),
        ('[turntable]\n[output]\nname = "{index}{size}"', "{size} is nothing that varies"),
        ('[turntable]\n[output]\nname = "../{index}"', "outside the output folder"),
        ('table = "none.csv"', "none.csv: cannot read the table"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_one_sentence(written, text, sentence):
    with pytest.raises(InputError) as caught:
        written(text)
    assert sentence in str(caught.value)
    assert "many.toml" in str(caught.value) or "none.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("", "t.csv is empty"),
        ("material.nam\njade", 'column material.nam is unknown; did you mean "material.name"'),
        ("display.key,display.key\n1,2", "is there twice"),
        ("display.key\n0.5\nmuch", "line 3"),
        ("display.key,model.size_mm\n0.5", "line 2: 1 cells, but there are 2 columns"),
        ("display.key\n", "has no rows"),
    ],
)
def test_a_wrong_table_is_named_with_its_line_or_column(written, content, sentence):
    with pytest.raises(InputError) as caught:
        written('table = "t.csv"', t=content)
    assert sentence in str(caught.value)
    assert "t.csv" in str(caught.value)
