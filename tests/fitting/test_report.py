"""The report: what it says for each verdict, that it is whole, safe, self-contained and the same every time."""

from __future__ import annotations

import copy
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.messages import Sentence
from fitting.report.html import write_report
from fitting.report.model import Course, Figures, FrictionCurve, Scatter
from fitting.report.schema import file
from fitting.report.schema.definition import ReportError, json_schema, validate_report
from fitting.report.text import moment, moved, number, percent, unit, with_std
from fitting.report.wording import as_chance, chance, explanation, follows, nearest, readable, sizes, verdict_sentence

JOINTS = tuple(f"joint{i}" for i in range(1, 7))
FLOORS = (41.0, 52.3, 30.1, 11.2, 4.31, 0.874)


def sample_report(verdict: str = "effect_added") -> dict[str, Any]:
    """A report as an identification of the folding arm writes it."""
    blamed = verdict != "nothing_missing"
    errors = {}
    for joint, floor in zip(JOINTS, FLOORS, strict=True):
        factor = 4.02 if blamed and joint == "joint2" else 1.08
        errors[joint] = {
            "unit": "N m",
            "noise_floor": floor,
            "before": {"train": 0.97 * factor * floor, "validate": factor * floor},
            "after": {"train": 1.02 * floor, "validate": (1.07 if blamed else 1.08) * floor},
            "two_stage": {"train": 1.05 * factor * floor, "validate": 1.11 * factor * floor},
        }
    effect: dict[str, Any] = {
        "id": "position_dependent_friction",
        "title": "Friction that depends on position",
        "equation": "F = (k1 (x - xm) + k2 (x - xm)^2) sgn(x')",
        "joint": "joint2",
        "parameters": {
            "k1": {"value": 8123.4, "std": 96.2, "unit": "N/m"},
            "k2": {"value": -1.21e4, "std": 5.2e3, "unit": "N/m^2"},
        },
        "indistinguishable_from": [],
        "evidence": {"score": 2810.2, "gain": 0.734, "validate_gain": 0.729, "blocks_better": 20, "blocks": 20},
    }
    loop: dict[str, Any] = {
        "verdict": verdict,
        "effects": [effect],
        "unexplained": [],
        "candidates": [
            {
                "id": "position_dependent_friction",
                "joint": "joint2",
                "score": 2810.2,
                "status": "accepted",
                "reason": "best of all, confirmed on the validation motion",
            },
            {
                "id": "load_dependent_friction",
                "joint": "joint2",
                "score": 318.7,
                "status": "rejected",
                "reason": "explains 11 % of what the best one explains, and nothing once that one is added",
            },
            {"id": "stribeck", "joint": "joint2", "score": 6.1, "status": "rejected", "reason": "below the threshold"},
            {"id": "base_tilt", "joint": None, "score": 0.4, "status": "rejected", "reason": "below the threshold"},
            {
                "id": "supply_ripple",
                "joint": "joint5",
                "score": 19.2,
                "status": "artefact",
                "reason": "moves with the filter's cut-off",
            },
        ],
        "detection_limits": [
            {"id": "stribeck", "joint": "joint2", "smallest": 84.2, "unit": "N"},
            {"id": "sensor_latency", "joint": "joint3", "smallest": 0.00123, "unit": "s"},
            {"id": "base_tilt", "joint": None, "smallest": 0.0041, "unit": "rad"},
        ],
        "next_experiment": None,
    }
    if verdict == "nothing_missing":
        loop.update(effects=[])
        for candidate in loop["candidates"]:
            candidate.update(status="rejected", score=2.0, reason="below the threshold")
    elif verdict == "ambiguous":
        effect["indistinguishable_from"] = [
            {"id": "load_dependent_friction", "joint": "joint2"},
            {"id": "pressure_dependent_friction", "joint": "joint2"},
        ]
        loop["candidates"][1].update(status="indistinguishable", score=2741.0, reason="98 % of the best one's score")
        loop["next_experiment"] = {
            "motion": "Move joint2 over its whole stroke at 40 mm/s, once with joint3 folded and once stretched out.",
            "why": "The load on joint2 then differs at equal piston positions, so that position and load come apart.",
            "separates": ["position_dependent_friction", "load_dependent_friction"],
        }
    elif verdict == "unexplained":
        grid = np.linspace(0.02, 0.28, 9)
        loop.update(
            effects=[],
            unexplained=[
                {
                    "joint": "joint2",
                    "variable": "piston_position",
                    "law": {"grid": grid, "value": 900 * np.sin(20 * grid), "std": np.full(9, 31.0)},
                    "evidence": {"gain": 0.71},
                }
            ],
        )
        loop["candidates"][0].update(status="rejected", reason="leaves 61 % of the structure on the validation motion")
    return {
        "schema": "hilfit/report/1",
        "machine": "folding-arm",
        "created": "2026-03-02T09:14:05Z",
        "software": {"hilfit": "0.1.0", "numpy": "2.4.6", "scipy": "1.17.1", "python": "3.11.2"},
        "bandwidth_hz": 3.0,
        "noise_floor_method": "repeat",
        "self_check": {"regressor_against_dynamics": 3.1e-14, "passed": True},
        "data": [
            {"role": role, "file": f"{role}-{n}.parquet", "sha256": f"{n}" * 64, "samples": 3000}
            for n, role in enumerate(("unloaded", "train", "train", "repeat", "validate"))
        ],
        "reduction": {"standard_parameters": 78, "base_parameters": 18},
        "cylinders": {
            joint: {
                "parameters": {
                    "m": {"value": 7.13 + i, "std": 0.42, "unit": "kg"},
                    "K": {"value": 51234.0 - 3000 * i, "std": 312.0, "unit": "N/m"},
                    "f_c": {"value": 612.0 / (i + 1), "std": 9.4, "unit": "N"},
                    "f_v": {"value": 3100.0, "std": 151.0, "unit": "N s/m"},
                    "f_s": {"value": 81.0, "std": 47.0, "unit": "N (s/m)^(1/3)"},
                },
                "stage_1": {
                    "m": {"value": 7.4 + i, "std": 0.6, "unit": "kg"},
                    "K": {"value": 51100.0 - 3000 * i, "std": 410.0, "unit": "N/m"},
                    "f_c": {"value": 640.0 / (i + 1), "std": 12.0, "unit": "N"},
                    "f_v": {"value": 3010.0, "std": 201.0, "unit": "N s/m"},
                    "f_s": {"value": 62.0, "std": 60.0, "unit": "N (s/m)^(1/3)"},
                },
                "residual_std": 97.1,
                "unit": "N",
            }
            for i, joint in enumerate(JOINTS)
        },
        "rigid_body": {
            "estimator": "gls",
            "condition_number": 61.4,
            "parameters": [
                {
                    "expression": f"{symbol}{i}" + (f" + {0.92**2:.4g} (m{i + 1} + m6)" if symbol == "ZZ" else ""),
                    "value": size / i,
                    "std": 0.004 * size * i**2,
                    "unit": units,
                }
                for i in range(1, 7)
                for symbol, size, units in (("ZZ", 431.2, "kg m^2"), ("MX", 212.0, "kg m"), ("MY", 3.1, "kg m"))
            ],
        },
        "one_shot": {
            "condition_number": 912.0,
            "errors": {joint: {"validate": 1.31 * entry["before"]["validate"]} for joint, entry in errors.items()},
        },
        "errors": errors,
        "overall": {
            "before": 1.93 if blamed else 1.08,
            "after": 1.07 if blamed else 1.08,
            "change_percent": -44.6 if blamed else 0.0,
            "ci95_percent": [-49.8, -39.1] if blamed else [0.0, 0.0],
        },
        "loop": loop,
        "parameter_shifts": [
            {"name": "joint2.f_c", "before": 431.0, "after": 306.2, "sigmas": -9.7},
            {"name": "joint2.K", "before": 50120.0, "after": 50080.0, "sigmas": -0.13},
        ]
        if blamed
        else [],
        "warnings": ["joint6: f_s has a relative deviation of 58 %; move it slower to tell it"] if blamed else [],
    }


