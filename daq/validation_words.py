"""Problems that pydantic finds with a value, in plain words: by the kind of error and its numbers, not by its own text.

A sentence stands behind the name of its place, as in ``channels[3].unit: must be a text``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from daq.messages import Sentence

#: Kinds of errors, and the code for all of them.
_CODES: tuple[tuple[tuple[str, ...], str], ...] = (
    (("missing",), "daq.value_missing"),
    (("extra_forbidden",), "daq.value_unknown_key"),
    (("string_type", "string_sub_type"), "daq.value_no_text"),
    (("string_too_short",), "daq.value_string_too_short"),
    (("string_too_long",), "daq.value_string_too_long"),
    (("string_pattern_mismatch",), "daq.value_pattern"),
    (("string_unicode",), "daq.value_string_unicode"),
    (("int_type", "int_parsing", "int_from_float"), "daq.value_no_whole_number"),
    (("int_parsing_size",), "daq.value_too_large"),
    (("float_type", "float_parsing"), "daq.value_no_number"),
    (("finite_number",), "daq.value_not_finite"),
    (("bool_type", "bool_parsing"), "daq.value_no_flag"),
    (("greater_than",), "daq.value_greater_than"),
    (("greater_than_equal",), "daq.value_greater_than_equal"),
    (("less_than",), "daq.value_less_than"),
    (("less_than_equal",), "daq.value_less_than_equal"),
    (("multiple_of",), "daq.value_multiple_of"),
    (("list_type", "tuple_type", "set_type", "frozen_set_type", "iterable_type"), "daq.value_no_list"),
    (("too_short",), "daq.value_too_short"),
    (("too_long",), "daq.value_too_long"),
    (("dict_type", "mapping_type", "model_type", "model_attributes_type", "dataclass_type"), "daq.value_no_keys"),
    (("literal_error", "enum"), "daq.value_none_of"),
    (("union_tag_invalid",), "daq.value_no_such_kind"),
    (("union_tag_not_found",), "daq.value_needs_key"),
    (("none_required",), "daq.value_left_out"),
    (("json_invalid", "json_type"), "daq.value_no_json"),
    (("datetime_type", "datetime_parsing", "datetime_from_date_parsing"), "daq.value_no_time"),
    (("timezone_aware",), "daq.value_no_time_zone"),
)
_CODE_OF: Mapping[str, str] = {kind: code for kinds, code in _CODES for kind in kinds}


def in_words(problem: Mapping[str, Any]) -> str:
    """Put one entry of ``ValidationError.errors()`` in plain words.

    What a check of ours raised is its own text; a kind of error that has no words here keeps pydantic's.
    """
    values: Mapping[str, Any] = problem.get("ctx") or {}
    if problem["type"] in ("value_error", "assertion_error"):
        raised = values.get("error")
        return str(raised) if isinstance(raised, Exception) else str(problem["msg"]).partition(", ")[2]
    code = _CODE_OF.get(problem["type"])
    context = {key: _value(value) for key, value in values.items() if key != "error"}
    try:
        return str(problem["msg"]) if code is None else Sentence(code, **context)
    except KeyError:
        return str(problem["msg"])


def _value(value: object) -> object:
    return value.replace("' or '", "', '") if isinstance(value, str) else value
