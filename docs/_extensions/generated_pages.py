"""Reference pages that are made of the program itself, each time the site is built.

``reference/cli.md`` of the commands' parsers, ``reference/rest.md`` of ``openapi.json``, ``reference/effects.md`` of the
catalogue, ``reference/machine-file-keys.md`` and ``reference/report.md`` of the schemas of both files. None of them is
committed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

Content = Mapping[str, Any]


def write_pages(app: Sphinx) -> None:
    """Write every generated page that changed, so that an unchanged one is not built again."""
    docs = Path(app.srcdir)
    pages = {
        "cli": commands(),
        "rest": resources(json.loads((docs / "openapi.json").read_text(encoding="utf-8"))),
        "effects": effects(),
        "machine-file-keys": machine_file(),
        "report": report(),
    }
    for name, lines in pages.items():
        path, text = docs / "reference" / f"{name}.md", "\n".join(lines) + "\n"
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def commands() -> Iterator[str]:
    """Document the command line."""
    from server.commands.command_line import every_command
    from server.commands.conventions import Parameter

    yield "# Command line"
    yield ""
    yield "Made of the commands themselves. `hilfit COMMAND -h` says the same; `hilfit -V` is the version, `hilfit"
    yield "--install-completion` lets the shell complete commands and options. Exit codes: 0 done, 1 failed, 2 bad usage or"
    yield "input. A progress bar with the remaining time is shown on a terminal, never in a pipe."
    for words, command in every_command():
        if words.startswith("bench "):
            continue
        own = [Parameter(words, each) for each in command.params]
        arguments = " ".join(_argument(each.own) for each in own if each.own.param_type_name == "argument")
        yield from ("", f"## hilfit {words}", "", _sentence(command.help or ""), "")
        yield from (
            "```text",
            f"hilfit {words} {'[OPTIONS] ' if any(p.option for p in own) else ''}{arguments}".rstrip(),
            "```",
        )
        if not own:
            continue
        yield from ("", "| | | default | environment |", "|---|---|---|---|")
        for each in own:
            yield _parameter_row(each)


def _argument(own: Any) -> str:
    name = (own.metavar or own.name.upper()) + ("..." if own.nargs == -1 else "")
    return name if own.required else f"[{name}]"


def _parameter_row(each: Any) -> str:
    own = each.own
    word = "" if own.metavar is None else f" {own.metavar}"
    if own.param_type_name == "argument":
        return f"| `{own.metavar or own.name.upper()}` | {_cell(own.help)} |  |  |"
    names = ", ".join(f"`{name}`" for name in own.opts)
    default = own.default
    shown = "" if own.required or default in (None, False, ()) else f"`{getattr(default, 'value', default)}`"
    need = " **needed**" if own.required else ""
    return f"| {names}{f' `{word.strip()}`' if word else ''} | {_cell(own.help)}{need} | {shown} | `{own.envvar}` |"


def resources(described: Content) -> Iterator[str]:
    """Document the REST interface."""
    yield "# REST interface"
    yield ""
    yield "Made of `docs/openapi.json`, which `hilfit serve` also answers at `/api/v1/openapi.json`. Long work is answered with"
    yield "`202` and `Location: /api/v1/jobs/{id}`; errors are problem documents (RFC 9457) on every path. Clients in Python:"
    yield "[clients](../clients.md); who may do what: [access](../access.md)."
    by_tag: dict[str, list[tuple[str, str, Content]]] = {}
    for path, operations in described["paths"].items():
        for method, own in operations.items():
            if method in ("get", "post", "put", "patch", "delete"):
                by_tag.setdefault((own.get("tags") or ["others"])[0], []).append((method.upper(), path, own))
    for tag in sorted(by_tag):
        yield from ("", f"## {tag}", "", "| | | answers |", "|---|---|---|")
        for method, path, own in by_tag[tag]:
            answers = ", ".join(code for code in own["responses"] if code[0] in "23")
            what = own.get("description") or own.get("summary") or ""
            yield f"| `{method} {path}` | {_cell(what.split(chr(10) + chr(10))[0])} | {answers} |"


def effects() -> Iterator[str]:
    """Document the catalogue of effects."""
    from fitting.effects import effects as catalogue

    own = catalogue()
    yield "# Effects"
    yield ""
    yield f"The {len(own)} effects that the loop can name, made of the catalogue (`hilfit effects list`). An effect of your own:"
    yield "[how](../how-to/own-effect.md)."
    for each in sorted(own, key=lambda effect: effect.id):
        yield from ("", f"## {each.id}", "", _sentence(each.title), "", "| | |", "|---|---|")
        yield f"| equation | `{_cell(each.equation)}` |"
        yield f"| acts on | {each.level} |"
        if each.parameters:
            yield "| parameters | " + ", ".join(f"`{p.name}` [{_cell(p.unit)}]" for p in each.parameters) + " |"
        yield f"| parity | {_cell(each.dependence)} |"
        if each.confounders:
            yield "| confused with | " + ", ".join(f"[{name}](#{name})" for name in each.confounders) + " |"
        yield f"| experiment that tells | {_cell(each.experiment)} |"
        yield f"| source | {_cell(each.source)} |"


def machine_file() -> Iterator[str]:
    """Document every key of a machine file."""
    from daq.machine.machine_file import Machine

    yield "# Keys of a machine file"
    yield ""
    yield "Made of the schema (`hilfit machine schema`); what they mean, with examples: [machine file](../machine-file.md)."
    yield from _keys("Machine", Machine.model_json_schema())


def report() -> Iterator[str]:
    """Document every key of a report."""
    from fitting.report.schema.definition import SCHEMA, json_schema

    yield "# Report"
    yield ""
    yield f"`report.json`, schema `{SCHEMA}`, made of its definition. Numbers that do not exist are `null`. Keys may be added, never"
    yield "renamed. Errors are the standard deviation of measured minus predicted effort in the joint's unit (N m or N). What the"
    yield "words mean: [glossary](../glossary.md); how to read it: [from a machine to a report](../your-own-machine.md)."
    yield from _keys("Report", json_schema())


def _keys(root: str, schema: Content) -> Iterator[str]:
    """Write a table of keys for each object of a JSON schema."""
    for name, own in {root: schema, **schema["$defs"]}.items():
        if "properties" not in own:
            continue
        yield from ("", f"## {name}", "")
        if own.get("description"):
            yield from (_sentence(own["description"].split("\n\n")[0]), "")
        yield from ("| key | is | needed |", "|---|---|---|")
        for key, value in own["properties"].items():
            yield f"| `{key}` | {_kind(value)} | {'yes' if key in own.get('required', ()) else ''} |"


def _kind(value: Content) -> str:
    """Describe a schema in a few words."""
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    for key in ("anyOf", "oneOf"):
        if key in value:
            return " or ".join(dict.fromkeys(_kind(each) for each in value[key]))
    if "enum" in value or "const" in value:
        return ", ".join(f"`{each}`" for each in value.get("enum", [value.get("const")]))
    if value.get("type") == "array":
        items = value.get("items")
        return f"list of {_kind(items)}" if items else "list"
    bounds = [f"{sign} {value[key]:g}" for key, sign in _BOUNDS if key in value]
    return " ".join([str(value.get("type", "anything")).replace("null", "nothing"), *bounds])


_BOUNDS = (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤"), ("exclusiveMaximum", "<"))


def _cell(text: str | None) -> str:
    """Format text for a table's cell: one line, without what Markdown or reStructuredText would read."""
    line = " ".join(re.sub(r"``(.+?)``", r"`\1`", re.sub(r":\w+:`~?([^`]+)`", r"`\1`", text or "")).split())
    return line.replace("|", "\\|").replace("<", "&lt;") if "`" not in line else line.replace("|", "\\|")


def _sentence(text: str) -> str:
    line = _cell(text)
    return line[:1].upper() + line[1:] + ("" if line.endswith((".", ":")) else ".")


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before sources are looked for."""
    app.connect("builder-inited", write_pages, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