def sample_figures(blamed: bool = True) -> Figures:
    """Figures of the size that a minute of validation motion gives."""
    rng = np.random.default_rng(5)
    time = np.arange(3000) / 50.0
    x = 0.15 + 0.12 * np.sin(0.6 * time) * np.cos(0.13 * time)
    v = np.gradient(x, time)
    noise = 52.3 * rng.standard_normal(3000)
    missing = 1600.0 * (x - 0.15) * np.sign(v)
    grid = np.linspace(0.03, 0.27, 60)
    measured = 9000.0 * np.sin(0.7 * time) + noise + missing
    speed = np.linspace(-0.2, 0.2, 201)
    friction = tuple(
        FrictionCurve(
            joint,
            "m/s",
            "N",
            speed,
            (600.0 / (i + 1)) * np.tanh(speed / 0.002) + 3100.0 * speed,
            15.0 + 800.0 * speed**2,
            (500.0 / (i + 1)) * np.tanh(speed / 0.002) + 3200.0 * speed if blamed and i == 1 else None,
        )
        for i, joint in enumerate(JOINTS)
    )
    window = slice(1000, 1500)
    return Figures(
        scatter=(
            Scatter(
                "joint2",
                "piston_position",
                "m",
                x,
                missing + noise,
                noise,
                grid,
                1600.0 * (grid - 0.15),
                np.full(60, 9.0),
                "N m",
                direction=np.sign(v),
                law_back=-1600.0 * (grid - 0.15),
            ),
        )
        if blamed
        else (),
        worst=Course(
            "joint2",
            "N m",
            time[window],
            measured[window],
            (measured - noise - missing)[window] if blamed else (measured - noise)[window],
            (measured - noise)[window],
        ),
        friction=friction,
    )


