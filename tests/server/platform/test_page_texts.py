"""What reports, alarms and jobs say in fixed texts has a German text on the page: a new one cannot be forgotten."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Callable, Collection, Iterator

import pytest

from fitting.checks.findings import TEXTS
from fitting.effects import effects
from fitting.pipeline.stage_names import VALVE_WORDS
from fitting.pipeline.stage_names import WORDS as STAGES
from fitting.report.joint_words import _AS_WRITTEN, MOTOR, JointWords
from fitting.report.languages import NAMES, content_of, language
from fitting.valve.effects import EFFECTS as VALVE_EFFECTS
from fitting.valve.laws import LAWS
from server.platform.errors import ServiceError
from server.recalibrations.recalibration_job import WORDS as RECALIBRATION
from tests.server.platform.sentences_in_source import ROOT, every_text, told, trees

WEB = ROOT / "server" / "web" / "src" / "texts"
#: What reports say, by groups; the page has a copy, see `test_pages.py`.
REPORT = content_of("de")["report"]
KNOWN = {english for group in REPORT.values() for english in group}
WORDS = {"cylinder": _AS_WRITTEN, "direct": JointWords(**MOTOR, units={})}


@pytest.mark.parametrize("drive", WORDS)
def test_titles_places_and_experiments_of_all_effects_have_a_german_text(drive: str) -> None:
    said = [text for one in effects() for text in (one.title, one.look_at, one.experiment) if text]
    said += NAMES["causes"].values()
    assert len(said) > 80
    assert sorted({text for text in map(WORDS[drive].text, said) if text not in KNOWN}) == []


#: Where alarms and what a job does are worded; the demonstration is no job.
WORDED = (
    "server/alarms/alarm_watch.py",
    "server/outward/webhook_desk.py",
    "server/monitor/monitor_supervisor.py",
    "server/jobs/execution.py",
    "server/jobs/job_store.py",
    "server/recalibrations/recalibration_recording.py",
    "fitting/pipeline/stages.py",
    "fitting/pipeline/attribution_stage.py",
    "fitting/pipeline/stage_two.py",
    "fitting/loop",
    "fitting/selection",
    "fitting/checks/check.py",
)


def _sentence(node: ast.expr) -> str | None:
    """A literal as it is read, with ``1`` for each value; None for what is no literal."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(str(v.value) if isinstance(v, ast.Constant) else "1" for v in node.values)
    return None


def _sentences(tree: ast.AST) -> Iterator[str]:
    """Second arguments of ``progress``, what is assigned to ``text``, and what ``as_text`` returns."""
    for node in ast.walk(tree):
        found: list[ast.expr] = []
        if isinstance(node, ast.Call) and len(node.args) == 2:
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            found = [node.args[1]] if name == "progress" else []
        elif isinstance(node, ast.Assign):
            several = isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple)
            pairs = (
                zip(node.targets[0].elts, node.value.elts, strict=True) if several else [(node.targets[0], node.value)]
            )
            found = [value for target, value in pairs if getattr(target, "id", "") == "text"]
        elif isinstance(node, ast.FunctionDef) and node.name == "as_text":
            found = [part.value for part in ast.walk(node) if isinstance(part, ast.Return) and part.value is not None]
        yield from (said for one in found if (said := _sentence(one)))


def _known() -> tuple[set[str], list[re.Pattern[str]]]:
    table = (WEB / "service_de.ts").read_text("utf-8")
    fixed = re.findall(r'^  (?:"((?:[^"\\]|\\.)*)"|(\w+)):', table, re.M)
    patterns = re.findall(r"/(\^.+\$)/", table)
    return {quoted or bare for quoted, bare in fixed}, [re.compile(pattern) for pattern in patterns]


@pytest.mark.parametrize("place", WORDED)
def test_alarms_and_what_a_job_does_have_a_german_text(place: str) -> None:
    files = sorted((ROOT / place).glob("*.py")) if (ROOT / place).is_dir() else [ROOT / place]
    said = {text for file in files for text in _sentences(ast.parse(file.read_text("utf-8")))}
    fixed, patterns = _known()
    assert said
    assert sorted(t for t in said if t not in fixed and not any(p.match(t) for p in patterns)) == []


def test_names_of_a_jobs_stages_have_a_german_text() -> None:
    fixed, _ = _known()
    assert {text for words in (STAGES, RECALIBRATION) for text in words.values()} <= fixed
    assert {text[:1].upper() + text[1:] for text in STAGES.values()} <= fixed
    assert {text[:1].upper() + text[1:] for text in VALVE_WORDS.values()} <= _table("valve_de.ts")


def _kinds(kind: type[Exception]) -> Iterator[type[Exception]]:
    """A kind of error and all that are of it, wherever they are declared."""
    yield kind
    for below in kind.__subclasses__():
        yield from _kinds(below)


