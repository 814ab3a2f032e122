"""What pydantic finds wrong with a value, in plain words: by the kind of error and its numbers, not by its own text.

A sentence stands behind the name of its place, as in ``channels[3].unit: must be a text``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

#: Kinds of errors, and the words for all of them.
_WORDS: tuple[tuple[tuple[str, ...], str], ...] = (
    (("missing",), "this key is missing"),
    (("extra_forbidden",), "unknown key; remove it"),
    (("string_type", "string_sub_type"), "must be a text"),
    (("string_too_short",), "must have {min_length} characters or more"),
    (("string_too_long",), "must have {max_length} characters or fewer"),
    (("string_pattern_mismatch",), "must look like {pattern}"),
    (("string_unicode",), "must be a text in Unicode"),
    (("int_type", "int_parsing", "int_from_float"), "must be a whole number"),
    (("int_parsing_size",), "is too large a number"),
    (("float_type", "float_parsing"), "must be a number"),
    (("finite_number",), "must be a finite number"),
    (("bool_type", "bool_parsing"), "must be true or false"),
    (("greater_than",), "must be greater than {gt}"),
    (("greater_than_equal",), "must be {ge} or more"),
    (("less_than",), "must be less than {lt}"),
    (("less_than_equal",), "must be {le} or less"),
    (("multiple_of",), "must be a multiple of {multiple_of}"),
    (("list_type", "tuple_type", "set_type", "frozen_set_type", "iterable_type"), "must be a list"),
    (("too_short",), "must have {min_length} entries or more"),
    (("too_long",), "must have {max_length} entries or fewer"),
    (
        ("dict_type", "mapping_type", "model_type", "model_attributes_type", "dataclass_type"),
        "must have keys and values",
    ),
    (("literal_error", "enum"), "must be one of {expected}"),
    (("union_tag_invalid",), "'{tag}' is none of {expected_tags}"),
    (("union_tag_not_found",), "needs the key {discriminator}"),
    (("none_required",), "must be left out"),
    (("json_invalid", "json_type"), "is no JSON that can be read"),
    (("datetime_type", "datetime_parsing", "datetime_from_date_parsing"), "must be a time like 2026-01-31T12:00:00Z"),
    (("timezone_aware",), "needs a time zone, as in 2026-01-31T12:00:00Z"),
)
_TEXTS: Mapping[str, str] = {kind: text for kinds, text in _WORDS for kind in kinds}


def in_words(problem: Mapping[str, Any]) -> str:
    """Put one entry of ``ValidationError.errors()`` in plain words.

    What a check of ours raised is its own text; a kind of error that has no words here keeps pydantic's.
    """
    values: Mapping[str, Any] = problem.get("ctx") or {}
    context = {key: f"{value:g}" if isinstance(value, float) else value for key, value in values.items()}
    if problem["type"] in ("value_error", "assertion_error"):
        return str(problem["msg"]).partition(", ")[2]  # behind what pydantic calls it
    text = _TEXTS.get(problem["type"])
    try:
        return str(problem["msg"]) if text is None else text.format(**context).replace("' or '", "', '")
    except (KeyError, IndexError):
        return str(problem["msg"])
