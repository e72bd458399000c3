"""A profile of one's own: what is read, what is refused with its line, and what comes between and beyond."""

import numpy as np
import pytest

from milkglass.core.errors import InputError
from milkglass.core.profiles.table import parse_table

GOOD = "radius_mm,R,G,B\n0,0.1,0.05,0\n1,0.05,0.025,0\n\n# measured by hand\n2,0.01,0.005,0\n"


def test_reads_header_blanks_and_remarks():
    red, green, blue = parse_table("\ufeff" + GOOD.replace("\n", "\r\n"), "skin.csv")
    np.testing.assert_allclose(red.radial([0.0, 1.0, 2.0]), [0.1, 0.05, 0.01], rtol=1e-12)
    np.testing.assert_allclose(green.radial([0.0, 1.0, 2.0]), [0.05, 0.025, 0.005], rtol=1e-12)
    assert blue.is_black
    assert parse_table(GOOD.split("\n", 1)[1], "skin.csv")[0] == red  # a header may be missing


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "p.csv: a profile needs 2 radii at least"),
        ("0,1,1,1\n", "p.csv: a profile needs 2 radii at least"),
        ("radius_mm,R,G,B\n0,.1,.1,.1\n1,.1,x,.1\n", "p.csv, line 3: expected 4 numbers"),
        ("0,.1,.1\n1,.1,.1\n", "p.csv, line 1: expected 4 numbers"),
        ("0,.1,.1,.1\n1,nan,.1,.1\n", "p.csv, line 2: expected 4 numbers"),
        ("0,.1,.1,.1\n1,inf,.1,.1\n", "p.csv, line 2: expected 4 numbers"),
        ("0,.1,.1,.1\nradius_mm,R,G,B\n", "p.csv, line 2: expected 4 numbers"),
        ("-1,.1,.1,.1\n1,.1,.1,.1\n", "p.csv, line 1: a radius is from 0"),
        ("0,.1,-.1,.1\n1,.1,.1,.1\n", "p.csv, line 1: a radius is from 0 to 1e+06 mm and a value from 0"),
        ("0,.1,.1,.1\n0,.05,.05,.05\n", "p.csv, line 2: the radius 0 mm does not rise"),
        ("0,.1,.1,.1\n1,.05,.2,.05\n", "p.csv, line 2: G rises from 0.1 to 0.2"),
        ("0,.1,.1,.1\n1,.01,.1,.01\n", "p.csv: G does not fall at its end"),
        ("0,5,.1,.1\n1,.05,.05,.05\n", "p.csv: R returns"),
    ],
)
def test_refuses_with_the_line(text, message):
    with pytest.raises(InputError) as error:
        parse_table(text, "p.csv")
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


def test_an_exponential_is_met_everywhere():
    radii = np.array([0.0, 0.3, 1.0, 1.1, 4.0])
    rows = "\n".join(f"{r!r},{float(0.1 * np.exp(-r / 0.8))!r},0,0" for r in radii.tolist())
    profile = parse_table(rows, "p.csv")[0]
    rho = np.linspace(0.0, 20.0, 300)
    np.testing.assert_allclose(profile.radial(rho), 0.1 * np.exp(-rho / 0.8), rtol=1e-9)
    whole = 2.0 * np.pi * 0.1 * 0.8**2
    np.testing.assert_allclose(profile.total(rho), whole * np.exp(-rho / 0.8) * (1.0 + rho / 0.8), rtol=1e-7)
    assert profile.tail_share == pytest.approx(np.exp(-5.0) * 6.0, rel=1e-7)


def test_monotone_between_uneven_rows():
    values = [0.1, 0.0999, 0.02, 0.0199, 0.0001]
    rows = "\n".join(f"{r},{v},0,0" for r, v in zip((0.1, 0.2, 0.3, 2.0, 2.1), values, strict=True))
    profile = parse_table(rows, "p.csv")[0]
    found = profile.radial(np.linspace(0.0, 5.0, 4000))
    assert (np.diff(found) <= 0.0).all()
    assert (found > 0.0).all()
    assert found[0] == pytest.approx(values[0], rel=1e-12)  # constant nearer than the first radius


def test_zeros_end_it():
    profile = parse_table("0,.1,0,0\n1,.05,0,0\n2,0,0,0\n3,0,0,0\n", "p.csv")[0]
    np.testing.assert_allclose(profile.radial([1.5, 2.0, 2.5]), [0.025, 0.0, 0.0], atol=1e-15)
    assert profile.tail_share == 0.0
    assert float(profile.total(2.0)) == 0.0