VERDICTS = ("nothing_missing", "effect_added", "ambiguous", "unexplained")


def page_text(html: str) -> str:
    """What a reader sees, on one line."""

    class Collector(HTMLParser):
        def __init__(self) -> None:
            super().__init__()
            self.parts: list[str] = []
            self.hidden = 0

        def handle_starttag(self, tag: str, attrs: Any) -> None:
            self.hidden += tag == "style"

        def handle_endtag(self, tag: str) -> None:
            self.hidden -= tag == "style"

        def handle_data(self, data: str) -> None:
            if not self.hidden:
                self.parts.append(data)

    collector = Collector()
    collector.feed(html)
    return " ".join(" ".join(collector.parts).split())


def written(report: dict[str, Any], figures: Figures, directory: Path) -> tuple[dict[str, Any], str]:
    json_path, html_path = write_report(report, figures, directory)
    return json.loads(json_path.read_text("utf-8")), html_path.read_text("utf-8")


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """One page per verdict."""
    return {
        verdict: written(
            sample_report(verdict), sample_figures(verdict != "nothing_missing"), tmp_path_factory.mktemp(verdict)
        )[1]
        for verdict in VERDICTS
    }


# --- what it says -------------------------------------------------------------------------------------------------


def sentence_of(page: str) -> str:
    found = re.search(r'<p class="sentence">(.*?)</p>', page, re.DOTALL)
    assert found
    return page_text(found[1]).replace("\u202f", " ")


def test_the_verdict_is_one_sentence_with_what_where_how_big_and_how_much_better(pages: dict[str, str]) -> None:
    assert sentence_of(pages["effect_added"]) == (
        "The model lacked friction that depends on position at joint2 "
        "(k1 = 8123 ± 96 N/m, k2 = −12 100 ± 5200 N/m²); with it added, the error of joint2 on the validation "
        "motion fell from 210 to 56.0 N m (−73 %) and that of all joints together fell by 45 % "
        "(95 % interval −50 % to −39 %)."
    )


def test_nothing_missing_is_said_with_the_distance_to_the_noise(pages: dict[str, str]) -> None:
    assert sentence_of(pages["nothing_missing"]) == (
        "No joint shows anything above its measurement noise that the model does not explain: on the validation "
        "motion the error is 1.08 times that noise."
    )
    assert "What was found" not in pages["nothing_missing"]
    assert "None of 5 was accepted" in page_text(pages["nothing_missing"])


def test_what_nobody_looked_for_is_not_said_to_be_nothing(tmp_path: Path) -> None:
    report = sample_report("nothing_missing")
    report["loop"]["looked"] = False
    _, page = written(report, Figures(), tmp_path)
    assert sentence_of(page).startswith("The model was fitted, and nobody looked for what it may lack")
    assert "Fitted only: what is missing was not looked for" in page_text(page)
    assert "Nothing is missing" not in page_text(page)


