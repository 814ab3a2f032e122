"""Types of fields that are kept as JSON: arrays, terms and hypotheses, with how each is written and read."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, TypeVar, dataclass_transform

import numpy as np
from pydantic import ConfigDict, PlainSerializer, PlainValidator, with_config

from fitting.arrays import BoolArray, FloatArray
from fitting.residual.findings import Hypothesis
from fitting.residual.stored_terms import term_from_json, term_to_json
from fitting.residual.terms import Term

_T = TypeVar("_T")


# Their types state that infinities are numbers here, which JSON itself does not have.
def _numbers_to_json(value: FloatArray) -> list[float] | list[list[float]]:
    return list(value.tolist())


def _flags_to_json(value: BoolArray) -> list[bool]:
    return list(value.tolist())


def _term(value: Any) -> Term:
    return value if isinstance(value, Term) else term_from_json(value)


def _hypothesis(value: Any) -> Hypothesis:
    if isinstance(value, Hypothesis):
        return value
    return Hypothesis(tuple(term_from_json(term) for term in value["terms"]), value["probability"])


def _hypothesis_to_json(value: Hypothesis) -> dict[str, Any]:
    return {"terms": [term_to_json(term) for term in value.terms], "probability": value.probability}


Numbers = Annotated[FloatArray, PlainValidator(partial(np.asarray, dtype=float)), PlainSerializer(_numbers_to_json)]
Flags = Annotated[BoolArray, PlainValidator(partial(np.asarray, dtype=bool)), PlainSerializer(_flags_to_json)]
StoredTerm = Annotated[Term, PlainValidator(_term), PlainSerializer(term_to_json)]
StoredHypothesis = Annotated[Hypothesis, PlainValidator(_hypothesis), PlainSerializer(_hypothesis_to_json)]
Json = dict[str, Any]


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def stored(cls: type[_T]) -> type[_T]:
    """Make a frozen dataclass that is kept as JSON: keys that it does not have are refused when it is read."""
    return with_config(ConfigDict(extra="forbid"))(dataclass(frozen=True)(cls))
