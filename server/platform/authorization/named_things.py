"""Types of values that name something which belongs to a machine.

::

    class Proposal(BaseModel):
        identification: IdentificationId

A route or body that takes such a value need do nothing more: :class:`.guard.TypedRoute` looks it
up before the route is called. A test holds that every field and parameter of text either is of one of these types or is
listed as naming nothing.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel, Field

#: A collection, and an id in it.
Thing = tuple[str, str]


@dataclass(frozen=True)
class Names:
    """Says of a type that its values are ids in a collection."""

    collection: str


MachineName = Annotated[str, Field(max_length=80), Names("machines")]
IdentificationId = Annotated[str, Field(max_length=80), Names("identifications")]
ValvesId = Annotated[str, Field(max_length=80), Names("valves")]
RecordingId = Annotated[str, Field(max_length=80), Names("recordings")]
ExcitationId = Annotated[str, Field(max_length=40), Names("excitations")]


def things_of_path(path: str, parameters: Mapping[str, Any], collections: Collection[str]) -> set[Thing]:
    """Parse what a path ``/api/v1/<collection>/{id}/...`` names, if it is one of ``collections``."""
    parts = path.strip("/").split("/")
    collection = parts[2] if len(parts) > 2 else ""
    if collection not in collections:
        return set()
    return {(collection, str(parameters[name])) for name in ("id", "name") if name in parameters}


def names_in(signature: inspect.Signature) -> Callable[[Mapping[str, Any]], set[Thing]]:
    """Build a function that finds all that a call's arguments name, by the types of its parameters."""
    found = {name: parameter.annotation for name, parameter in signature.parameters.items()}
    naming = {name: annotation for name, annotation in found.items() if can_name(annotation)}

    def find(values: Mapping[str, Any]) -> set[Thing]:
        things: set[Thing] = set()
        for name, annotation in naming.items():
            _collect(annotation, values.get(name), things)
        return things

    return find


def can_name(annotation: Any) -> bool:
    """Test whether values of a type can name anything."""
    if _collection(annotation) is not None:
        return True
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return any(can_name(_annotation(field)) for field in annotation.model_fields.values())
    return any(can_name(part) for part in get_args(annotation) if not isinstance(part, str | list))


def _collection(annotation: Any) -> str | None:
    if get_origin(annotation) is Annotated:
        return next((extra.collection for extra in annotation.__metadata__ if isinstance(extra, Names)), None)
    return None


def _annotation(field: Any) -> Any:
    """Return a model field's type, with what pydantic has taken out of it."""
    return Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation


def _collect(annotation: Any, value: Any, things: set[Thing]) -> None:
    """Add what ``value``, of a type, names."""
    collection, origin = _collection(annotation), get_origin(annotation)
    if collection is not None:
        if isinstance(value, str):
            things.add((collection, value))
    elif origin is Annotated:
        _collect(get_args(annotation)[0], value, things)
    elif isinstance(value, BaseModel):
        for name, field in type(value).model_fields.items():
            _collect(_annotation(field), getattr(value, name), things)
    elif origin in (list, tuple) and isinstance(value, list | tuple):
        for entry in value:
            _collect(get_args(annotation)[0], entry, things)
    else:
        for part in get_args(annotation):  # of a union
            _collect(part, value, things)