def test_an_ambiguous_verdict_names_the_whole_set_and_the_experiment_that_would_tell(pages: dict[str, str]) -> None:
    sentence = sentence_of(pages["ambiguous"])
    assert (
        "cannot tell whether it is friction that depends on position, load dependent friction or pressure" in sentence
    )
    assert "with the first of them added" in sentence
    text = page_text(pages["ambiguous"])
    assert "once with joint3 folded and once stretched out" in text
    assert "It tells apart: friction that depends on position, load dependent friction." in text


def test_an_unexplained_verdict_claims_no_cause(pages: dict[str, str]) -> None:
    sentence = sentence_of(pages["unexplained"])
    assert sentence.startswith("The error at joint2 follows the piston position, and no known effect explains it")
    assert "is not a cause" in page_text(pages["unexplained"])


def test_an_unexplained_verdict_without_a_law_is_still_a_sentence(tmp_path: Path) -> None:
    report = sample_report("unexplained")
    report["loop"]["unexplained"] = []
    _, page = written(report, Figures(), tmp_path)
    assert sentence_of(page) == "Structure is left in the error that no known effect explains."


def test_an_effect_of_the_whole_machine_is_said_so(tmp_path: Path) -> None:
    report = sample_report()
    report["loop"]["effects"][0].update(id="base_tilt", title="Tilted base", joint=None, parameters={})
    _, page = written(report, Figures(), tmp_path)
    assert sentence_of(page).startswith(
        "The model lacked tilted base of the whole machine; with it added, the error of all joints on the "
        "validation motion fell by 45 %"
    )


@pytest.mark.parametrize(
    ("after", "words"),
    [
        (300.0, "motion rose from 210 to 300 N m (+43 %)"),
        (210.1, "motion stayed at 210 N m and"),
    ],
)
def test_a_rise_of_the_error_is_not_called_a_fall(tmp_path: Path, after: float, words: str) -> None:
    report = sample_report()
    report["errors"]["joint2"]["after"]["validate"] = after
    _, page = written(report, Figures(), tmp_path)
    assert words in sentence_of(page)


def test_every_part_of_the_report_is_on_the_page(pages: dict[str, str]) -> None:
    report = sample_report()
    text = page_text(pages["effect_added"])
    for entry in report["rigid_body"]["parameters"]:
        assert entry["expression"] in text
    for entry in report["data"]:
        assert entry["sha256"] in text and entry["file"] in text
    for candidate in report["loop"]["candidates"]:
        assert candidate["reason"] in text
    for warning in report["warnings"]:
        assert warning in text
    for phrase in (
        "F = (k1 (x - xm) + k2 (x - xm)^2) sgn(x')",
        "3.0 Hz",
        "recorded twice",
        "detection limits",
        "61.4 (rigid body, friction frozen) and 912 (one-shot)",
        "joint2.f_c",
        "−9.7 ⚠",
        "stage 1 alone",
        "640 ± 12",
        "numpy 2.4.6",
        "3.10 × 10⁻¹⁴",
        "18 base parameters",
        "3000",
    ):
        assert phrase in text.replace("\u202f", " "), phrase
    assert pages["effect_added"].count("<svg ") == 4


def test_parameters_are_flagged_above_thirty_percent_and_not_below(tmp_path: Path) -> None:
    report = sample_report("nothing_missing")
    for cylinder in report["cylinders"].values():
        cylinder["parameters"] = {"K": {"value": 1000.0, "std": 299.0, "unit": "N/m"}}
        cylinder.pop("stage_1")
    for entry in report["rigid_body"]["parameters"]:
        entry["std"] = 0.29 * entry["value"]
    _, page = written(report, Figures(), tmp_path)
    assert 'class="n flag"' not in page
    report["cylinders"]["joint3"]["parameters"]["K"]["std"] = 301.0
    _, page = written(report, Figures(), tmp_path)
    assert page.count('class="n flag"') == 1


def test_what_happened_while_it_was_recorded_is_told(tmp_path: Path) -> None:
    report = sample_report("nothing_missing")
    _, page = written(report, Figures(), tmp_path)
    assert "What happened" not in page_text(page)
    report["data"][0]["events"] = [
        {"time": 12.34, "device": "can/node 31", "what": "boot_up", "text": "booted <b>", "seconds": 0.4, "count": 1},
        {"time": None, "device": "can", "what": "bus_off", "text": "check", "seconds": None, "count": 7},
    ]
    text = page_text(written(report, Figures(), tmp_path)[1])
    for phrase in (
        "What happened while it was recorded",
        "12.3",
        "can/node 31",
        "boot up",
        "booted <b>",
        "until its end",
    ):
        assert phrase in text, phrase
    report["data"][0]["events"][0]["count"] = -1
    with pytest.raises(ReportError, match="count"):
        validate_report(report)


