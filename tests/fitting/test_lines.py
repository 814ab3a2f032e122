"""Spectral lines: found with frequency, amplitude and phases; never where noise, knocks or the motion made a peak."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from synthetic_arm import clean_session

from daq.recordings.recording import Recording
from fitting.effects import effect
from fitting.loop.session import Session
from fitting.residual.levelling import Part, residual_parts
from fitting.residual.lines import Line, RefutedLine, find_lines, is_ripple, line_phases
from fitting.residual.terms import Term, fit_model
from sim_backends import EffectSpec, folding_arm
from sim_backends.machines import ArmKind
from sim_backends.plant.cases import plan_case
from sim_backends.undeclared import UNDECLARED

RATE, SAMPLES = 50.0, 2900
ROLES = {"unloaded": "unloaded", "train-1": "train", "train-2": "train", "repeat": "repeat"}
Noise = Callable[[np.random.Generator, int], np.ndarray]


def coloured(rng: np.random.Generator, n: int) -> np.ndarray:
    """A disturbance of first order with 0.15 s, and a sensor's white noise."""
    return np.asarray(signal.lfilter([1.0], [1.0, -0.875], rng.standard_normal(n)) + rng.standard_normal(n))


def knocked(rng: np.random.Generator, n: int) -> np.ndarray:
    """The same with a knock every ten seconds, ten times as strong as the noise."""
    out = coloured(rng, n)
    for at in rng.integers(0, n - 3, rng.poisson(n / RATE / 10)):
        out[at : at + 2] += rng.uniform(-1, 1) * 20.0
    return out


def stepped(rng: np.random.Generator, n: int) -> np.ndarray:
    """A slow signal through a coarse analogue-digital converter."""
    return np.round(0.3 * signal.lfilter([1.0], [1.0, -0.95], rng.standard_normal(n)))


def resonant(rng: np.random.Generator, n: int) -> np.ndarray:
    """A lightly damped structure at 5 Hz (2 %), shaken by the noise: a peak of a fifth of a hertz."""
    pole = np.exp((-0.02 + 1j) * 2 * np.pi * 5.0 / RATE)
    shaken = signal.lfilter([1.0], np.poly([pole, pole.conjugate()]).real, rng.standard_normal(n))
    return np.asarray(shaken + rng.standard_normal(n))


NOISES: dict[str, Noise] = {
    "white": lambda rng, n: rng.standard_normal(n),
    "coloured": coloured,
    "knocked": knocked,
    "stepped": stepped,
    "resonant": resonant,
    "heavy-tailed": lambda rng, n: rng.standard_t(2.5, n),
    "differenced": lambda rng, n: np.diff(rng.standard_normal(n + 2), 2),
}


def parts(seed: int, noise: Noise = coloured, count: int = 4, samples: int = SAMPLES) -> list[Part]:
    rng = np.random.default_rng(seed)
    time = np.arange(samples) / RATE
    return [Part(r, time, noise(rng, samples), r, 0, np.zeros((samples, 0))) for r in range(count)]


def with_sine(clean: list[Part], frequency: float, amplitude: float, only: tuple[int, ...] | None = None) -> list[Part]:
    """A sinusoid added, in recording ``r`` with phase ``r``."""
    return [
        p
        if only is not None and p.recording not in only
        else replace(p, residual=p.residual + amplitude * np.sin(2 * np.pi * frequency * p.time + p.recording))
        for p in clean
    ]


def background(frequency: float) -> float:
    """Amplitude spectral density of `coloured` noise per root sample."""
    return float(np.sqrt(np.abs(1.0 / (1.0 - 0.875 * np.exp(-2j * np.pi * frequency / RATE))) ** 2 + 1.0))


@pytest.mark.parametrize("frequency", [0.61, 1.7, 3.3, 7.0, 18.0, 24.2])
def test_a_line_is_found_with_its_frequency_amplitude_and_phases(frequency: float) -> None:
    # lambda = 16 in all: amplitude^2 N / 2 per part over the background's power.
    amplitude = 16.0 * background(frequency) / np.sqrt(4 * SAMPLES / 2)
    lines, refuted = find_lines(2, with_sine(parts(1), frequency, amplitude), RATE, joints=6)
    assert refuted == ()
    (line,) = lines
    assert line.joint == 2
    assert abs(line.frequency_hz - frequency) < 4 * line.frequency_std
    assert line.frequency_std < 0.1 / 58.0
    assert abs(line.amplitude - amplitude) < 4 * line.amplitude_std
    assert line.z == pytest.approx(0.5 * 16.0**2, rel=0.35)
    for recording, phase in line.phases.items():
        # A twentieth of a bin of frequency turns the phase at t = 0 by a tenth of pi.
        assert abs((phase - recording + np.pi) % (2 * np.pi) - np.pi) < 0.8


