"""Examples drawn by Hypothesis, the same ones in every run."""

import pytest
from hypothesis import HealthCheck, given, settings

MANY = 5_000


def drawn(count, *strategies, **named):
    """A test of so many examples; its fixtures serve all of them, so that each writes its files anew."""
    fixed = settings(
        max_examples=count,
        deadline=None,
        derandomize=True,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    )
    return lambda check: fixed(given(*strategies, **named)(check))


def some_and_many(count, strategy):
    """A test of `check(folder, example)` with so many examples; a long one with many more."""

    def decorate(check):
        @pytest.mark.parametrize("count", [count, pytest.param(MANY, marks=pytest.mark.long)])
        def test(count, tmp_path):
            drawn(count, strategy)(lambda example: check(tmp_path, example))()

        return test

    return decorate
