"""Faults of single channels, clocks and magnitudes, made in a sound signal of known noise."""

from __future__ import annotations

import ast
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from synthetic_arm import make_recordings, planar_machine, truth

from daq.machine.machine_file import Channel, Machine
from daq.messages import placeholders, texts
from daq.recordings.recording import Recording
from fitting.checks import findings
from fitting.checks.check import check_recordings
from fitting.checks.findings import Finding
from fitting.checks.magnitudes import magnitude_findings
from fitting.checks.motions import motion_findings
from fitting.checks.signal_faults import noise_findings, signal_findings
from fitting.checks.time_axis import repaired_time, repeated_findings, speed_findings, time_findings

MACHINE = planar_machine(2)
SOUND = make_recordings(MACHINE, truth(2), [("train", 2), ("validate", 3)])


def spoilt(channel: str, of: Callable[[np.ndarray], np.ndarray], recording: Recording = SOUND[0]) -> Recording:
    """The recording with one channel changed."""
    return replace(recording, values={**recording.values, channel: of(np.array(recording.values[channel]))})


def named(found: list[Finding]) -> list[tuple[str, str | None]]:
    return [(own.code, own.channel) for own in found if own.severity == "mistake"]


def with_rows(rows: slice | list[int], value: Callable[[np.ndarray], np.ndarray | float]) -> Callable[..., np.ndarray]:
    def change(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[rows] = value(values)
        return values

    return change


def test_a_sound_recording_has_no_fault() -> None:
    for recording in SOUND:
        assert signal_findings(MACHINE, recording) == []
    assert magnitude_findings(MACHINE, SOUND) == []
    assert named(motion_findings(MACHINE, SOUND)) == []


@pytest.mark.parametrize("channel", ["joint1.q", "joint1.x", "joint2.head", "joint2.rod"])
@pytest.mark.parametrize(
    ("code", "of"),
    [
        # 5 s of one value; twelve values off by half of the range; every tenth value held.
        ("frozen", with_rows(slice(500, 750), lambda v: v[500])),
        ("outliers", with_rows(list(range(40, 1900, 160)), lambda v: v[40:1900:160] + 0.6 * np.ptp(v))),
        ("held", lambda v: v[np.arange(len(v)) // 10 * 10]),
    ],
)
def test_a_fault_of_any_channel_is_named(channel: str, code: str, of: Callable[[np.ndarray], np.ndarray]) -> None:
    assert named(signal_findings(MACHINE, spoilt(channel, of))) == [(code, channel)]


def test_a_pressure_that_stops_at_a_value_is_clipped() -> None:
    found = signal_findings(MACHINE, spoilt("joint1.head", lambda v: np.minimum(v, np.percentile(v, 90))))
    assert named(found) == [("clipped", "joint1.head")]


def test_an_encoder_that_wraps_and_one_that_slips() -> None:
    wrapped = spoilt("joint2.q", lambda q: np.where(q > np.median(q), q - 2 * np.pi, q))
    assert named(signal_findings(MACHINE, wrapped)) == [("wrap", "joint2.q")]
    slipped = spoilt("joint2.q", lambda q: q + 0.2 * (np.arange(len(q)) > 900))
    assert named(signal_findings(MACHINE, slipped)) == [("jump", "joint2.q")]


@pytest.mark.parametrize("channel", ["joint1.q", "joint1.x", "joint2.head", "joint2.rod"])
def test_a_loose_cable_falls_to_one_value_and_comes_back(channel: str) -> None:
    def drop(values: np.ndarray) -> np.ndarray:
        least = values.min() - np.ptp(values)
        for start in (200, 700, 1300):
            values[start : start + 25] = least
        return values

    found = signal_findings(MACHINE, spoilt(channel, lambda v: drop(v.copy())))
    assert named(found) == [("dropouts", channel)]
    assert "comes back 3 times" in found[0].text


def test_positions_in_whole_degrees_are_coarse_and_a_thousandth_of_the_travel_is_not() -> None:
    for step, codes in ((np.deg2rad(1.0), [("coarse", "joint1.q")]), (5e-4, [])):
        rounded = spoilt("joint1.q", lambda q, step=step: step * np.round(q / step))
        assert named(signal_findings(MACHINE, rounded)) == codes


def test_a_sensor_that_freezes_while_the_other_one_of_its_joint_moves() -> None:
    """It freezes and wakes where the joint happens to be again: no jump tells, the piston does."""
    q = np.array(SOUND[0].values["joint1.q"])
    start = 400
    again = start + 100 + int(np.argmin(np.abs(q[start + 100 : start + 900] - q[start])))
    found = signal_findings(MACHINE, spoilt("joint1.q", with_rows(slice(start, again), lambda v: v[start])))
    assert named(found) == [("frozen", "joint1.q")]


def test_a_position_that_stops_and_starts_at_full_speed_has_a_frozen_sensor() -> None:
    """One sensor, and it wakes near where it froze: no jump, but no machine stops within a row."""
    alone = planar_machine(2, sensors="joint")
    (recording,) = make_recordings(alone, truth(2), [("train", 2)])
    q = np.array(recording.values["joint1.q"])
    speed = np.abs(np.diff(q))
    start = 300 + int(np.argmax(speed[300:500]))
    near = [k for k in range(start + 100, len(q) - 2) if abs(q[k] - q[start]) < 0.03 * np.ptp(q)]
    again = max(near, key=lambda k: speed[k])
    frozen = spoilt("joint1.q", with_rows(slice(start, again), lambda v: v[start]), recording)
    assert [(own.code, own.channel) for own in signal_findings(alone, frozen)] == [("frozen", "joint1.q")]
    assert signal_findings(alone, recording) == []


@pytest.mark.parametrize("resolution", [0.3, 1.5, 2.5])
def test_a_pressure_that_freezes_at_its_floor(resolution: float) -> None:
    """A drained chamber has few levels, that repeat: six seconds of one of them, of a joint that moves, are none."""
    rng = np.random.default_rng(3)

    def floor(v: np.ndarray) -> np.ndarray:
        low = np.maximum(v, np.percentile(v, 60)) + rng.normal(0.0, 800.0, len(v))
        return np.round(low / (resolution * 800.0)) * resolution * 800.0

    drained = spoilt("joint1.rod", floor)
    assert "frozen" not in [own.code for own in signal_findings(MACHINE, drained)]
    frozen = spoilt("joint1.rod", with_rows(slice(600, 900), lambda v: v[600]), drained)
    assert named(signal_findings(MACHINE, frozen)) == [("frozen", "joint1.rod")]


def test_pressures_in_bar_in_one_recording_are_said_of_it_alone() -> None:
    names = [c.name for c in MACHINE.channels if c.quantity.endswith("pressure")]
    other = replace(SOUND[1], values={**SOUND[1].values, **{n: 1e-5 * SOUND[1].values[n] for n in names}})
    found = [own for own in magnitude_findings(MACHINE, [SOUND[0], other]) if own.code == "unit"]
    assert [(own.recording, "bar" in own.cure) for own in found] == [(SOUND[1].file, True)]


def test_one_cable_in_two_sockets() -> None:
    twice = spoilt("joint2.head", lambda v: np.array(SOUND[0].values["joint1.head"]))
    assert ("same_channel", "joint2.head") in named(signal_findings(MACHINE, twice))


@pytest.mark.parametrize("every", [3, 10, 25, 40, 70, 300])
def test_the_last_bit_of_a_joint_at_rest_toggles(every: int) -> None:
    """It comes and goes like a spike, and is the least step that there is."""

    def at_rest(values: np.ndarray) -> np.ndarray:
        return 1e-4 * (np.round(values[0] / 1e-4) + (np.arange(len(values)) % every == 0))

    assert signal_findings(MACHINE, spoilt("joint1.x", at_rest, spoilt("joint1.q", at_rest))) == []


@pytest.mark.parametrize("channel", ["joint1.head", "joint2.q"])
@pytest.mark.parametrize("every", [500, 100, 45])
def test_spikes_are_found_however_many(channel: str, every: int) -> None:
    """Up to one in forty rows; one in fifty was a usual step of its own signal."""

    def struck(values: np.ndarray) -> np.ndarray:
        spoilt = np.array(values)
        spoilt[7::every] += 0.6 * np.ptp(values)
        return spoilt

    assert named(signal_findings(MACHINE, spoilt(channel, struck))) == [("outliers", channel)]


def test_a_joint_that_stands_has_no_frozen_encoder() -> None:
    """With a coarse encoder it says one value for as long as it stands; that is no fault."""
    stands = spoilt("joint1.q", lambda q: np.round(np.where(np.arange(len(q)) < 800, q[800], q), 4))
    stands = spoilt("joint1.x", lambda x: np.where(np.arange(len(x)) < 800, x[800], x), stands)
    assert signal_findings(MACHINE, stands) == []


@pytest.mark.parametrize(
    ("of", "code", "severity"),
    [
        (lambda t: 1e3 * t, "time_unit", "mistake"),
        (lambda t: t / 60, "time_unit", "mistake"),
        (lambda t: t / 86400, "time_unit", "mistake"),
        (lambda t: 2 * t, "wrong_rate", "mistake"),
        (lambda t: t + 30.0 * (t > 15), "time_jump", "mistake"),
        (lambda t: np.concatenate([t[:900], t[500:1600]]), "time_jump", "mistake"),
        (lambda t: t + 0.2 * (t > 10.0), "lost_rows", "note"),
    ],
)
def test_faults_of_the_time_column_are_named(of: Callable[[np.ndarray], np.ndarray], code: str, severity: str) -> None:
    time = of(np.arange(2000) / MACHINE.rate_hz)
    found = time_findings(MACHINE, "run.csv", time, {"joint1.q": np.array(SOUND[0].values["joint1.q"])})
    assert [(own.code, own.severity) for own in found] == [(code, severity)]
    assert "run.csv" in found[0].text


def test_a_time_in_milliseconds_is_used_in_seconds() -> None:
    seconds = np.arange(500) / 50.0
    assert repaired_time(1e3 * seconds, 50.0) == pytest.approx(seconds)


@given(unit=st.sampled_from([("bar", 1e5), ("kPa", 1e3), ("psi", 6894.757)]), top=st.floats(5e6, 2.5e7))
@example(("kPa", 1e3), 2.0055807e7)
@settings(max_examples=15, deadline=None)
def test_pressures_in_another_unit_say_which(unit: tuple[str, float], top: float) -> None:
    """Pressures of 50 to 250 bar in another unit of which none is a factor of three from another."""
    name, size = unit
    values = dict(SOUND[0].values)
    for channel in MACHINE.channels:
        if channel.quantity.endswith("_pressure"):
            own = np.array(values[channel.name])
            values[channel.name] = own * top / np.abs(own).max() / size
    found = magnitude_findings(MACHINE, [replace(SOUND[0], values=values)])
    assert [own.code for own in found] == ["unit"]
    assert found[0].cure.startswith(f"set the unit to '{name}'")


@pytest.mark.parametrize(("name", "size"), [("bar", 1e5), ("kPa", 1e3), ("psi", 6894.757), ("MPa", 1e6)])
def test_the_unit_of_one_joint_is_the_one_in_which_its_sensors_are_as_noisy_as_others(name: str, size: float) -> None:
    """A joint that carries little: by its largest pressure alone 20 bar in bar pass for 200 in MPa."""
    light = SOUND[0]
    for channel in MACHINE.channels:
        if channel.quantity.endswith("_pressure"):
            load = np.convolve(np.pad(light.values[channel.name], 12, mode="edge"), np.full(25, 1 / 25), mode="valid")
            times, unit = (19.0, 1.0) if channel.joint == "joint1" else (2.0, size)
            values = (np.array(light.values[channel.name]) + times * load) / unit
            light = replace(light, values={**light.values, channel.name: values})
    found = magnitude_findings(MACHINE, [light])
    assert {(own.channel, own.says) for own in found} == {("joint2.head", name), ("joint2.rod", name)}


def test_degrees_where_the_file_says_radians(n: int = 2) -> None:
    found = magnitude_findings(MACHINE, [spoilt("joint2.q", np.rad2deg)])
    assert named(found) == [("unit", "joint2.q")]
    assert "'deg'" in found[0].cure


def test_validate_has_to_be_another_motion_and_repeat_the_same() -> None:
    again = make_recordings(MACHINE, truth(2), [("train", 2), ("validate", 2)], seed=4)
    assert named(motion_findings(MACHINE, again)) == [("same_motion", None)]
    other = make_recordings(MACHINE, truth(2), [("train", 2), ("repeat", 3)])
    assert named(motion_findings(MACHINE, other)) == [("no_repeat", None)]


def test_a_parked_joint_is_a_remark() -> None:
    machine: Machine = planar_machine(2)
    found = motion_findings(machine, make_recordings(machine, truth(2), [("train", 2)], moving=[0]))
    assert [(own.code, own.joint, own.severity) for own in found] == [("parked", "joint2", "note")]


def test_a_finding_is_json_with_all_that_it_says() -> None:
    own = Finding("unit", "joint1.q: looks like deg", "set its unit to 'deg'", joint="joint1", factor=0.0175)
    said = json.loads(json.dumps(own.to_json()))
    assert Finding(**said | {key: tuple(said[key]) for key in ("alternatives", "channels")}) == own
    assert own.line == "joint1.q: looks like deg; set its unit to 'deg'"


def test_a_sensor_ten_times_noisier_than_its_kind_or_than_elsewhere_is_named() -> None:
    rng = np.random.default_rng(4)

    def noisy(size: float, rows: slice = slice(None)) -> Recording:
        def change(x: np.ndarray) -> np.ndarray:
            x[rows] += size * rng.normal(size=len(x[rows]))
            return x

        return spoilt("joint1.x", change)

    everywhere = noise_findings(MACHINE, [noisy(1.4e-3), SOUND[1]])
    assert named(everywhere) == [("noisy", "joint1.x")]
    assert "times that of the other sensors of its kind" in everywhere[0].text
    alone = planar_machine(1)
    own = make_recordings(alone, truth(1), [("train", 2)])[0]
    change = np.where(np.arange(len(own)) > 1500, 1.4e-3, 0.0) * rng.normal(size=len(own))
    loud = replace(own, values={**own.values, "joint1.x": own.values["joint1.x"] + change})
    found = noise_findings(alone, [loud])
    assert named(found) == [("noisy", "joint1.x")] and "its other stretches" in found[0].text
    assert noise_findings(MACHINE, SOUND) == [] and noise_findings(alone, [own]) == []


def test_a_noisy_sensor_is_compared_with_the_resolution_that_it_is_said_to_have() -> None:
    machine = planar_machine(1, sensors="piston")
    channels = tuple(c.model_copy(update={"resolution": 3e-5}) if c.name == "joint1.x" else c for c in machine.channels)
    machine = machine.model_copy(update={"channels": channels})
    own = make_recordings(machine, truth(1), [("train", 2)])[0]
    assert noise_findings(machine, [own]) == []
    noise = 1.4e-3 * np.random.default_rng(5).normal(size=len(own))
    found = noise_findings(machine, [replace(own, values={**own.values, "joint1.x": own.values["joint1.x"] + noise})])
    assert named(found) == [("noisy", "joint1.x")] and "its resolution" in found[0].text


@pytest.mark.parametrize("hertz", [3.0, 6.0])
def test_a_fast_motion_is_no_noise(hertz: float) -> None:
    """Beside a slow sister: at 50 Hz its fourth differences would be as large as the noise of a bad sensor."""
    values = {
        "joint1.q": 0.3 * np.sin(2 * np.pi * hertz * SOUND[0].time) + 1e-5 * np.random.default_rng(1).normal(size=2000),
        "joint2.q": 0.3 * np.sin(2 * np.pi * 0.2 * SOUND[0].time) + 1e-5 * np.random.default_rng(2).normal(size=2000),
    }
    assert noise_findings(MACHINE, [replace(SOUND[0], values=values)]) == []


def with_speeds(factors: dict[str, float]) -> tuple[Machine, Recording]:
    channels = [
        Channel(name=f"{joint}.speed", quantity="joint_velocity", joint=joint, unit="rad/s") for joint in factors
    ]
    machine = MACHINE.model_copy(update={"channels": (*MACHINE.channels, *channels)})
    values = dict(SOUND[0].values)
    for joint, factor in factors.items():
        values[f"{joint}.speed"] = factor * np.gradient(SOUND[0].values[f"{joint}.q"], 1 / MACHINE.rate_hz)
    return machine, replace(SOUND[0], values=values)


def test_recorded_speeds_that_all_contradict_the_positions_are_the_time_axis() -> None:
    machine, recording = with_speeds({"joint1": 20.0, "joint2": 20.0})
    (found,) = speed_findings(machine, [recording])
    assert found.code == "wrong_rate" and "1 ms apart instead of 20 ms" in found.text
    machine, recording = with_speeds({"joint1": 1.0, "joint2": 57.3})
    (found,) = speed_findings(machine, [recording])
    assert (found.code, found.channel) == ("scale", "joint2.speed")
    machine, recording = with_speeds({"joint1": 1.0, "joint2": 1.02})
    assert speed_findings(machine, [recording]) == []


def test_a_parked_joint_is_no_witness_that_a_motion_is_another_one() -> None:
    """What it trembles differs from run to run by as much as it trembles."""
    machine = planar_machine(3)
    rng = np.random.default_rng(6)

    def held(recording: Recording) -> Recording:
        count = len(recording)
        position = {n: np.mean(recording.values[n]) + 1e-5 * rng.normal(size=count) for n in ("joint3.q", "joint3.x")}
        force = {n: np.mean(recording.values[n]) + 1e4 * rng.normal(size=count) for n in ("joint3.head", "joint3.rod")}
        return replace(recording, values={**recording.values, **position, **force})

    runs = [held(r) for r in make_recordings(machine, truth(3), [("train", 2), ("repeat", 2)])]
    assert named(motion_findings(machine, runs)) == []


@pytest.mark.parametrize(("share", "severity"), [(0.015, "note"), (0.2, "note"), (0.4, "mistake")])
def test_single_lost_rows_are_a_note_up_to_a_fifth(share: float, severity: str) -> None:
    kept = np.random.default_rng(8).random(2000) > share
    found = time_findings(MACHINE, "run.csv", np.arange(2000)[kept] / MACHINE.rate_hz, {})
    assert [(own.code, own.severity) for own in found] == [("lost_rows", severity)]


def test_rows_that_repeat_the_one_before_are_a_note() -> None:
    source = np.arange(len(SOUND[0]))
    source[[50, 400, 700]] -= 1
    again = replace(SOUND[0], values={name: np.asarray(own)[source] for name, own in SOUND[0].values.items()})
    (own,) = repeated_findings(again)
    assert (own.code, own.severity, own.recording) == ("lost_rows", "note", again.file)
    assert "3 rows" in own.text and f"{again.time[50]:.6g} s" in own.text
    assert repeated_findings(SOUND[0]) == []
    assert named(list(check_recordings(MACHINE, [again]))) == []


def test_other_rows_lost_in_each_run_do_not_make_another_motion_of_it() -> None:
    """Laid row upon row without their clock, a fifth of the rows lost here and there shifts one against the other."""
    whole = make_recordings(MACHINE, truth(2), [("train", 2), ("repeat", 2), ("validate", 3)])
    rng = np.random.default_rng(9)
    holed = []
    for recording in whole:
        kept = rng.random(len(recording)) > 0.2
        values = {name: own[kept] for name, own in recording.values.items()}
        holed.append(replace(recording, time=recording.time[kept], values=values))
    assert named(list(check_recordings(MACHINE, holed))) == []


def test_the_effort_of_a_joint_that_stands_may_have_few_levels() -> None:
    def steps(values: np.ndarray) -> np.ndarray:
        return np.round(values / (np.ptp(values) / 10)) * (np.ptp(values) / 10)

    moves = spoilt("joint1.head", steps)
    assert named(signal_findings(MACHINE, moves)) == [("coarse", "joint1.head")]
    stands = spoilt("joint1.q", lambda q: np.full_like(q, q[0]), moves)
    assert ("coarse", "joint1.head") not in named(signal_findings(MACHINE, stands))


#: Keys of findings' texts; their cures are beside them.
TEXTS = {
    key.removeprefix("check_")
    for key in texts("fitting", "en")["messages"]
    if key.startswith("check_") and not key.endswith("_cure")
}


def _calls() -> dict[str, set[str]]:
    """Keys of texts that findings are made of in the sources, and the names of the values that each is given."""
    found: dict[str, set[str]] = {}
    places = Path(findings.__file__).parent.rglob("*.py")
    modules = [list(ast.walk(ast.parse(path.read_text("utf-8")))) for path in places]
    dictionaries = [node for nodes in modules for node in nodes if isinstance(node, ast.Dict)]
    # Values that several keys have are a dictionary beside the call.
    beside = [key for own in dictionaries for key in own.keys if isinstance(key, ast.Constant)]
    for nodes in modules:
        for call in nodes:
            if getattr(getattr(call, "func", None), "id", "") not in ("finding_of", "worded"):
                continue
            assert isinstance(call, ast.Call)
            words = {str(word.arg) for word in call.keywords}
            words |= {str(key.value) for key in beside} if "None" in words else set()
            chosen = nodes if isinstance(call.args[0], ast.Name) else ast.walk(call.args[0])  # a name was chosen before
            keys = {str(n.value).replace("/", "_") for n in chosen if isinstance(n, ast.Constant)}
            if isinstance(call.args[0], ast.JoinedStr):
                keys = {key for key in TEXTS if key.startswith(tuple(keys))}
            for key in keys & TEXTS:
                found.setdefault(key, set()).update(words)
    return found


def test_every_text_of_a_finding_is_used_and_gets_its_values() -> None:
    calls = _calls()
    assert calls.keys() == TEXTS
    for key, values in calls.items():
        named = {*placeholders(f"fitting.check_{key}"), *placeholders(f"fitting.check_{key}_cure")}
        assert named - {"channel", "joint"} <= values, key
