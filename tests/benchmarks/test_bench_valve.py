"""``hilfit bench valve``: cases are drawn from their key alone, answers are scored by closed forms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from benchmarks.targets import silent
from benchmarks.valve import judging, scoring
from benchmarks.valve.drawing import KINDS, ValveKey, at_limit, floor, misfit, order_of
from benchmarks.valve.judging import Answer, AxisAnswer, identified
from benchmarks.valve.runs import run
from benchmarks.valve.scoring import case_text, checks, command_errors, large, named, scored, true_edge
from daq.errors import InputError
from daq.machine.machine_file import machine_to_yaml
from sim_backends.plant.truth import SensorQuality
from sim_backends.valve.effects import ValveEffectSpec
from sim_backends.valve.machines import VALVE_MACHINES
from sim_backends.valve.motion import Hold, Phase
from sim_backends.valve.recording import ValveCase, guesses_of, simulate_valve_cases, write_valve_case
from sim_backends.valve.tracking import Pressures, TrueInverse
from sim_backends.valve.truth import Land, ValvePlantTruth

STEPS: list[Phase] = [
    Hold((u, v), s)
    for u, v, s in ((0, 0, 0.5), (0.5, 0.4, 0.9), (-0.5, -0.4, 0.9), (0.3, 0.5, 0.9), (-0.3, -0.5, 0.9), (0, 0, 0.8))
]


@pytest.fixture(scope="module")
def cases() -> list[ValveCase]:
    """A calm bench, healthy and with a play in the slide's spool."""
    machine, truth = VALVE_MACHINES["bench"](4)
    calm = {name: replace(v, spool=replace(v.spool, restless=0.0)) for name, v in truth.valves.items()}
    truth = replace(truth, valves=calm)
    guesses = guesses_of(machine, truth, np.random.default_rng(0))
    play = ValveEffectSpec("spool_hysteresis", "play", "slide", 0.04)
    programmes = {"train-all": STEPS, "validate": STEPS}
    quality = SensorQuality(pressure_std=3e3)
    return simulate_valve_cases([(machine, truth, programmes, guesses, e, quality, 1) for e in ((), (play,))])


@pytest.mark.slow
def test_the_true_valve_explains_a_healthy_one_and_not_one_with_play(cases: list[ValveCase]) -> None:
    healthy, worn = (misfit(case.machine, case.healthy, list(case.courses.values())) for case in cases)
    assert np.all(healthy < 0.015)
    assert worn[0] > 0.05  # .04 of play beside openings of some .3
    assert worn[1] < 0.015
    assert np.all(floor(cases[0]) >= 0.5 * misfit(cases[0].machine, cases[0].truth, [cases[0].courses["validate"]]))
    assert np.all(floor(cases[0]) < 0.03)
    assert at_limit(cases[0].machine, cases[0].truth, list(cases[0].courses.values())) == 0.0


def case_folder(folder: Path, case: ValveCase, made: str) -> Path:
    write_valve_case(folder, case)
    content = {"kind": "bench", "made": made, "at_limit": 0.0, "seen": {"slide": 0.1, "lift": 0.001},
               "floor": {"slide": 0.01, "lift": 0.01}}  # fmt: skip
    (folder / "case.yaml").write_text(yaml.safe_dump(content))
    return folder


def perfect(truth: ValvePlantTruth, machine: object, joint: str, shift: float = 0.0) -> AxisAnswer:
    """The truth as an answer; the inverse's commands are ``shift`` too large."""
    number = list(truth.valves).index(joint)
    inverse = TrueInverse(machine, truth, quiet=0.0, trusting=False)  # type: ignore[arg-type]

    def command(speed: float, head: float, rod: float, supply: float, tank: float, moving: bool) -> float:
        wished = np.zeros(len(truth.valves))
        wished[number] = speed
        chambers = np.full(len(wished), head), np.full(len(wished), rod)
        return float(inverse(wished, Pressures(*chambers, supply=supply, tank=tank))[number]) + shift

    delay = truth.valves[joint].spool.lateness
    edges = {way: true_edge(truth, joint, way, 0.5) for way in ("extend", "retract")}
    return AxisAnswer(
        error=0.012,
        delay=(delay, (delay - 0.001, delay + 0.001)),
        edges={way: (edge, (edge - 0.001, edge + 0.001)) for way, edge in edges.items()},
        largest={"extend": 0.5, "retract": 0.5},
        command=command,
    )


