"""Stages run when, and only when, what they depend on has changed."""

import time

import numpy as np
import pytest

from core.stages import Stages


def test_runs_again_only_for_other_dependencies() -> None:
    stages, calls = Stages(), []
    for value in (1, 1, 2, 2, 1):
        assert stages.run("square", [value], lambda v=value: calls.append(v) or v * v) == value * value
    assert calls == [1, 2, 1]


def test_arrays_count_by_identity_and_other_values_by_equality() -> None:
    stages, calls = Stages(), []
    array = np.zeros(3)
    for dependency in (array, array, array.copy(), (1.0, 2.0), (1.0, 2.0)):
        stages.run("stage", [dependency], lambda: calls.append(1))
    assert len(calls) == 3


def test_timings_are_those_of_the_stages_that_ran() -> None:
    stages = Stages()
    stages.run("a", [0], lambda: time.sleep(0.01))
    assert stages.timings["a"] >= 10.0
    stages.begin()
    stages.run("a", [0], lambda: time.sleep(0.01))
    assert stages.timings == {}


def test_a_stage_inside_another_counts_for_itself() -> None:
    stages = Stages()
    stages.run("outer", [0], lambda: stages.run("inner", [0], lambda: time.sleep(0.05)))
    assert stages.timings["inner"] >= 50.0
    assert stages.timings["outer"] < 25.0


def test_a_failed_stage_is_not_kept() -> None:
    stages = Stages()
    with pytest.raises(ZeroDivisionError):
        stages.run("a", [0], lambda: 1 // 0)
    assert stages.run("a", [0], lambda: 7) == 7