def test_an_aliased_ripple_shows_where_sampling_folds_it() -> None:
    # 63 Hz sampled at 50 Hz is 13 Hz.
    (line,), _ = find_lines(0, with_sine(parts(2), 63.0, 2.0), RATE)
    assert line.frequency_hz == pytest.approx(13.0, abs=1e-3)


@pytest.mark.slow
def test_frequency_errors_are_those_that_were_promised() -> None:
    errors = []
    for seed in range(40):
        (line,), _ = find_lines(0, with_sine(parts(seed, count=2, samples=1500), 4.321, 1.0), RATE)
        errors.append((line.frequency_hz - 4.321) / line.frequency_std)
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.4


def test_several_lines_are_found_one_by_one_strongest_first() -> None:
    both = with_sine(with_sine(parts(3), 7.0, 3.0), 9.4, 1.5)
    lines, refuted = find_lines(0, both, RATE)
    assert [round(line.frequency_hz, 2) for line in lines] == [7.0, 9.4]
    assert refuted == ()
    assert lines[1].amplitude == pytest.approx(1.5, rel=0.15)


@pytest.mark.parametrize("name", NOISES)
@pytest.mark.slow
def test_noise_has_no_lines(name: str) -> None:
    # Two joints of 25 machines of six, at an alarm rate of 1e-3: one alarm has a chance of 0.8 %, two of 3e-5.
    alarms = 0
    for seed in range(25):
        for joint in range(2):  # as if of six
            lines, _ = find_lines(joint, parts(1000 * joint + seed, NOISES[name]), RATE, joints=6)
            alarms += len(lines)
    assert alarms <= 1


@pytest.mark.slow
def test_chances_are_calibrated_where_nothing_is_refuted() -> None:
    found = []
    for seed in range(400):
        lines, _ = find_lines(0, parts(seed, coloured, count=1), RATE, alarm=0.1, most=1)
        found += [line.p for line in lines]
    # 40 expected at most (the up-crossing rate is a bound); 58 has a chance of 3e-3.
    assert 10 < len(found) < 58


@pytest.mark.parametrize("loud", [3.0, 8.0, 40.0])
def test_a_line_is_not_refuted_by_recordings_that_are_too_loud_to_show_it(loud: float) -> None:
    """A cylinder that is free is quiet; with the arm on it there is more noise, and as much of the pump's line."""
    amplitude = 14.0 * background(5.0) / np.sqrt(SAMPLES / 2)
    clean = [replace(p, residual=p.residual * (loud if p.recording else 1.0)) for p in parts(8)]
    (line,), refuted = find_lines(0, with_sine(clean, 5.0, amplitude), RATE)
    assert refuted == ()
    assert line.frequency_hz == pytest.approx(5.0, abs=4 * line.frequency_std)
    lines, refuted = find_lines(0, with_sine(clean, 5.0, amplitude, only=(0,)), RATE)
    # Three times as loud, the others would have shown it; eight times, nobody knows.
    assert len(lines) == (0 if loud < 5 else 1)


def test_a_line_in_one_recording_only_is_refuted() -> None:
    lines, refuted = find_lines(0, with_sine(parts(4), 5.0, 2.0, only=(2,)), RATE)
    assert lines == ()
    assert "one recording only" in refuted[0].reason or "would have shown" in refuted[0].reason


def test_a_line_that_one_recording_lacks_is_refuted() -> None:
    lines, refuted = find_lines(0, with_sine(parts(5), 5.0, 2.0, only=(1, 2, 3)), RATE)
    assert lines == ()
    assert "recording 0 would have shown it" in refuted[0].reason


