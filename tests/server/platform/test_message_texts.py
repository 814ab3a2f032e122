"""Texts of messages: each code that sources name has one in both languages, with the values that they give."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest

from daq.messages import LANGUAGES, message_from_json, texts
from fitting.effects import effect, effects
from fitting.pipeline.stage_names import VALVE_WORDS, WORDS
from fitting.report.joint_words import MOTOR, SLEW, JointWords
from fitting.valve.effects import EFFECTS
from fitting.valve.laws import LAWS
from server.composition.declarations import RESOURCES
from server.monitor.monitor_supervisor import WORDS as DRIFTS
from server.recalibrations.recalibration_job import WORDS as RECALIBRATION
from tests.server.platform.message_cases import PACKAGES, ROOT, codes, placeholders, sample

#: What is looked for in modules; nothing else of their trees is kept.
KINDS = (ast.Call, ast.Constant, ast.JoinedStr, ast.ClassDef)


@cache
def sources() -> tuple[tuple[str, tuple[ast.expr | ast.stmt, ...]], ...]:
    """All modules of the product, each with its nodes of :data:`KINDS`, in the order of :func:`ast.walk`."""
    files = (file for package in (*PACKAGES, "hilfit") for file in sorted((ROOT / package).rglob("*.py")))
    return tuple(
        (
            str(file.relative_to(ROOT)),
            tuple(node for node in ast.walk(ast.parse(file.read_text("utf-8"))) if isinstance(node, KINDS)),
        )
        for file in files
        if "node_modules" not in file.parts
    )


def _beside_values(made: ast.expr) -> frozenset[str]:
    """What else is given where a message is made: the place of a value that cannot be."""
    return frozenset({"at"} if isinstance(made, ast.Name) and made.id == "BadValueError" else ())


@cache
def named() -> tuple[tuple[str, int, str, frozenset[str] | None], ...]:
    """File, line, code and the names of values of each constant that is a code; None where others give values."""
    known, found = set(codes()), []
    for file, nodes in sources():
        calls = {
            id(node.args[0]): frozenset(own.arg or "**" for own in node.keywords) - _beside_values(node.func)
            for node in nodes
            if isinstance(node, ast.Call) and node.args
        }
        found += [
            (file, node.lineno, node.value, calls.get(id(node)))
            for node in nodes
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in known
        ]
    return tuple(found)


def put_together() -> re.Pattern[str]:
    """Codes that sources put together: ``fitting.check_{key}``; of one that is nothing but a value, see ``VALUES``."""
    forms = (
        "".join(re.escape(str(part.value)) if isinstance(part, ast.Constant) else ".+" for part in node.values)
        for _, nodes in sources()
        for node in nodes
        if isinstance(node, ast.JoinedStr)
    )
    named_by = (form for form in forms if re.match(rf"({'|'.join(PACKAGES)})\\\.\w", form) and " " not in form)
    return re.compile("|".join(sorted(set(named_by))))


#: Codes that are a value of the program: how a parameter is told (`fitting.regression.identifiability`).
VALUES = {"fitting.assumed", "fitting.not_told", "fitting.poorly_told"}


@pytest.mark.slow
def test_sources_give_the_values_that_a_text_names() -> None:
    off = [
        f"{file}:{line}: {code} gets {sorted(given)}"
        for file, line, code, given in named()
        if given and "**" not in given and given != placeholders(english(code)).keys()
    ]
    assert off == []


@pytest.mark.slow
def test_sources_name_no_message_that_there_is_not() -> None:
    known, found = set(codes()), set()
    for file, nodes in sources():
        for node in nodes:
            if isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
                name = getattr(node.func, "id", getattr(node.func, "attr", ""))
                text = node.args[0].value
                if (name == "Sentence" or (name.endswith("Error") and node.keywords)) and text not in known:
                    found.add(f"{file}:{node.lineno}: {text}")
    assert sorted(found) == []


def test_what_is_kept_has_a_text_for_where_there_is_none() -> None:
    classes = [node for _, nodes in sources() for node in nodes if isinstance(node, ast.ClassDef)]
    said = [ast.literal_eval(word.value) for node in classes for word in node.keywords if word.arg == "noun"]
    of_a_machine = [name.removesuffix("s") for resource in RESOURCES for name in resource.of_a_machine]
    assert {"job", "identification of valves"} <= set(said) and "recording" in of_a_machine
    keys = {f"none_{noun.replace(' ', '_')}" for noun in said + of_a_machine}
    texts_of = {language: texts("server", language)["messages"] for language in LANGUAGES}
    missing = [f"{language}.json: {key}" for language, own in texts_of.items() for key in sorted(keys - own.keys())]
    assert missing == [], "add each to server/texts, as 'none_job' is there"


def refusals() -> set[str]:
    """Names of what is raised on purpose: ``HilfitError`` and all that is made of it, and what ends a job's step."""
    bases = {
        node.name: {ast.unparse(base).rpartition(".")[2] for base in node.bases}
        for _, nodes in sources()
        for node in nodes
        if isinstance(node, ast.ClassDef)
    }
    found = {"HilfitError", "TakenOver", "ServiceStopping"}
    while more := {name for name, above in bases.items() if above & found} - found:
        found |= more
    return found