@pytest.mark.slow
def test_a_perfect_answer_meets_every_target_and_a_wrong_one_none(tmp_path: Path, cases: list[ValveCase]) -> None:
    healthy, worn = (case_folder(tmp_path / c, case, c) for c, case in zip(("null", "large"), cases, strict=True))
    truth, machine = cases[0].truth, cases[0].machine
    right = {joint: perfect(truth, machine, joint) for joint in truth.valves}
    line = scored(healthy, Answer(right, 2.0))
    assert line["axes"]["slide"]["delay"]["in"] is True
    assert max(line["axes"]["slide"]["command_errors"]) < 1e-9
    assert len(line["axes"]["slide"]["command_errors"]) > 100
    effects = (("curve_power",), ("delay_per_direction", "spool_hysteresis"))
    found = {**right, "slide": replace(right["slide"], effects=effects)}
    other = scored(worn, Answer(found, 2.0))
    assert named(other)
    assert large(other)
    assert not large(line)
    assert "spool_hysteresis (play) at slide" in case_text(other)
    met = {check.name: check.met for check in checks([line, other])}
    assert met.pop("edges in their 95 % bars: at most") is False  # all of four are inside
    assert met.pop("delays in their 95 % bars: at most") is False
    assert all(value is not False for value in met.values()), met

    wrong = {
        joint: replace(
            perfect(truth, machine, joint, shift=0.02), error=0.05, delay=(0.5, (0.49, 0.51)),
            edges={"extend": (0.5, (0.49, 0.51))}, effects=(("piston_leak",),),
        )
        for joint in truth.valves
    }  # fmt: skip
    lines = [scored(healthy, Answer(wrong)), scored(worn, Answer(wrong))]
    met = {check.name: check.met for check in checks(lines)}
    assert [name for name, value in met.items() if value] == [
        "edges in their 95 % bars: at most", "delays in their 95 % bars: at most",
    ]  # fmt: skip


@pytest.mark.slow
def test_a_perfect_inverse_follows_a_path_at_a_fraction_of_the_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scoring, "SECONDS", 7.0)
    key = ValveKey(1, "null", 2)
    machine, truth = order_of(key)[:2]
    (tmp_path / "machine.yaml").write_text(machine_to_yaml(machine))
    (tmp_path / "truth.yaml").write_text(yaml.safe_dump(truth.to_dict()))
    answer = Answer({joint: perfect(truth, machine, joint) for joint in truth.valves})
    errors = scoring.followed(tmp_path, key, answer)
    assert errors["preview"] < 0.25 * errors["linear"] < 0.25 * errors["feedback"]
    assert errors["preview"] < errors["inverse"]


def test_an_axis_that_stands_is_asked_as_one_that_stands() -> None:
    asked = []

    def command(speed: float, head: float, rod: float, supply: float, tank: float, moving: bool) -> float:
        asked.append((speed, head, rod, supply, tank, moving))
        return 0.3 if speed > 0.01 else 0.0

    inverse = scoring.inverse_of(Answer({"boom": AxisAnswer(0.0, (0.0, None), {}, {}, command=command)}))
    for speed in (0.0, 0.02, 0.02, 0.0, 0.0):
        inverse(np.array([speed]), Pressures(np.array([5.0]), np.array([2.0]), 9.0, 1.0))
    assert [moving for *_, moving in asked] == [False, False, True, True, False]
    assert asked[0][:5] == (0.0, 5.0, 2.0, 9.0, 1.0)