def test_optional_parts_may_be_missing(tmp_path: Path) -> None:
    report = sample_report()
    for key in ("bandwidth_hz", "noise_floor_method", "self_check", "one_shot"):
        del report[key]
    for joint in JOINTS:
        del report["cylinders"][joint]["stage_1"], report["errors"][joint]["two_stage"]
        report["cylinders"][joint]["parameters"]["m"] = {}
    effect = report["loop"]["effects"][0]
    for key in ("title", "equation", "parameters", "evidence", "indistinguishable_from"):
        del effect[key]
    report["overall"].update(change_percent=None, ci95_percent=None, before=None, after=None)
    report["errors"]["joint2"]["noise_floor"] = None
    _, page = written(report, Figures(), tmp_path)
    assert sentence_of(page).startswith(
        "The model lacked position dependent friction at joint2; with it added, the error"
    )
    assert "None" not in page_text(page).replace("None of", "") and "nan" not in page_text(page)


# --- whole, safe and the same every time --------------------------------------------------------------------------


def test_the_page_needs_nothing_from_outside(pages: dict[str, str]) -> None:
    for page in pages.values():
        without_namespaces = re.sub(r'xmlns(:\w+)?="[^"]*"', "", page)
        assert not re.search(r"https?:|//|@import|<script\s|<link|<iframe|<object", without_namespaces)
        assert all(target.startswith("#") for target in re.findall(r'(?:href|src)="([^"]*)"', page))


def test_ids_are_unique_and_every_reference_has_its_target(pages: dict[str, str]) -> None:
    for page in pages.values():
        ids = re.findall(r'\bid="([^"]+)"', page)
        assert len(ids) == len(set(ids)) and ids
        referred = set(re.findall(r'href="#([^"]+)"', page)) | set(re.findall(r"url\(#([^)]+)\)", page))
        assert referred and referred <= set(ids)


def test_figures_are_well_formed_and_take_their_colours_from_the_page(pages: dict[str, str]) -> None:
    figures = re.findall(r"<svg .*?</svg>", pages["effect_added"], re.DOTALL)
    for figure in figures:
        ElementTree.fromstring(figure.replace("<svg ", '<svg xmlns:xlink="http://www.w3.org/1999/xlink" ', 1))
        assert "var(--" in figure
        # No colour of its own (black would vanish on a dark page).
        assert not re.search(r"#[0-9a-f]{6}\b(?!\))", re.sub(r"(url\(#|href=\"#|id=\")[^)\"]*", "", figure))
    style = pages["effect_added"].split("</style>")[0]
    for name in set(re.findall(r"var\((--[a-z]+)\)", pages["effect_added"])):
        assert len(re.findall(rf"{name}:", style)) >= 3, f"{name} lacks a value for light, dark or print"


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    first = [path.read_bytes() for path in write_report(sample_report(), sample_figures(), tmp_path / "a")]
    second = [path.read_bytes() for path in write_report(sample_report(), sample_figures(), tmp_path / "b")]
    assert first == second


def test_texts_of_the_report_cannot_become_markup(tmp_path: Path) -> None:
    evil = "<img src=x onerror=alert(1)>&$x_1$"
    report = sample_report("ambiguous")
    figures = sample_figures()
    report["machine"] = evil
    report["warnings"] = [evil]
    report["loop"]["effects"][0].update(title=evil, equation=evil, evidence={evil: evil})
    report["loop"]["candidates"][0]["reason"] = evil
    report["errors"][evil] = report["errors"]["joint1"]
    scatter = Scatter(**{**vars(figures.scatter[0]), "joint": evil, "variable": evil, "unit": evil})
    _, page = written(report, Figures(scatter=(scatter,), friction=figures.friction, worst=figures.worst), tmp_path)
    assert "<img" not in page
    assert page.count("$x_1$") > 5