def test_a_resonance_is_not_narrow() -> None:
    def sharp(rng: np.random.Generator, n: int) -> np.ndarray:
        pole = np.exp((-0.004 + 1j) * 2 * np.pi * 5.0 / RATE)
        return np.asarray(signal.lfilter([1.0], np.poly([pole, pole.conjugate()]).real, rng.standard_normal(n)))

    for seed in range(5):
        lines, refuted = find_lines(0, parts(seed, lambda r, n: sharp(r, n) + 3 * r.standard_normal(n)), RATE)
        assert lines == ()
        assert any("not narrow" in r.reason for r in refuted)


def periodic(seed: int, motion: tuple[int, ...], phase_of: Callable[[int], float]) -> list[Part]:
    """Motions of period 10 s; the residual has a harmonic of it, or a ripple of the same frequency."""
    result = []
    for p in parts(seed):
        position = np.sin(2 * np.pi * 0.1 * p.time + 2.0 * motion[p.recording])
        signals = np.column_stack([position, np.sign(np.gradient(position))])
        ripple = 1.5 * np.sin(2 * np.pi * 0.9 * p.time + phase_of(p.recording))
        result.append(replace(p, residual=p.residual + ripple, motion=motion[p.recording], signals=signals))
    return result


def test_a_harmonic_of_the_motion_is_not_a_line_of_its_own() -> None:
    # Recordings 1 and 3 repeat one motion: what is of the motion is the same in both.
    lines, refuted = find_lines(0, periodic(6, (0, 1, 2, 1), lambda r: 2.0 * (0, 1, 2, 1)[r]), RATE)
    assert lines == ()
    assert refuted[0].reason == "it is a frequency of the motion"


def test_a_ripple_at_a_harmonic_is_told_by_the_difference_of_two_runs() -> None:
    (line,), _ = find_lines(0, periodic(7, (0, 1, 2, 1), lambda r: 1.9 * r), RATE)
    assert line.frequency_hz == pytest.approx(0.9, abs=0.005)


def test_gaps_make_parts_and_a_recording_keeps_one_phase() -> None:
    whole = with_sine(parts(8, count=2), 6.2, 1.5)
    cut = [
        replace(p, time=p.time[s], residual=p.residual[s], signals=p.signals[s])
        for p in whole
        for s in (slice(0, 1200), slice(1300, SAMPLES))
    ]
    (line,), _ = find_lines(0, cut, RATE)
    assert set(line.phases) == {0, 1}
    assert line.amplitude == pytest.approx(1.5, rel=0.15)


def test_phases_of_a_known_frequency_on_another_recording() -> None:
    found = line_phases(4.0, with_sine(parts(9, count=2), 4.0, 3.0))
    assert found[1][0] == pytest.approx(3.0, rel=0.1)
    assert found[1][1] == pytest.approx(1.0, abs=0.1)


def test_a_line_takes_another_recordings_phase_along() -> None:
    whole = with_sine(parts(9, count=4), 4.0, 3.0)
    (line,), _ = find_lines(0, whole[:3], RATE)
    more = line.on(whole[3:])
    assert set(line.phases) == {0, 1, 2}
    assert set(more.phases) == set(more.amplitudes) == {0, 1, 2, 3}
    assert more.phases[3] == pytest.approx(3.0, abs=0.15)
    assert more.shape == {"frequency": line.frequency_hz, **{f"phase_{r}": more.phases[r] for r in range(4)}}


@pytest.mark.parametrize("samples", [0, 100, 255])
def test_short_or_constant_residuals_say_nothing(samples: int) -> None:
    assert find_lines(0, parts(10, samples=samples) if samples else [], RATE) == ((), ())
    assert find_lines(0, parts(10, lambda r, n: np.ones(n)), RATE) == ((), ())