#: Errors whose text is shown: refusals, and what a job ends with.
ERRORS = {kind.__name__ for kind in _kinds(ServiceError)} | {
    "JobError", "NotLiveError", "InputError", "RecordingError", "MachineFileError", "AcquisitionError", "BusError",
}  # fmt: skip
#: Refusals: folders of the service, and files that read what is uploaded. The command line speaks to no page.
REFUSING = (
    *(
        str(one.relative_to(ROOT))
        for one in sorted((ROOT / "server").iterdir())
        if one.is_dir() and one.name not in ("commands", "web", "__pycache__")
    ),
    *(
        f"daq/recordings/{name}.py"
        for name in (
            "recording_checks",
            "csv_files",
            "recording_files",
            "foreign_files",
            "recording_source",
            "recording",
        )
    ),
    *(f"daq/machine/{name}.py" for name in ("machine_file", "device_files", "can_database")),
    *(f"daq/{name}.py" for name in ("frames/channels", "acquisition/acquisition", "drivers/base", "drivers/can/port")),
)
#: Texts of the machine file's problems and doubts: all there are.
MACHINE_FILE = tuple(
    f"daq/{name}.py"
    for name in (
        *(
            f"machine/{name}"
            for name in ("coherence", "joints", "buses", "bus_places", "linkages", "machine_file_errors", "valves")
        ),
        *("safe_yaml", "machine/plausible", "machine/can_database"),
    )
)
#: Findings: all texts of the checks and of the bus check, and of the drivers about their devices.
FINDING = (
    "fitting/checks",
    "fitting/signals/rods.py",
    *(f"daq/recordings/{name}.py" for name in ("recording_checks", "encoder_wraps")),
    *(f"daq/commissioning/{name}.py" for name in ("check", "identities")),
    "server/bus_checks/running_check.py",
    "daq/drivers/bus_driver.py",
    *(f"daq/drivers/canopen/{name}.py" for name in ("driver", "care", "lead", "look", "node")),
    *(f"daq/drivers/modbus/{name}.py" for name in ("unit", "driver")),
)
#: Fitting, as far as jobs and the live model come to it; the command line and exports speak to no page.
FITTING = (
    *(f"fitting/{name}" for name in ("arm", "estimators", "excitation", "loop", "pipeline", "planning", "regression")),
    *("fitting/report/html.py", "fitting/report/schema/definition.py"),
    *(f"fitting/signals/{name}.py" for name in ("filters", "preparation")),
    "daq/motion_files.py",
    *(f"fitting/model/{name}.py" for name in ("codec", "prediction", "tails")),
)
#: Kinds of errors there, and those of its own.
FITTING_ERRORS = ERRORS | {"HilfitError", "NotPossibleError", "ReportError"}
#: What is wrong with a value.
VALIDATION = "daq/validation_words.py"
#: Sources of texts that are translated and of which not all are shown.
MORE = (
    "daq/units.py",
    "daq/machine/machine_file.py",
    "daq/drivers/modbus/client.py",
    "server/platform/http/request_limits.py",
    "server/recordings/inspect_recording.py",
)
#: Texts that no page shows: logs, units, names, and what only the command line or a program comes to see.
UNSHOWN = {
    "{}", "of the motion", "of the effort", "of the limits", "kgf m", "lbf ft", "machine file", "Value error, ",
    "no such channel", "its unit", "the unit", "the efforts could not be checked: %s", "reading {}", "who is there",
    "at rest", "serial number", "{}/node {}", "{}/unit {}", "the effort", "{} registers {} to {}",
    "{} register {}, decimals", "{} times a second instead of {}", "{}: {}",
    "Bytes that are free for recordings.",
    "bus '{}': no unit answers; check gateway or interface, and cable", "bus '{}' unit {} ({})",
}  # fmt: skip


def _table(name: str) -> set[str]:
    """Keys of a table with words in them; single words and ``COMPOSED`` are no sentences of their own."""
    text = (WEB / name).read_text("utf-8")
    text = re.sub(r"export const (VALUES|COMPOSED)\b.*?^};", "", text, flags=re.M | re.S)
    keys = re.findall(r"""^  (?:"((?:[^"\\]|\\.)*)"|'((?:[^'\\]|\\.)*)'):""", text, re.M)
    return {json.loads(f'"{double}"') if double else single.replace('"', '"') for double, single in keys}


def _told(*places: str, errors: Collection[str] = ERRORS) -> set[str]:
    return {text for tree in trees(*places) for text in told(tree, errors)} - UNSHOWN


#: Sentences of fitting that consist of values.
VALUES_ONLY = {"{}: {}: {}"}


def _every(*places: str) -> set[str]:
    said = {text for tree in trees(*places) for text in every_text(tree)}
    data = TEXTS.values() if "fitting/checks" in places else ()
    return (said | {re.sub(r"(\{[^}]*\})+", "{}", text) for both in data for text in both}) - UNSHOWN