def test_nothing_is_left_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_report(sample_report(), Figures(), tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("daq.whole_files.os.fsync", fail)
    with pytest.raises(ReportError, match="cannot write the report: No space left on device"):
        write_report(sample_report("unexplained"), Figures(), tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_directory_that_cannot_be_made_is_a_one_line_error(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(ReportError) as error:
        write_report(sample_report(), Figures(), tmp_path / "taken" / "report")
    assert "taken" in str(error.value) and "\n" not in str(error.value)


def test_gaps_in_figures_are_left_out(tmp_path: Path) -> None:
    figures = sample_figures()
    scatter = copy.deepcopy(figures.scatter[0])
    scatter.x[:50] = np.nan
    scatter.before[100:120] = np.inf
    _, page = written(sample_report(), Figures(scatter=(scatter,)), tmp_path)
    assert "nan" not in page_text(page)


def test_empty_figures_are_drawn_without_complaint(tmp_path: Path) -> None:
    none = np.zeros(0)
    figures = Figures(
        scatter=(Scatter("joint1", "time", "s", none, none, none, none, none, none, "N m"),),
        friction=(FrictionCurve("joint1", "m/s", "N", none, none, none),),
    )
    _, page = written(sample_report(), figures, tmp_path)
    assert page.count("<svg ") == 3


# --- report.json --------------------------------------------------------------------------------------------------


def test_numbers_that_do_not_exist_are_null(tmp_path: Path) -> None:
    report = sample_report()
    report["errors"]["joint1"]["noise_floor"] = float("nan")
    report["one_shot"]["condition_number"] = np.float64("inf")
    report["extra"] = {"array": np.array([1.0, np.nan]), "flag": np.bool_(True), "count": np.int64(3)}
    read, _ = written(report, Figures(), tmp_path)
    assert read["errors"]["joint1"]["noise_floor"] is None
    assert read["one_shot"]["condition_number"] is None
    assert read["extra"] == {"array": [1.0, None], "flag": True, "count": 3}
    text = (tmp_path / "report.json").read_text()
    assert "NaN" not in text and "Infinity" not in text


@pytest.mark.parametrize("verdict", VERDICTS)
def test_what_is_written_is_what_was_given(verdict: str, tmp_path: Path) -> None:
    report = sample_report(verdict)
    read, _ = written(report, Figures(), tmp_path)
    assert list(read) == list(report)
    assert read["loop"]["verdict"] == verdict
    assert validate_report(read) == read


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        (("schema",), "hilfit/report/2", "schema"),
        (("loop", "verdict"), "perhaps", "loop.verdict"),
        (("loop", "candidates"), [{"id": "x", "joint": None, "status": "maybe"}], "loop.candidates.0.status"),
        (("errors", "joint3"), {"unit": "N m"}, "errors.joint3.noise_floor"),
        (("data",), [{"role": "train", "file": "a", "sha256": "b", "samples": -1}], "data.0.samples"),
        (("warnings",), None, "warnings"),
        (("machine",), {1, 2}, "set"),
    ],
)
def test_a_report_that_breaks_the_schema_is_refused_by_key(
    path: tuple[str, ...], value: object, named: str, tmp_path: Path
) -> None:
    report = sample_report()
    place = report
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(ReportError) as error:
        write_report(report, Figures(), tmp_path / "out")
    assert named in str(error.value) and "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


def test_no_key_of_the_contract_may_be_left_out() -> None:
    for key in ("machine", "created", "software", "data", "reduction", "cylinders", "rigid_body", "errors", "overall"):
        report = sample_report()
        del report[key]
        with pytest.raises(ReportError, match=rf"report\.json: {key}: "):
            validate_report(report)


def test_the_json_schema_has_the_keys_as_written() -> None:
    schema = json_schema()
    assert {"schema", "errors", "loop", "parameter_shifts"} <= set(schema["properties"])
    assert "validate" in schema["$defs"]["ErrorPair"]["properties"]


def test_the_published_schema_is_that_of_the_definition() -> None:
    said = "write it anew with 'python -m fitting.report.schema.file', and the page with 'make page'"
    assert file.PLACE.read_text(encoding="utf-8") == file.text(), said


# --- numbers ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.999949, "1.00"),
        (-0.0123456, "−0.0123"),
        (45.67, "45.7"),
        (9999.6, "10\u202f000"),
        (123456.0, "123\u202f000"),
        (1.234e7, "1.23\u202f×\u202f10⁷"),
        (4.5e-6, "4.50\u202f×\u202f10⁻⁶"),
        (None, "–"),
        (float("nan"), "–"),
    ],
)
def test_numbers_have_three_significant_digits(value: float | None, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (7.1312, 0.4249, "7.13 ± 0.42"),
        (51234.0, 312.0, "51\u202f230 ± 310"),
        (0.5, 99.6, "0 ± 100"),
        (3.0, 0.0996, "3.00 ± 0.10"),
        (-2.5e7, 1.3e5, "(−2.500 ± 0.013)\u202f×\u202f10⁷"),
        (3.2e-6, 4.0e-7, "(3.20 ± 0.40)\u202f×\u202f10⁻⁶"),
        (12.0, None, "12.00"),
        (None, 1.0, "–"),
    ],
)
def test_a_deviation_has_two_digits_and_the_value_ends_where_it_does(
    value: float | None, std: float | None, text: str
) -> None:
    assert with_std(value, std) == text


