"""Frames and files of anybody at the parsers: nothing raises, and nothing is taken for what it is not."""

from __future__ import annotations

import pytest
from fuzz_targets import TARGETS
from hypothesis import HealthCheck, given, settings

pytestmark = pytest.mark.slow

QUICK = settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.large_base_example]
)


@pytest.mark.parametrize("name", TARGETS)
def test_a_parser_takes_whatever_comes(name: str) -> None:
    target = TARGETS[name]
    with target.opened() as check:
        QUICK(given(target.values())(check))()
