"""Constants with their source: read by programs."""

from dataclasses import FrozenInstanceError, dataclass

import pytest

from milkglass.core.provenance import chosen, constants, fitted, shapes_in_sample


@dataclass(frozen=True)
class Inner:
    slope: float = fitted(0.5, "of a line", "ball", "plate")


@dataclass(frozen=True)
class Outer:
    inner: Inner = Inner()
    limit: float = chosen(3.0, "mean free paths", "box")


def test_all_are_listed_with_their_values_and_shapes():
    slope, limit = constants(Outer())
    assert (slope.name, slope.value, slope.kind, slope.shapes) == ("inner.slope", 0.5, "fitted", ("ball", "plate"))
    assert (limit.name, limit.value, limit.kind, limit.meaning) == ("limit", 3.0, "chosen", "mean free paths")
    assert shapes_in_sample(Outer()) == {"ball", "plate", "box"}


def test_a_constant_cannot_change():
    with pytest.raises(FrozenInstanceError):
        Inner().slope = 1.0


def test_a_constant_without_provenance_is_refused():
    @dataclass(frozen=True)
    class Bare:
        limit: float = 1.0

    with pytest.raises(TypeError, match="limit"):
        list(constants(Bare()))