GERMAN = ("refusals_de.ts", "machine_file_de.ts", "findings_de.ts", "fitting_de.ts", "valve_de.ts")
#: What an identification of valves says of itself and refuses; texts of the command line, which no page shows.
VALVES = ("fitting/valve", "fitting/pipeline/valve_stage.py")
VALVES_UNSHOWN = {
    "--to {}: there is no such format; use one of {}",
    "not a valve's model: schema is not hilfit/valve-model/1; give model of a valve report",
}


def _of_valves() -> set[str]:
    named = {text for one in VALVE_EFFECTS.values() for text in (one.title, one.look_at, one.experiment)}
    refused = _told(*VALVES, errors=FITTING_ERRORS) - VALVES_UNSHOWN
    return refused | _every("fitting/valve/checks.py") | named | {law.title for law in LAWS.values()}


#: What is read out of the sources, when a test asks for it.
SAID: dict[str, Callable[[], set[str]]] = {
    "refusals": lambda: _told(*REFUSING),
    "the machine file": lambda: _every(*MACHINE_FILE),
    "findings": lambda: _every(*FINDING),
    "fitting": lambda: _told(*FITTING, errors=FITTING_ERRORS) - VALUES_ONLY,
    "validation": lambda: _every(VALIDATION),
    "valves": _of_valves,
}


@pytest.mark.slow
@pytest.mark.parametrize("what", SAID)
def test_refusals_and_findings_have_a_german_text(what: str) -> None:
    said = SAID[what]()
    assert len(said) > 15
    fixed, patterns = _known()
    known = {key for table in GERMAN for key in _table(table)} | fixed | KNOWN
    assert sorted(text for text in said if text not in known and not any(p.match(text) for p in patterns)) == []


@pytest.mark.slow
def test_no_german_refusal_or_finding_is_left_over_from_a_sentence_that_changed() -> None:
    said = _told(*REFUSING, *MORE) | _every(*MACHINE_FILE, *FINDING, *MORE, VALIDATION)
    said |= _told(*FITTING, errors=FITTING_ERRORS) | _every(*EVENTS) | _every(*VALVES) | _told(*VALVES)
    said |= {text[:1].upper() + text[1:] for text in VALVE_WORDS.values()} | set(VALVE_WORDS.values())
    known = {key for table in GERMAN for key in _table(table)} | {*REPORT["checks"], *REPORT["devices"]}
    assert sorted(text for text in known - said if " " in text) == []


#: Events of recordings that no finding is made of.
EVENTS = tuple(
    f"daq/{name}.py" for name in ("drivers/can/health", "drivers/listening", "acquisition/cycles", "acquisition/trace")
)
#: Where reports get their texts: reasons, warnings, motions, verdicts, estimates.
REPORTED = (
    *(f"fitting/pipeline/{name}.py" for name in ("verdict", "plausibility", "comparison")),
    *(f"fitting/pipeline/results/{name}.py" for name in ("results", "loop_content")),
    *(f"fitting/loop/{name}.py" for name in ("everything", "effort_confirmation", "residual_loop", "search_pieces")),
    *("fitting/selection", "fitting/residual/confirmation", "fitting/pipeline/attribution_stage.py"),
    *("fitting/planning/next_experiment.py", "fitting/excitation/experiments.py"),
    *("fitting/regression/flags.py", "fitting/regression/identifiability.py"),
)
#: What is put together otherwise than it is read out of the source; `test_report_german.py` has it whole.
PUT_TOGETHER = {
    "friction was estimated with the arm attached on", "it is", "they are", "not told", "poorly told",
    "parameters as fitted", "position sensors", "the two position sensors disagree by {} mm, afterwards by {} mm{}",
    "{} {} a standard deviation above {} % of the value: {} poorly determined by these recordings",
}  # fmt: skip


def test_report_and_page_say_the_same_of_the_same_sentence() -> None:
    source = (WEB / "sentences.test.ts").read_text("utf-8")
    tests = re.search(r'it\("of reports are those.*?^  \}\);', source, re.M | re.S)
    assert tests is not None
    pairs = re.findall(r'german\(\s*("(?:[^"\\]|\\.)*"),?\s*\),?\s*\)\.toBe\(\s*("(?:[^"\\]|\\.)*")', tests[0])
    assert len(pairs) == tests[0].count("expect(") >= 6
    assert [language("de").translated(json.loads(english)) for english, _ in pairs] == [
        json.loads(other) for _, other in pairs
    ]


def test_all_that_a_report_says_has_a_german_text() -> None:
    fixed, patterns = _known()  # what is said while it is made
    refused = _told(*REPORTED, errors=FITTING_ERRORS | {"ValueError"})
    said = {text for text in _every(*REPORTED) if text not in PUT_TOGETHER} - refused - fixed
    said = {text for text in said if not any(pattern.match(text.replace("{}", "1")) for pattern in patterns)}
    german = language("de")
    assert len(said) > 70
    assert sorted(text for text in said if text not in KNOWN and german.translated(text) == text) == []
