"""What is wrong with a value, in words of our own; the oracle is what pydantic itself finds."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pytest
from annotated_types import Ge, Gt, Le, Len, Lt
from pydantic import TypeAdapter, ValidationError

from daq.validation_words import in_words


@pytest.mark.parametrize(
    ("kind", "value", "said"),
    [
        (int, "x", "must be a whole number"),
        (int, 1.5, "must be a whole number"),
        (float, "x", "must be a number"),
        (bool, 7, "must be true or false"),
        (str, 7, "must be a text"),
        (list[int], 7, "must be a list"),
        (dict[str, int], 7, "must have keys and values"),
        (Annotated[float, Gt(0)], 0, "must be greater than 0"),
        (Annotated[float, Ge(0.5)], 0, "must be 0.5 or more"),
        (Annotated[int, Lt(3)], 3, "must be less than 3"),
        (Annotated[int, Le(3)], 4, "must be 3 or less"),
        (Annotated[list[int], Len(2)], [1], "must have 2 entries or more"),
        (Annotated[str, Len(1, 3)], "long", "must have 3 characters or fewer"),
        (Literal["a", "b", "c"], "d", "must be one of 'a', 'b', 'c'"),
        (Annotated[float, Gt(0)], float("nan"), "must be greater than 0"),
    ],
)
def test_words(kind: Any, value: Any, said: str) -> None:
    with pytest.raises(ValidationError) as caught:
        TypeAdapter(kind).validate_python(value)
    assert in_words(caught.value.errors()[0]) == said


def test_a_check_of_ours_says_its_own_text_and_an_unknown_kind_keeps_its_own() -> None:
    assert in_words({"type": "value_error", "msg": "Value error, no such unit, give one"}) == "no such unit, give one"
    assert in_words({"type": "strange", "msg": "Strange"}) == "Strange"
    assert in_words({"type": "greater_than", "msg": "Input should be greater"}) == "Input should be greater"
