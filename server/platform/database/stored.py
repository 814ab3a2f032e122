"""Things that a resource keeps, declared once: a :class:`Stored` gives its table, and what is shown of it.

::

    class Toy(Stored, table="toys", noun="toy"):
        id: Id
        machine: OfMachine
        colours: tuple[str, ...]                    # JSON, as all that is no text, number or flag
        secret_sha256: Annotated[str, HIDDEN]       # kept, never shown

    class ToyResource(Toy):
        \"""A toy, as the OpenAPI description calls it.\"""

A table has a ``number`` besides, the order in which its rows were made, unless a field is part of its key.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, Self, Union, get_args, get_origin

import sqlalchemy as sa
from pydantic import Field, GetJsonSchemaHandler
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, to_jsonable_python

from server.platform.database.schema import metadata
from server.platform.http.bodies import Shown, with_messages_of


@dataclass(frozen=True)
class Kept:
    """Form in which a field is kept, where its type does not say it.

    Attributes
    ----------
    references : ``table.column`` that it has to be found in
    ondelete : what becomes of its row when the one that it references goes
    key : whether it is part of the primary key
    """

    references: str | None = None
    ondelete: str | None = None
    unique: bool = False
    index: bool = False
    key: bool = False


#: Of a field that is kept elsewhere than in the table.
BESIDE = object()
#: Of a field that is kept and never shown.
HIDDEN = Field(exclude=True, repr=False)
Id = Annotated[str, Kept(unique=True)]
OfMachine = Annotated[str, Kept(references="machines.name", index=True)]
OfJob = Annotated[str, Kept(references="jobs.id", unique=True)]
#: Counts the changes of a row, for ``ETag``.
Revision = Annotated[int, HIDDEN]
_TYPES: Mapping[Any, Any] = {str: sa.String, int: sa.Integer, float: sa.Float, bool: sa.Boolean}


class Stored(Shown):
    """Content of one row of a table."""

    table: ClassVar[sa.Table]
    #: What one is called where it is refused, of what is asked for by its id.
    noun: ClassVar[str]
    _declared: ClassVar[frozenset[str]] = frozenset()

    def __init_subclass__(cls, **declared: str) -> None:
        """Take what a class declares of its table, which is made once its fields are known."""
        super().__init_subclass__()

    @classmethod
    def __pydantic_init_subclass__(cls, *, table: str | None = None, noun: str = "", **info: str) -> None:
        """Make the table of a class that names one; ``info`` names which columns are its time, label and machine."""
        if table is not None:
            cls.table = sa.Table(table, metadata, *_columns(cls.model_fields), info=info)
            cls.noun = noun
            cls._declared = frozenset(cls.model_fields)

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Describe what is kept as always there, whatever a new one begins with."""
        schema = handler(core)
        found = handler.resolve_ref_schema(schema)
        shown = found.get("properties", {})
        for name in shown.keys() & cls._declared:
            shown[name].pop("default", None)
        always = cls._declared | set(found.get("required", ()))
        found["required"] = [name for name in shown if name in always]
        return schema

    @classmethod
    def read(cls, row: sa.Row[Any], **beside: Any) -> Self:
        """Return what a row holds; ``beside`` are fields that are kept elsewhere."""
        return cls.model_validate({**row._mapping, **beside})

    def columns(self) -> dict[str, Any]:
        """Return what its row holds."""
        return {
            name: to_jsonable_python(value) if isinstance(self.table.c[name].type, sa.JSON) else value
            for name, value in self
            if name in self.table.c
        }

    def but(self, **values: Any) -> Self:
        """Return the same with other values of some fields."""
        return self.model_copy(update=with_messages_of(values, type(self).model_fields))


def _columns(fields: Mapping[str, FieldInfo]) -> Iterator[sa.Column[Any]]:
    kept = {name: field for name, field in fields.items() if BESIDE not in field.metadata}
    if not any(_kept(field).key for field in kept.values()):
        yield sa.Column("number", sa.Integer, primary_key=True)
    for name, field in kept.items():
        own, kinds = _kept(field), _kinds(field.annotation)
        kind, nullable = (kinds - {NoneType}).pop(), NoneType in kinds
        to = [] if own.references is None else [sa.ForeignKey(own.references, ondelete=own.ondelete)]
        yield sa.Column(
            name,
            _TYPES.get(kind) or sa.JSON(none_as_null=nullable),
            *to,
            primary_key=own.key,
            nullable=nullable,
            unique=own.unique or None,
            index=own.index or None,
        )


def _kept(field: FieldInfo) -> Kept:
    return next((own for own in field.metadata if isinstance(own, Kept)), Kept())


def _kinds(annotation: Any) -> set[Any]:
    """List the types a value may have; that of a literal is that of its values."""
    origin = get_origin(annotation)
    if origin in (Union, UnionType):
        return set().union(*map(_kinds, get_args(annotation)))
    if origin is Literal:
        return {type(value) for value in get_args(annotation)}
    return {_kinds(get_args(annotation)[0]).pop() if origin is Annotated else annotation}