def test_what_is_true_of_an_edge_is_a_closed_form() -> None:
    machine, truth = VALVE_MACHINES["bench"](4)
    name = machine.joints[0].name
    lands = {key: Land(0.1, 1e-4) for key in truth.valves[name].lands}

    def edge(**of_the_land: float) -> float:
        own = {key: replace(land, **of_the_land) for key, land in lands.items()}  # type: ignore[arg-type]
        return true_edge(replace(truth, valves={name: replace(truth.valves[name], lands=own)}), name, "extend", 0.6)

    assert edge() == pytest.approx(0.1 + 0.02 * 0.5)  # 2 % of the way from the edge to the largest command
    assert edge(exponent=2.0) == pytest.approx(0.1 + np.sqrt(0.02) * 0.5)
    assert edge(saturation=0.4) < edge()  # what it levels out at is less, so 2 % of it comes earlier


@pytest.mark.parametrize("number", range(3))
def test_a_case_is_drawn_from_its_key_alone(number: int) -> None:
    null, again, other = (order_of(ValveKey(number, made, seed)) for made, seed in
                          (("null", 5), ("null", 5), ("large", 5)))  # type: ignore[arg-type]  # fmt: skip
    assert ValveKey(number, "null", 5).kind == KINDS[number]
    assert null[0] == again[0] == other[0]
    assert null[1] == again[1] == other[1]
    assert null[5:] == other[5:]
    assert null[4] == ()
    assert len(other[4]) == 1
    assert list(null[2]) == [*(f"train-{joint.name}" for joint in null[0].joints), "train-all", "repeat", "validate"]
    assert order_of(ValveKey(number, "null", 6))[1] != null[1]


def test_an_answer_is_read_from_what_identify_valve_gives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    machine, _ = VALVE_MACHINES["bench"](4)
    monkeypatch.setattr(judging, "load_machine", lambda _: machine)

    def bar(value: float) -> dict[str, object]:
        return {"value": value, "ci95": [value - 1, value + 1]}

    axis = {
        "errors": {"handed_out": 0.02}, "delay": bar(0.1) | {"ci95": None}, "pump_limit": {"value": 3e-4},
        "pump_power": None,
        "directions": {"extend": {"moves": True, "edge_at_2_percent": bar(0.05)}, "retract": {"moves": False}},
        "largest_recorded": {"extend": 0.7, "retract": 0.0},
        "effects": [{"id": "piston_leak", "indistinguishable_from": ["port_leak"]}],
        "unexplained": [{"variable": "piston_position"}],
    }  # fmt: skip
    model = SimpleNamespace(command=lambda speed, **_: SimpleNamespace(share=2 * speed))
    result = SimpleNamespace(
        report={"axes": {j.name: axis for j in machine.joints}}, models={j.name: model for j in machine.joints}
    )
    monkeypatch.setattr("hilfit.identify_valve", lambda *_: result, raising=False)
    own = identified(tmp_path).axes["slide"]
    assert (own.error, own.delay, own.flow_limit) == (0.02, (0.1, None), 3e-4)
    assert own.edges == {"extend": (0.05, (-0.95, 1.05))}
    assert own.effects == (("piston_leak", "port_leak"), ("pump_flow_limit",))
    assert own.laws == ("piston_position",)
    assert own.command is not None
    assert own.command(0.1, 0.0, 0.0, 0.0, 0.0, True) == 0.2


def test_a_version_without_valves_says_so_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr("hilfit.identify_valve", raising=False)
    with pytest.raises(InputError, match=r"hilfit\.identify_valve is not there: .*--only-make"):
        identified(tmp_path)


def test_results_of_something_else_are_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("hello\nworld\n")
    with pytest.raises(InputError, match="line 1 is no result of 'hilfit bench valve'"):
        run(1, 0, None, False, tmp_path / "notes.txt", 0, False, silent)


def test_without_an_inverse_no_command_is_asked(tmp_path: Path) -> None:
    machine, truth = VALVE_MACHINES["bench"](4)
    silent = AxisAnswer(0.1, (0.1, None), {}, {})
    assert command_errors(tmp_path, machine, truth, "slide", silent) == []
