"""Stages run when, and only when, what they depend on has changed."""

import numpy as np
import pytest

from milkglass.core.stages import Allowance, Stage, Stages, Unfinished


class Clock:
    """Seconds that pass when told to."""

    def __init__(self) -> None:
        self.now = 0.0

    def read(self) -> float:
        return self.now

    def pass_by(self, seconds: float) -> None:
        self.now += seconds


def test_runs_again_only_for_other_dependencies() -> None:
    stages, calls = Stages(), []
    for value in (1, 1, 2, 2, 1):
        assert stages.run(Stage.DEPOSIT, [value], lambda v=value: calls.append(v) or v * v) == value * value
    assert calls == [1, 2, 1]


def test_arrays_count_by_identity_and_other_values_by_equality() -> None:
    stages, calls = Stages(), []
    array = np.zeros(3)
    for dependency in (array, array, array.copy(), (1.0, 2.0), (1.0, 2.0)):
        stages.run(Stage.DEPOSIT, [dependency], lambda: calls.append(1))
    assert len(calls) == 3


def test_numbered_stages_are_told_apart_and_print_their_words() -> None:
    stages = Stages()
    for i in (1, 2):
        stages.run(Stage.FLUX.of(i), [], lambda i=i: i)
    assert [f"{stage}" for stage in stages.timings] == ["flux 1", "flux 2"]
    assert [(stage.stage, stage.number) for stage in stages.timings] == [(Stage.FLUX, 1), (Stage.FLUX, 2)]
    assert stages.run(Stage.FLUX.of(2), [], lambda: 7) == 2
    assert not stages.has(Stage.FLUX, [])


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The clock of the stages, in whose place time passes when told to."""
    clock = Clock()
    monkeypatch.setattr("milkglass.core.stages.time.perf_counter", clock.read)
    return clock


def test_timings_are_those_of_the_stages_that_ran(clock: Clock) -> None:
    stages = Stages()
    stages.run(Stage.DEPOSIT, [0], lambda: clock.pass_by(0.01))
    assert stages.timings == {Stage.DEPOSIT: pytest.approx(10.0)}
    stages.begin()
    stages.run(Stage.DEPOSIT, [0], lambda: clock.pass_by(0.01))
    assert stages.timings == {}


def test_a_stage_inside_another_counts_for_itself(clock: Clock) -> None:
    def outer() -> None:
        clock.pass_by(0.01)
        stages.run(Stage.CONVOLUTION, [0], lambda: clock.pass_by(0.05))
        clock.pass_by(0.02)

    stages = Stages()
    stages.run(Stage.BODIES, [0], outer)
    assert stages.timings == {Stage.CONVOLUTION: pytest.approx(50.0), Stage.BODIES: pytest.approx(30.0)}


def test_a_failed_stage_is_not_kept() -> None:
    stages = Stages()
    with pytest.raises(ZeroDivisionError):
        stages.run(Stage.DEPOSIT, [0], lambda: 1 // 0)
    assert stages.run(Stage.DEPOSIT, [0], lambda: 7) == 7


def counted(n, taken):
    """Work of n steps, each of which says so."""
    for i in range(n):
        if i > 0:
            yield
        taken.append(i)
    return n


def test_spread_work_is_done_at_once_without_an_allowance() -> None:
    stages, taken = Stages(), []
    assert [stages.spread(Stage.DEPOSIT, [0], lambda: counted(5, taken)) for _ in range(2)] == [5, 5]
    assert taken == [0, 1, 2, 3, 4]


def test_spread_work_goes_on_from_frame_to_frame_and_is_kept() -> None:
    stages, taken = Stages(), []
    for after in (3, 6):
        stages.begin(Allowance(2, 60.0))
        with pytest.raises(Unfinished):
            stages.spread(Stage.DEPOSIT, [0], lambda: counted(7, taken))
        assert taken == list(range(after))
    stages.begin(Allowance(2, 60.0))
    assert stages.spread(Stage.DEPOSIT, [0], lambda: counted(7, taken)) == 7
    assert taken == list(range(7))
    assert stages.has(Stage.DEPOSIT, [0])


def test_spread_work_is_abandoned_for_other_work_and_where_nobody_asks_for_it() -> None:
    stages, taken = Stages(), []
    stages.begin(Allowance(1, 60.0))
    with pytest.raises(Unfinished):
        stages.spread(Stage.DEPOSIT, [0], lambda: counted(5, taken))
    with pytest.raises(Unfinished):
        stages.spread(Stage.DEPOSIT, [1], lambda: counted(5, taken))
    assert taken == [0, 1, 0]
    for _ in range(2):
        stages.begin(Allowance(0, 60.0))
    with pytest.raises(Unfinished):
        stages.spread(Stage.DEPOSIT, [1], lambda: counted(5, taken))
    assert taken == [0, 1, 0, 0]


def test_spread_work_that_failed_begins_anew() -> None:
    stages = Stages()

    def failing():
        yield
        raise ZeroDivisionError

    stages.begin(Allowance(5, 60.0))
    with pytest.raises(ZeroDivisionError):
        stages.spread(Stage.DEPOSIT, [0], failing)
    assert stages.spread(Stage.DEPOSIT, [0], lambda: counted(1, [])) == 1


def test_arrays_in_tuples_are_compared_by_identity():
    stages, array = Stages(), np.zeros(3)
    kept = stages.run(Stage.SAMPLES, [(array, 1)], object)
    assert stages.run(Stage.SAMPLES, [(array, 1)], object) is kept
    assert stages.run(Stage.SAMPLES, [(np.zeros(3), 1)], object) is not kept