@pytest.mark.parametrize(("value", "text"), [(-73.4, "−73"), (-0.04, "0.0"), (5.26, "+5.3"), (0.0, "0.0")])
def test_percentages_carry_their_sign(value: float, text: str) -> None:
    assert percent(value) == f"{text}\u202f%"


def read_back(text: str) -> float:
    plain = text.replace("\u202f", "").replace("−", "-").replace("×10", "e")
    return float(plain.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")))


@pytest.mark.parametrize(("value", "text"), [(-46.3, "fell by {}"), (5.26, "rose by {}"), (-0.5, "fell by {}")])
def test_a_change_says_which_way(value: float, text: str) -> None:
    assert moved(value) == text
    assert moved(0.04) == moved(-0.04) == moved(0.0) == "did not change"


@pytest.mark.parametrize(
    ("stamp", "text"),
    [
        ("2026-03-02T09:14:05Z", "2 March 2026, 09:14 UTC"),
        ("2026-11-21T02:03:33+00:00", "21 November 2026, 02:03 UTC"),
        ("2026-12-01T23:59:00", "1 December 2026, 23:59"),
        ("yesterday", "yesterday"),
    ],
)
def test_dates_are_written_out(stamp: str, text: str) -> None:
    assert moment(stamp) == text


def test_signals_are_named_in_words_and_other_names_stay() -> None:
    names = ["joint2.joint_position", "joint_position", "run_head_pressure_2.csv", "f_s"]
    assert readable(Sentence("fitting.differ_these_recordings", rivals=names, now=2.5)).startswith(
        "joint2 joint position and joint position and run_head_pressure_2.csv and f_s differ"
    )
    assert readable("a sentence of joint2.joint_position that nobody made of values") == (
        "a sentence of joint2.joint_position that nobody made of values"
    )


def test_which_variant_an_effect_is_is_no_size() -> None:
    entries = {"a": {"value": 26.0, "std": 1.4, "unit": "N"}, "odd": {"value": 1.0, "std": None, "unit": "choice"}}
    assert sizes(entries) == "a = 26.0 \u00b1 1.4 N"


def test_effects_in_a_text_are_named_by_their_titles() -> None:
    titles = {"load_dependent_friction": "Friction that grows with the load"}
    rivals = ["load_dependent_friction", "joint_2.load_dependent_friction", "no_such_effect"]
    text = Sentence("fitting.differ_these_recordings", rivals=rivals, now=31.5)
    assert readable(text, titles) == (
        "friction that grows with the load and joint_2.load_dependent_friction and no_such_effect differ by 31.5 in "
        "these recordings"
    )


def test_a_law_that_turns_with_the_motion_says_so() -> None:
    law = {"joint": "joint1", "variable": "piston_position", "times_sign_of_speed": False}
    assert follows(law) == "the error at joint1 follows the piston position"
    turning = law | {"times_sign_of_speed": True, "second_variable": "oil_temperature"}
    assert follows(turning) == (
        "the error at joint1 follows the piston position together with the oil temperature, "
        "and turns its sign with the direction of motion"
    )
    assert follows(law | {"only_while": "negative"}) == (
        "the error at joint1 follows the piston position, only while the speed of the joint is negative"
    )


@pytest.mark.parametrize(
    ("kind", "shape", "rising", "words"),
    [
        ("power", 1.5, True, "a power of the piston position with the exponent 1.50"),
        ("threshold", 0.31, False, "a straight line below a threshold of 0.310 m"),
        ("exponential", 0.1, True, "an exponential that rises over 0.100 m"),
        ("sine", 0.2, True, "a sine with the wavelength 0.200 m"),
        ("step", 0.3, True, "a step at 0.300 m"),
    ],
)
def test_the_nearest_formula_of_a_law_is_said_with_its_share(kind: str, shape: float, rising: bool, words: str) -> None:
    formula = {"kind": kind, "shape": shape, "rising": rising, "amplitude": 3.0, "share": 0.966}
    law = {"variable": "piston_position", "unit": "m", "law": {"formula": formula}}
    assert nearest(law) == f"The nearest simple formula is {words}; it explains 97 % of the curve."
    assert nearest({**law, "law": {}}) == ""


def test_a_law_that_a_known_effect_may_be_says_so() -> None:
    report = sample_report("unexplained")
    law = report["loop"]["unexplained"][0]
    assert "and no known effect explains it" in verdict_sentence(report, {})
    law["could_be"] = [{"id": "gas_spring", "joint": law["joint"], "title": "a gas spring", "probability": 0.74}]
    said = verdict_sentence(report, {})
    assert "and no known effect explains it for certain; it may be a gas spring (74" in said


def test_a_number_without_a_unit_has_none() -> None:
    assert [unit("1"), unit(None)] == ["", ""]
    assert [unit("N (s/m)^(1/3)"), unit("kg m^2")] == ["N (s/m)\u00b9\u2044\u00b3", "kg m\u00b2"]


def test_up_to_four_parameters_stand_in_the_sentence() -> None:
    entries = {f"f_{i}": {"value": 10.0 * i, "std": 1.0, "unit": "N"} for i in range(1, 7)}
    assert sizes(entries) == "f_1 = 10.0 ± 1.0 N, f_2 = 20.0 ± 1.0 N, f_3 = 30.0 ± 1.0 N, f_4 = 40.0 ± 1.0 N"


def test_evidence_and_estimator_are_in_plain_words(pages: dict[str, str]) -> None:
    text = page_text(pages["effect_added"])
    for phrase in (
        "chi-square gained",
        "gain on the validation motion",
        "both stages at once, weighted by the noise, beside a plausible arm (gls)",
        "of 78 standard parameters; friction and drive inertia are identified with the drives",
        "so the points lie on it",
        "2 March 2026, 09:14 UTC",
    ):
        assert phrase in text, phrase
    assert "validate gain" not in text


@given(st.floats(min_value=1e-30, max_value=1e30), st.sampled_from([-1.0, 1.0]), st.integers(2, 6))
def test_a_number_reads_back_to_its_digits(size: float, sign: float, digits: int) -> None:
    assert read_back(number(sign * size, digits)) == pytest.approx(sign * size, rel=0.51 * 10.0 ** (1 - digits))


@given(st.floats(-1e12, 1e12), st.floats(1e-9, 1e9))
def test_rounding_never_moves_a_value_by_more_than_a_fifth_of_its_deviation(value: float, std: float) -> None:
    text = with_std(value, std)
    factor = 1.0
    if text.startswith("("):
        text, power = text[1:].split(")")
        factor = read_back("1" + power.replace("\u202f", ""))
    shown, deviation = (factor * read_back(part) for part in text.split(" ± "))
    assert abs(shown - value) <= 0.2 * std + 1e-9 * abs(value)
    assert deviation == pytest.approx(std, rel=0.06)


def test_probabilities_are_said_as_far_as_they_can_be_trusted() -> None:
    assert [as_chance(p) for p in (0.999, 0.84, 0.001)] == ["more than 99 %", "84\u202f%", "less than 1 %"]
    assert chance(None) == "" and chance(0.5) == " (50\u202f%)"
    assert explanation({"effects": [], "laws": [], "probability": 0.9}, {}) == "nothing is missing"
    both = {"effects": [{"id": "payload", "joint": None}], "laws": [{"joint": "joint2", "variable": "total_flow"}]}
    said = explanation({**both, "probability": 0.5}, {"payload": "A payload"})
    assert "payload" in said and "joint2" in said and "total flow" in said