def is_sentence(text: ast.expr) -> bool:
    """Return whether an expression puts a text together, or is one that is no code."""
    if isinstance(text, ast.IfExp):
        return is_sentence(text.body) or is_sentence(text.orelse)
    if isinstance(text, ast.Constant):
        return text.value not in {"", *codes()}
    if isinstance(text, ast.Call):
        return getattr(text.func, "attr", "") in ("join", "format")
    return isinstance(text, ast.JoinedStr | ast.BinOp)


@pytest.mark.slow
def test_no_refusal_is_raised_with_a_sentence() -> None:
    names = refusals()
    assert {"InputError", "StartError", "RecordingError", "SimulationError", "ReportError"} <= names
    found = [
        f"{file}:{node.lineno}: {ast.unparse(node)}"
        for file, nodes in sources()
        for node in nodes
        if isinstance(node, ast.Call)
        and getattr(node.func, "id", getattr(node.func, "attr", "")) in names
        and node.args
        and is_sentence(node.args[0])
    ]
    assert found == []


@pytest.mark.slow
def test_no_message_is_left_over() -> None:
    used, made = {code for _, _, code, _ in named()} | VALUES, put_together()
    assert sorted(code for code in codes() if code not in used and not made.fullmatch(code)) == []


def english(code: str) -> str:
    """The English text."""
    package, _, key = code.partition(".")
    return texts(package, "en")["messages"][key]


def numbers(text: str) -> dict[str, str]:
    """Name the values of a text, with the formats of numbers; what joins a list is the language's own."""
    return {name: spec if spec[-1:] in "gf%," else "" for name, spec in placeholders(text).items()}


@pytest.mark.parametrize("package", PACKAGES)
def test_languages_have_the_same_keys_and_values(package: str) -> None:
    for language in LANGUAGES:
        own = texts(package, language)["messages"]
        assert list(own) == sorted(texts(package, "en")["messages"])
        off = [key for key, text in own.items() if numbers(text) != numbers(english(f"{package}.{key}"))]
        assert off == []


def test_every_message_is_worded_and_read_again() -> None:
    for number, code in enumerate(codes()):
        message = sample(code, number)
        again = message_from_json(json.loads(json.dumps(message.to_json())))
        assert (again, again.worded("de")) == (message, message.worded("de"))


def test_files_are_written_as_a_program_would(tmp_path: Path) -> None:
    for package in PACKAGES:
        for language in LANGUAGES:
            text = (ROOT / package / "texts" / f"{language}.json").read_text("utf-8")
            assert text == json.dumps(json.loads(text), ensure_ascii=False, indent=1) + "\n"


def test_fixed_texts_that_are_shown_have_a_german_word() -> None:
    stages = [*WORDS.values(), *VALVE_WORDS.values(), *RECALIBRATION.values()]
    said = [*stages, *(text[:1].upper() + text[1:] for text in stages), *DRIFTS.values()]
    said += [own for one in EFFECTS.values() for own in (one.title, one.look_at, one.experiment)]
    said += [law.title for law in LAWS.values()]
    assert len(said) > 50
    assert_german(said)


@pytest.mark.parametrize("name", [one.id for one in effects()])
def test_what_an_effect_says_has_german_words_at_every_drive(name: str) -> None:
    one = effect(name)
    drives = (JointWords({}, {}), JointWords(**MOTOR), JointWords(**SLEW))
    assert_german(words.text(own) for words in drives for own in (one.title, one.look_at, one.experiment) if own)


def assert_german(said: Iterable[str]) -> None:
    missing = sorted({*said}.difference(*(texts(package, "de")["words"] for package in PACKAGES)))
    assert not missing, f"add these to `words` of fitting/texts/de.json, then run 'make generated': {missing}"