def test_as_a_term_it_takes_the_line_away() -> None:
    session = clean_session(2)
    prepared, fitted = session.plain, session.plain.fitted
    design = prepared.design
    rng = np.random.default_rng(11)
    # 15 N at 1.3 Hz on joint 1, another phase in each recording, on top of 2 N of white noise.
    blocks = [list(row) for row in design.blocks]
    for index, segment in enumerate(design.segments):
        begin = min(float(s.t[0]) for s in design.segments if s.recording == segment.recording)
        ripple = 15.0 * np.sin(2 * np.pi * 1.3 * (segment.t - begin) + 2.0 * segment.recording)
        for joint in range(2):
            block = blocks[joint][index]
            more = 2.0 * rng.standard_normal(len(segment)) + (ripple if joint == 1 else 0.0)
            reduced = block.reduced_target + design.bank.reduce(more)
            blocks[joint][index] = replace(block, target=block.target + more, reduced_target=reduced)
    design = replace(design, blocks=tuple(tuple(row) for row in blocks))
    model = fit_model(design, prepared.noise, fitted, (), session.prior)
    quiet, loud = (
        find_lines(j, residual_parts(design, model.fit.theta, j, fitted, prepared.pairs), RATE, joints=2)[0]
        for j in range(2)
    )
    assert quiet == ()
    (line,) = loud
    term = Term(effect("supply_ripple"), 1, line.shape)
    after = fit_model(design, prepared.noise, fitted, (term,), session.prior)
    a, b = after.fit.theta[after.term_slice(0)]
    assert np.hypot(a, b) == pytest.approx(15.0, rel=0.05)
    assert abs(np.arctan2(b, a)) < 0.1
    rest = residual_parts(design, after.fit.theta, 1, fitted, prepared.pairs, after.extra)
    assert find_lines(1, rest, RATE, joints=2)[0] == ()


def test_a_line_is_a_pumps_ripple_only_where_oil_acts_on_the_joint() -> None:
    hydraulic, _ = folding_arm(0)
    electric = hydraulic.model_copy(update={"joints": [hydraulic.joints[0].model_copy(update={"cylinder": None})]})
    line = Line(0, 7.0, 0.001, 3.0, 0.1, 200.0, 1e-9, {0: 0.0}, {0: 3.0})
    assert is_ripple(hydraulic, line)
    assert not is_ripple(electric, line)


def simulated(
    arm: ArmKind,
    seed: int,
    undeclared: list[tuple[str, str | None, float]],
    frequency: float | None = None,
    seconds: float = 60.0,
) -> list[tuple[tuple[Line, ...], tuple[RefutedLine, ...]]]:
    """Lines in the base model's residual on a simulated arm."""
    plan = plan_case(arm, seed, seconds)
    with pytest.MonkeyPatch.context() as patch:
        if frequency is not None:

            def prepare(self: object, rng: np.random.Generator) -> None:
                vars(self).update(frequency=frequency, phase=rng.uniform(0, 2 * np.pi))

            patch.setattr(UNDECLARED["supply_ripple"], "prepare", prepare)
        tables = {stem: plan.record(stem, [EffectSpec(*own) for own in undeclared])[0] for stem in ROLES}
    recordings = [
        Recording(
            plan.machine.name, ROLES[stem], stem, stem, plan.machine.rate_hz, np.asarray(table["time"]),
            {k: np.asarray(v) for k, v in table.items() if k != "time"},
        )
        for stem, table in tables.items()
    ]  # fmt: skip
    session = Session(plan.machine, recordings)
    plain, theta = session.plain, session.base_model.fit.theta
    count = len(plan.machine.joints)
    parts = [residual_parts(plain.design, theta, j, plain.fitted, plain.pairs) for j in range(count)]
    return [find_lines(j, own, plan.machine.rate_hz, joints=count) for j, own in enumerate(parts)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "frequency"), [("folding", 1.4), ("slewing", 7.1), ("folding", 18.3), ("slewing", 62.0)]
)
def test_a_ripple_of_a_simulated_arm_is_found_on_its_joint(arm: ArmKind, frequency: float) -> None:
    found = simulated(arm, 3, [("supply_ripple", "joint2", 3000.0)], frequency, seconds=30.0)
    (line,) = found[1][0]
    folded = abs(frequency - RATE * round(frequency / RATE))
    assert line.frequency_hz == pytest.approx(folded, abs=0.005)
    assert all(lines == () for joint, (lines, _) in enumerate(found) if joint != 1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "undeclared",
    [
        [],
        [("position_dependent_friction", "joint2", 200.0)],
        [("position_harmonic", "joint1", 150.0)],
        [("carried_liquid", "joint1", 40.0)],
        [("load_dependent_friction", "joint2", 0.2)],
        [("dwell_stiction", "joint3", 300.0)],
    ],
    ids=lambda u: u[0][0] if u else "nothing",
)
def test_other_effects_of_a_simulated_arm_make_no_lines(undeclared: list[tuple[str, str | None, float]]) -> None:
    found = simulated("slewing" if undeclared and undeclared[0][1] == "joint1" else "folding", 17, undeclared)
    assert [lines for lines, _ in found] == [()] * len(found)
