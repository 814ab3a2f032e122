"""Write the client's typed part from ``docs/openapi.json``; ``setup.py`` does before the client is built.

One class per resource with a method per operation, one TypedDict per schema. What a generator for every OpenAPI file
of the world would have to know is not here; what this service uses is, and anything else is an error.
"""

from __future__ import annotations

import json
import keyword
import os
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "docs" / "openapi.json"
TARGET = Path(__file__).parent / "hilfit_client" / "generated.py"
PREFIX = "/api/v1"
SIMPLE = {"string": "str", "integer": "int", "number": "float", "boolean": "bool", "null": "None"}
HEAD = '''"""Made from docs/openapi.json by clients/python/generate.py; do not edit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal, NotRequired, TypedDict, Unpack

from hilfit_client.transport import Transport
'''


def type_of(schema: dict[str, Any]) -> str:
    """Return Python's type of a schema."""
    if "$ref" in schema:
        return class_name(schema["$ref"].rpartition("/")[2])
    if "anyOf" in schema:
        return " | ".join(dict.fromkeys(type_of(part) for part in schema["anyOf"]))
    if "const" in schema:
        return f"Literal[{schema['const']!r}]"
    if "enum" in schema:
        return f"Literal[{', '.join(map(repr, schema['enum']))}]"
    kind = schema.get("type")
    if kind == "array":
        return f"list[{type_of(schema.get('items', {}))}]"
    if kind == "object":
        more = schema.get("additionalProperties", True)
        return f"dict[str, {type_of(more) if isinstance(more, dict) else 'Any'}]"
    return SIMPLE[kind] if kind else "Any"


def class_name(name: str) -> str:
    """Return a schema's name as a class."""
    return "".join(part[:1].upper() + part[1:] for part in re.split(r"\W+", name))


def typed_dict(name: str, schema: dict[str, Any]) -> str:
    """Write the schema of an object as a class."""
    lines = [f"class {class_name(name)}(TypedDict):", f'    """{first_line(schema.get("description", name))}"""', ""]
    required = set(schema.get("required", ()))
    for key, value in schema.get("properties", {}).items():
        if keyword.iskeyword(key) or not key.isidentifier():
            raise SystemExit(f"{name}: '{key}' cannot be an attribute")
        found = type_of(value)
        lines.append(f"    {key}: {found if key in required else f'NotRequired[{found}]'}")
    return "\n".join(lines)


def first_line(text: str) -> str:
    """Return the first sentence of a description."""
    return " ".join(text.partition("\n\n")[0].split()).replace("``", "`").replace('"', "'")


def answer(operation: dict[str, Any]) -> tuple[str, str]:
    """Return how an answer is read, and its type."""
    found = [value for status, value in sorted(operation["responses"].items()) if status.startswith("2")]
    content = found[0].get("content", {})
    if not content:
        return "nothing", "None"
    if set(content) == {"application/json"}:
        kind = type_of(content["application/json"].get("schema", {"type": "object"}))
        return "json", "dict[str, Any]" if kind == "Any" else kind
    if set(content) == {"text/event-stream"}:
        return "events", "Iterator[dict[str, Any]]"
    if all(media.startswith("text/") for media in content) and len(content) == 1:
        return "text", "str"
    return "content", "bytes"


def method(path: str, verb: str, operation: dict[str, Any]) -> str:
    """Write one operation as a method."""
    name = operation["operationId"].rpartition(".")[2]
    taken: list[str] = []
    positional: list[str] = []
    optional: list[str] = []
    query: list[tuple[str, str]] = []
    headers: list[tuple[str, str]] = []
    for parameter in operation.get("parameters", ()):
        python = parameter["name"].replace("-", "_")
        taken.append(python)
        kind = type_of(parameter["schema"])
        if parameter["in"] == "path":
            positional.append(f"{python}: {kind}")
        else:
            needed = parameter.get("required", False)
            kind = kind if needed or kind.endswith("None") else f"{kind} | None"
            optional.append(f"{python}: {kind}" + ("" if needed else " = None"))
            (query if parameter["in"] == "query" else headers).append((parameter["name"], python))
    sent = []
    media = list(operation.get("requestBody", {}).get("content", {}))
    if media == ["application/json"]:
        schema = operation["requestBody"]["content"]["application/json"]["schema"]
        optional.append(f"**body: Unpack[{type_of(schema)}]")
        sent.append("json=dict(body)")
    elif media:
        positional.append("content: bytes")
        sent.append("content=content")
    if len(set(taken)) != len(taken):
        raise SystemExit(f"{verb} {path}: two parameters have one name")
    for word, pairs in (("query", query), ("headers", headers)):
        if pairs:
            sent.append(f"{word}={{{', '.join(f'{key!r}: {value}' for key, value in pairs)}}}")
    how, kind = answer(operation)
    star = ["*"] if optional and not optional[0].startswith("**") else []
    arguments = ", ".join(["self", *positional, *star, *optional])
    place = re.sub(r"\{(\w+)\}", r"{self._transport.quoted(\1)}", path)
    literal = f'f"{place}"' if "{" in place else f'"{place}"'
    call = f"self._transport.{how}({', '.join([repr(verb.upper()), literal, *sent])})"
    body = f"        {'' if kind == 'None' else 'return '}{call}"
    if how == "json":
        body = f"        answer: {kind} = {call}\n        return answer"
    return f'    def {name}({arguments}) -> {kind}:\n        """{first_line(operation["description"])}"""\n{body}\n'


def generate(text: bytes) -> str:
    """Generate the module from a description."""
    description = json.loads(text)
    parts = [HEAD]
    for name, schema in sorted(description["components"]["schemas"].items()):
        if schema.get("type") == "object":
            parts.append(typed_dict(name, schema))
        else:
            parts.append(f"{class_name(name)} = {type_of(schema)}")
    groups: dict[str, list[str]] = {}
    for path, operations in sorted(description["paths"].items()):
        group = path.removeprefix(PREFIX).strip("/").partition("/")[0]
        for verb, operation in sorted(operations.items()):
            groups.setdefault(group, []).append(method(path, verb, operation))
    for group, methods in groups.items():
        head = f'class {class_name(group)}Api:\n    """What is below ``/{group}``."""\n\n'
        start = "    def __init__(self, transport: Transport) -> None:\n        self._transport = transport\n"
        parts.append(head + "\n".join([start, *methods]))
    lines = [f"        self.{group.replace('-', '_')} = {class_name(group)}Api(transport)" for group in groups]
    parts.append(
        'class Api:\n    """All resources of a service."""\n\n'
        "    def __init__(self, transport: Transport) -> None:\n        self.transport = transport\n" + "\n".join(lines)
    )
    return "\n\n\n".join(part.rstrip("\n") for part in parts) + "\n"


def main() -> None:
    """Write the module, whole or not at all: it may be imported meanwhile."""
    partial = TARGET.with_name(f"{TARGET.name}.{os.getpid()}")
    partial.write_text(generate(SOURCE.read_bytes()), encoding="utf-8")
    partial.replace(TARGET)


if __name__ == "__main__":
    main()
