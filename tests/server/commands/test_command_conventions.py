"""All commands alike: words for values, one meaning for each name in the environment, JSON where something is said."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import defaultdict
from typing import Any

import pytest

from daq.errors import InputError
from server.commands import command_line as cli
from server.commands import conventions
from server.commands.conventions import Parameter
from server.platform.settings import Settings

COMMANDS = dict(cli.every_command())
#: Prints nothing but JSON as it is.
ALWAYS_JSON = {"machine schema", "model schema"}


def parameters() -> list[Parameter]:
    return [Parameter(words, own) for words, command in COMMANDS.items() for own in command.params]


def test_every_command_is_walked() -> None:
    named = {words.split()[0] for words in COMMANDS}
    assert named == {name for part in cli.all_parts() for name in part.commands}
    assert {"effects show", "bus restore", "bench", "bench samples"} <= set(COMMANDS)


def test_every_command_prints_json_where_asked() -> None:
    without = {words for words, command in COMMANDS.items() if "json" not in {own.name for own in command.params}}
    assert without == ALWAYS_JSON


def test_a_name_in_the_environment_means_one_thing() -> None:
    readers: dict[str, set[str]] = defaultdict(set)
    for parameter in parameters():
        if parameter.option is not None:
            readers[str(parameter.own.envvar)].add(f"{parameter.command} {parameter.option}")
    several = {name: who for name, who in readers.items() if len(who) > 1}
    shared = {f"HILFIT_{name.upper()}" for name in conventions.COMMON_OPTIONS | conventions.SERVICE_OPTIONS}
    assert set(several) <= shared, several
    for who in several.values():  # the same option everywhere
        assert len({text.rpartition(" ")[2] for text in who}) == 1
    assert "HILFIT_SEED" not in readers
    assert {"HILFIT_DEMO_SEED", "HILFIT_EXCITE_SEED", "HILFIT_PORT", "HILFIT_DATA_DIR"} <= set(readers)


def test_names_without_a_command_are_settings_of_the_service() -> None:
    assert set(Settings.model_fields) >= conventions.SERVICE_OPTIONS


def test_an_option_that_is_no_setting_never_takes_the_name_of_one() -> None:
    settings = {f"HILFIT_{name.upper()}" for name in Settings.model_fields}
    for parameter in parameters():
        if parameter.option is not None and str(parameter.own.envvar) in settings:
            assert parameter.own.name in conventions.SERVICE_OPTIONS | conventions.COMMON_OPTIONS, parameter


def test_values_have_one_word_for_a_kind() -> None:
    known = {
        *conventions.METAVARS.values(),
        *conventions.METAVARS_OF_COMMANDS.values(),
        *conventions.METAVARS_OF_KINDS.values(),
        "DIR",
    }
    words: dict[str, set[str]] = defaultdict(set)
    for parameter in parameters():
        if parameter.own.metavar is not None and not parameter.command.startswith("bench"):
            assert parameter.own.metavar in known, (parameter.command, parameter.own.name)
            words[f"{parameter.own.name}"].add(parameter.own.metavar)
    ambiguous = {name for name, own in words.items() if len(own) > 1}
    assert ambiguous <= {"machine", "output", "file", "source", "trace"}, {name: words[name] for name in ambiguous}


def test_the_name_of_before_is_an_error_that_names_the_one_of_now(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HILFIT_SEED", "3")
    with pytest.raises(InputError, match=r"HILFIT_SEED: .*write HILFIT_EXCITE_SEED for 'hilfit excite'"):
        conventions.refuse_old_names("excite", COMMANDS["excite"])
    conventions.refuse_old_names("identify", COMMANDS["identify"])  # has no --seed
    monkeypatch.delenv("HILFIT_SEED")
    monkeypatch.setenv("HILFIT_FAULTS", "storm.yaml")  # the service's own
    conventions.refuse_old_names("demo", COMMANDS["demo"])


def test_a_variable_sets_the_option_of_its_command_only(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HILFIT_EFFECTS_LIST_JSON", "1")  # nobody reads it
    monkeypatch.setenv("HILFIT_JSON", "1")
    with pytest.raises(SystemExit):
        cli.main(["effects", "list"])
    assert "stribeck" in {entry["id"] for entry in json.loads(capsys.readouterr().out)}


def complete(line: str, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the shell offers for the last word of a line."""
    words = line.split(" ")
    environment = {"_HILFIT_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    done: Any = subprocess.run(
        [sys.executable, "-m", "server.commands.command_line"], capture_output=True, text=True, check=True, timeout=240
    )
    return list(done.stdout.split())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "offered"),
    [("hilfit ident", ["identify"]), ("hilfit demo --se", ["--seconds", "--seed"]), ("hilfit effects l", ["list"])],
)
def test_the_shell_completes_commands_and_options(
    line: str, offered: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert sorted(complete(line, monkeypatch)) == offered


def test_the_short_option_for_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["-V"])
    assert capsys.readouterr().out.startswith("hilfit ")
