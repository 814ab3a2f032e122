"""What pydantic finds wrong with a value, in plain words: by the kind of error and its numbers, not by its own text.

A sentence stands behind the name of its place, as in ``channels[3].unit: must be a text``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_WHOLE, _NUMBER, _LIST = "must be a whole number", "must be a number", "must be a list"
_KEYS = "must have keys and values"
_FLAG, _TIME = "must be true or false", "must be a time like 2026-01-31T12:00:00Z"
_ONE_OF = "must be one of {expected}"
_TEXTS: Mapping[str, str] = {
    "missing": "this key is missing",
    "extra_forbidden": "unknown key; remove it",
    "string_type": "must be a text",
    "string_sub_type": "must be a text",
    "string_too_short": "must have {min_length} characters or more",
    "string_too_long": "must have {max_length} characters or fewer",
    "string_pattern_mismatch": "must look like {pattern}",
    "string_unicode": "must be a text in Unicode",
    "int_type": _WHOLE,
    "int_parsing": _WHOLE,
    "int_parsing_size": "is too large a number",
    "int_from_float": _WHOLE,
    "float_type": _NUMBER,
    "float_parsing": _NUMBER,
    "finite_number": "must be a finite number",
    "bool_type": _FLAG,
    "bool_parsing": _FLAG,
    "greater_than": "must be greater than {gt}",
    "greater_than_equal": "must be {ge} or more",
    "less_than": "must be less than {lt}",
    "less_than_equal": "must be {le} or less",
    "multiple_of": "must be a multiple of {multiple_of}",
    "list_type": _LIST,
    "tuple_type": _LIST,
    "set_type": _LIST,
    "frozen_set_type": _LIST,
    "iterable_type": _LIST,
    "too_short": "must have {min_length} entries or more",
    "too_long": "must have {max_length} entries or fewer",
    "dict_type": _KEYS,
    "mapping_type": _KEYS,
    "model_type": _KEYS,
    "model_attributes_type": _KEYS,
    "dataclass_type": _KEYS,
    "literal_error": _ONE_OF,
    "enum": _ONE_OF,
    "union_tag_invalid": "'{tag}' is none of {expected_tags}",
    "union_tag_not_found": "needs the key {discriminator}",
    "none_required": "must be left out",
    "json_invalid": "is no JSON that can be read",
    "json_type": "is no JSON that can be read",
    "datetime_type": _TIME,
    "datetime_parsing": _TIME,
    "datetime_from_date_parsing": _TIME,
    "timezone_aware": "needs a time zone, as in 2026-01-31T12:00:00Z",
}


def _context(problem: Mapping[str, Any]) -> Mapping[str, Any]:
    return problem.get("ctx") or {}


def in_words(problem: Mapping[str, Any]) -> str:
    """One entry of ``ValidationError.errors()`` in plain words.

    What a check of ours raised is its own text; a kind of error that has no words here keeps pydantic's.
    """
    context = {key: f"{value:g}" if isinstance(value, float) else value for key, value in _context(problem).items()}
    if problem["type"] in ("value_error", "assertion_error"):
        return str(problem["msg"]).partition(", ")[2]  # behind what pydantic calls it
    text = _TEXTS.get(problem["type"])
    try:
        return str(problem["msg"]) if text is None else text.format(**context).replace("' or '", "', '")
    except (KeyError, IndexError):
        return str(problem["msg"])
