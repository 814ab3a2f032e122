"""Kinematic errors put into a joint encoder are named and rebuilt from the two position sensors alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from synthetic_arm import (
    RATE,
    clean_session,
    force,
    make_motion,
    make_recordings,
    make_session,
    planar_machine,
    sample,
    truth,
)

from daq.machine.machine_file import Machine
from fitting.arm.linkage import lever_arm
from fitting.effects import effect
from fitting.effects.base import Shape
from fitting.loop.kinematic_check import (
    KinematicFinding,
    Kinematics,
    _rebuilt_by,
    _rows,
    _with_efforts,
    gap_posteriors,
    kinematics,
)
from fitting.loop.session import Options, Session
from fitting.pipeline.results.loop_content import kinematic
from fitting.residual.findings import Hypothesis
from fitting.residual.kinematics import GapColumns, GapRows, checkable, gap_columns, gap_error, with_forces
from fitting.residual.stored_terms import corrections_from_json, step_to_json
from fitting.residual.terms import Term
from fitting.selection.decision import together
from fitting.selection.gaps import GapPosterior, GapSet, _Evidence
from fitting.signals.corrections import Corrections

ARM = truth(2)
ROLES = (("unloaded", 1), ("train", 2), ("repeat", 2), ("validate", 3))


def with_reading(reading: Callable[[np.ndarray], np.ndarray], joint: int = 1) -> Session:
    """An arm with an encoder that reads something else."""
    return make_session(planar_machine(2), ARM, joint_reading=lambda j, q: reading(q) if j == joint else q)


@cache
def with_offset(offset: float) -> tuple[Session, Kinematics]:
    """An encoder whose zero is off by so many rad, and what is found of it; shared by tests that only read it."""
    session = with_reading(lambda q: q + offset)
    return session, kinematics(session)


def named(findings: tuple[KinematicFinding, ...], effect: str, joint: int) -> KinematicFinding:
    """The one finding; it has the name first or in its set."""
    assert [f.joint for f in findings] == [joint]
    assert effect in (findings[0].effect.id, *findings[0].rivals)
    return findings[0]


def gap_left(session: Session, corrections: Corrections, joint: int) -> tuple[float, float]:
    """Gap on the validation motion before and after, m."""
    changed = session.prepared(corrections)
    validate = session.plain.validate
    return gap_error(session.plain.design, validate, joint), gap_error(changed.design, validate, joint)


def test_two_sound_encoders_show_no_eccentricity() -> None:
    found = kinematics(clean_session(2))
    findings, corrections = found.findings, found.corrections
    assert findings == ()
    assert corrections == Corrections(clean_session(2).machine)


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.002, -0.03])
def test_an_encoder_offset_is_named_measured_and_rebuilt(offset: float) -> None:
    session, found = with_offset(offset)
    findings, corrections = found.findings, found.corrections
    finding = named(findings, "encoder_offset", 1)
    assert "encoder_eccentricity" not in finding.rivals, "an eccentricity without harmonics is an offset"
    if finding.effect.id == "encoder_offset":
        assert finding.values[0] == pytest.approx(offset, abs=max(4 * finding.stds[0], 1e-5))
    before, after = gap_left(session, corrections, 1)
    assert before > 10 * after
    assert (finding.gap_before, finding.gap_after) == pytest.approx((before, after), rel=1e-6)
    # Some tens of micrometres of encoder noise, filtered, are left.
    assert after < 2e-5


@pytest.mark.slow
@pytest.mark.parametrize(("n", "zeroed"), [(2, False), (4, True)])
def test_an_eccentric_encoder_is_named_with_its_harmonic(n: int, zeroed: bool) -> None:
    """Encoders are zeroed on the machine, so that the error is zero there and not on average."""
    zero = -0.002 if zeroed else 0.0
    session = with_reading(lambda q: q + 0.004 * np.sin(n * q) + 0.002 * np.cos(n * q) + zero)
    found = kinematics(session)
    findings, corrections = found.findings, found.corrections
    finding = named(findings, "encoder_eccentricity", 1)
    if finding.effect.id == "encoder_eccentricity" and finding.steps[0].shape["n"] == n:
        assert finding.values == pytest.approx((0.004, 0.002, zero), abs=2e-4)
    before, after = gap_left(session, corrections, 1)
    assert before > 10 * after and after < 2e-5


@pytest.mark.parametrize("n", [1.0, 3.0, 8.0])
def test_the_error_of_an_eccentric_encoder_is_a_harmonic_of_the_angle_and_not_of_its_reading(n: float) -> None:
    machine = planar_machine(2)
    q = np.linspace(-3.0, 3.0, 601)
    reading = q + 0.012 * np.sin(n * q) - 0.02 * np.cos(n * q) + 0.003
    corrections = effect("encoder_eccentricity").apply_to_signals(
        Corrections(machine), "joint2", {"n": n}, (0.012, -0.02, 0.003)
    )
    assert reading - corrections.position_error["joint2"](reading) == pytest.approx(q, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("parameter", "shift"), [("b", 0.004), ("a", -0.006), ("retracted", 0.003)])
def test_a_shifted_pin_is_named_and_the_linkage_rebuilt(parameter: str, shift: float) -> None:
    machine = planar_machine(2)
    true = _shifted(machine, 1, parameter, shift)
    recordings = []
    for number, (role, seed) in enumerate((("unloaded", 1), ("train", 2), ("repeat", 2), ("validate", 3))):
        motion = make_motion(true, role, seed)
        recordings.append(sample(true, motion, force(true, ARM, motion), role, 1, number=number))
    session = Session(machine, recordings)
    found = kinematics(session)
    findings, corrections = found.findings, found.corrections
    finding = named(findings, "linkage_geometry", 1)
    entry = kinematic(machine, finding).effect["parameters"]
    fitted = {p.name: value for p, value in zip(finding.effect.parameters, finding.values, strict=True)}
    assert {name: entry[name]["value"] for name in fitted} == fitted, "a shape's choice of the same name hides a value"
    before, after = gap_left(session, corrections, 1)
    assert before > 10 * after and after < 3e-5
    if finding.effect.id == "linkage_geometry" and len(finding.rivals) == 0:
        found = corrections.machine.joints[1].cylinder.linkage  # type: ignore[union-attr]
        assert getattr(found, parameter) == pytest.approx(
            getattr(true.joints[1].cylinder.linkage, parameter),  # type: ignore[union-attr]
            abs=5e-4,
        )


@pytest.mark.slow
@pytest.mark.parametrize("place", ["sensor", "pin"])
def test_play_is_named_with_its_place_and_the_sensors_are_not_fused_any_more(place: str) -> None:
    """An arm that hangs: its load changes sign with the angle, and the piston is half the play ahead on either side.

    Play in the pin makes the piston itself jump, and its friction with it; in the sensor, the reading alone.
    """
    machine = planar_machine(2).model_copy(update={"gravity": (9.81, 0.0, 0.0)})
    bodiless = replace(ARM, pi=0 * ARM.pi)
    recordings = []
    for number, (role, seed) in enumerate((("unloaded", 1), ("train", 2), ("repeat", 2), ("validate", 3))):
        motion = make_motion(machine, role, seed)
        effort = force(machine, ARM, motion)
        if role != "unloaded":
            load = effort - force(machine, bodiless, motion)
            side = gaussian_filter1d(np.sign(load[:, 1]), 8.0)
            x, v, a = motion.x.copy(), motion.v.copy(), motion.a.copy()
            x[:, 1] += 0.001 * side
            v[:, 1] += 0.001 * RATE * np.gradient(side)
            a[:, 1] += 0.001 * RATE**2 * np.gradient(np.gradient(side))
            motion = replace(motion, x=x, v=v, a=a)
            if place == "pin":
                effort = force(machine, ARM, motion)
        recordings.append(sample(machine, motion, effort, role, 1, number=number))
    session = Session(machine, recordings)
    found = kinematics(session)
    findings, corrections = found.findings, found.corrections
    finding = named(findings, "backlash", 1)
    # The model's load crosses zero a little before or after the true one.
    assert finding.values[0] == pytest.approx(0.002, rel=0.1)
    assert corrections.play == {"joint2": place}
    steps = [step_to_json(step) for step in finding.steps]
    assert corrections_from_json(session.machine, steps).play == corrections.play
    assert finding.gap_after < 0.3 * finding.gap_before


@pytest.mark.slow
@pytest.mark.parametrize(("about", "share"), [(False, 0.071), (False, 0.63), (True, 0.3), (True, 0.63)])
def test_play_that_soft_bushings_cross_is_named_where_it_sits_with_its_width(about: bool, share: float) -> None:
    """The width is no value of the fit's grid, and about the joint it is one of the effort, whatever the lever is."""
    machine = planar_machine(2).model_copy(update={"gravity": (9.81, 0.0, 0.0)})
    bodiless = replace(ARM, pi=0 * ARM.pi)
    linkage = machine.joints[1].cylinder.linkage  # type: ignore[union-attr]
    bent = []
    for role, seed in ROLES:
        motion = make_motion(machine, role, seed)
        effort = force(machine, ARM, motion)
        lever = lever_arm(linkage, motion.q[:, 1]) if about else np.ones(len(motion.q))
        bent.append((role, motion, effort, lever, lever * (effort - force(machine, bodiless, motion))[:, 1]))
    width = share * max(np.abs(bending).max() for role, *_, bending in bent if role != "unloaded")
    recordings = []
    for number, (role, motion, effort, lever, bending) in enumerate(bent):
        x = motion.x.copy()
        if role != "unloaded":
            x[:, 1] += 0.5 * lever * (0.01 if about else 0.002) * np.clip(bending / width, -1.0, 1.0)
        recordings.append(sample(machine, replace(motion, x=x), effort, role, 1, number=number))
    finding = named(kinematics(Session(machine, recordings)).findings, "backlash", 1)
    assert (finding.effect.id, finding.rivals) == ("backlash", ())
    assert finding.steps[0].shape["about"] == about
    assert finding.values[0] == pytest.approx(0.01 if about else 0.002, rel=0.03)
    limits = machine.joints[1].limits.position
    mean = np.ptp(linkage.piston_position(np.array(limits))) / np.ptp(limits) if about else 1.0
    assert finding.steps[0].shape["width"] == pytest.approx(width / mean, rel=0.03)


def _open_question(session: Session) -> dict[str, float]:
    """Chances of an encoder's zero and of a pin, as likely as each other by the gap, once the efforts are asked."""
    rows = _rows(session, session.plain, session.base_model.views, 0)
    both = [GapSet((part,)) for part in (_part(rows, "encoder_offset", {}), _part(rows, "linkage_geometry", PIN))]
    posterior, start = GapPosterior(rows, tuple((own, 0.5) for own in both)), Corrections(session.machine)
    fits = {own.pose: session.fit(session.prepared(_rebuilt_by(start, posterior, own))) for own in both}
    return {own.names[0]: p for own, p in _with_efforts(posterior, fits).sets}


def _part(rows: GapRows, name: str, shape: Shape) -> GapColumns:
    found = gap_columns(rows, effect(name), shape)
    assert found is not None
    return found


PIN = {"parameter": 1.0, "turn": 1.0, "zero": 0.0}


@pytest.mark.slow
def test_between_an_encoders_zero_and_a_pin_the_efforts_decide_where_they_feel_it() -> None:
    """An encoder that is off turns all links behind it in the model; a pin that is off leaves them where they are.

    Behind a joint with a twist the links feel that: between parallel axes their centres of mass take it up.
    """
    plain = planar_machine(2)
    twisted = plain.joints[0].model_copy(update={"dh": plain.joints[0].dh.model_copy(update={"alpha": 0.5 * np.pi})})
    machine = plain.model_copy(update={"joints": (twisted, plain.joints[1])})

    def read(offset: float) -> Session:
        return make_session(machine, ARM, joint_reading=lambda j, q: q + offset if j == 0 else q)

    true, recordings = _shifted(machine, 0, "offset", 0.04), []
    for number, (role, seed) in enumerate(ROLES):
        motion = make_motion(true, role, seed)
        recordings.append(sample(true, motion, force(true, ARM, motion), role, 1, number=number))
    assert _open_question(read(0.04))["encoder_offset"] > 0.95
    assert _open_question(Session(machine, recordings))["linkage_geometry"] > 0.95
    assert _open_question(read(1e-5))["encoder_offset"] == pytest.approx(0.5, abs=0.1)


def test_one_position_sensor_cannot_be_checked() -> None:
    for sensors in ("joint", "piston"):
        machine = planar_machine(2, sensors=sensors)
        assert checkable(machine) == ()
        found = kinematics(make_session(machine, ARM))
        findings = found.findings
        assert findings == ()


@pytest.mark.slow
def test_what_was_found_survives_its_way_through_json() -> None:
    session, found = with_offset(-0.03)
    findings, corrections = found.findings, found.corrections
    steps = [step_to_json(s) for f in findings for s in f.steps]
    again = corrections_from_json(session.machine, steps)
    q = np.linspace(-0.5, 0.5, int(RATE))
    assert again.machine == corrections.machine
    assert again.position_error.keys() == corrections.position_error.keys()
    for name, error in corrections.position_error.items():
        assert np.allclose(again.position_error[name](q), error(q), rtol=0, atol=1e-15)


def _shifted(machine: Machine, joint: int, parameter: str, shift: float) -> Machine:
    cylinder = machine.joints[joint].cylinder
    assert cylinder is not None
    linkage = cylinder.linkage.model_copy(update={parameter: getattr(cylinder.linkage, parameter) + shift})
    changed = machine.joints[joint].model_copy(update={"cylinder": cylinder.model_copy(update={"linkage": linkage})})
    joints = tuple(changed if j == joint else own for j, own in enumerate(machine.joints))
    return machine.model_copy(update={"joints": joints})


@pytest.mark.slow
def test_a_joint_that_is_parked_half_of_the_time_is_no_witness_of_eccentricity() -> None:
    """A sensor that stands repeats one error a thousand times, and its silence is no measure of its noise."""
    machine, seeds = planar_machine(2), (("unloaded", 1), ("train", 2), ("repeat", 2), ("validate", 3))
    recordings = []
    for number, recording in enumerate(make_recordings(machine, ARM, seeds)):
        count, rng = len(recording), np.random.default_rng(number)
        values = {}
        for name, own in recording.values.items():
            held = np.full(count, own[-1])
            if name.endswith(("head", "rod")):
                held = held + np.std(np.diff(own, 4)) / np.sqrt(70) * rng.normal(size=count)
            values[name] = np.concatenate([own, held])
        time = np.arange(2 * count) / RATE
        recordings.append(recording if recording.role == "unloaded" else replace(recording, time=time, values=values))
    session = Session(machine, recordings, Options(loop=False))
    assert kinematics(session).findings == ()
    whole = Session(machine, make_recordings(machine, ARM, seeds), Options(loop=False))
    kept = [
        [sum(int(own[i].keep.sum()) for i in s.plain.fitted) for own in s.plain.design.blocks] for s in (session, whole)
    ]
    # Where it stops the filters have no end to lose rows at.
    assert np.allclose(*kept, rtol=0.03), "what stands is counted"
    for first, second in zip(session.position_noise, whole.position_noise, strict=True):
        assert first.speed == pytest.approx(second.speed, rel=0.1)


def bent_session(
    change: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray], joint: int = 1, moves: bool = False
) -> Session:
    """An arm whose piston's sensor reads more by what ``change`` makes of (angles, load in N, time).

    With ``moves`` the piston itself does, and friction and inertia follow that.
    """
    machine = planar_machine(2)
    bodiless = replace(ARM, pi=0 * ARM.pi)
    recordings = []
    for number, (role, seed) in enumerate((("unloaded", 1), ("train", 2), ("repeat", 2), ("validate", 3))):
        motion = make_motion(machine, role, seed)
        effort = force(machine, ARM, motion)
        if role != "unloaded":
            load = (effort - force(machine, bodiless, motion))[:, joint]
            x = motion.x.copy()
            x[:, joint] += change(motion.q, load, np.arange(len(x)) / RATE)
            motion = replace(motion, x=x)
            if moves:
                speed = np.gradient(x, 1 / RATE, axis=0)
                effort = force(machine, ARM, replace(motion, v=speed, a=np.gradient(speed, 1 / RATE, axis=0)))
        recordings.append(sample(machine, motion, effort, role, 1, number=number))
    return Session(machine, recordings)


def lever(machine: Machine, q: np.ndarray) -> np.ndarray:
    cylinder = machine.joints[1].cylinder
    assert cylinder is not None
    x = cylinder.linkage.piston_position
    return np.asarray((x(q + 1e-6) - x(q - 1e-6)) / 2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("about", [False, True])
def test_a_structure_that_bends_is_named_with_its_place(about: bool) -> None:
    """Along the cylinder it gives way by c F, about the joint by c r^2 F: found to a few per cent, and no geometry.

    It moves too little here for the efforts to tell whether the piston moves, and nothing is said of that.
    """
    machine = planar_machine(2)
    compliance = 2e-5 if about else 4e-7

    def change(q: np.ndarray, load: np.ndarray, time: np.ndarray) -> np.ndarray:
        return compliance * (lever(machine, q[:, 1]) ** 2 if about else 1.0) * load

    found = kinematics(bent_session(change))
    (finding,) = found.findings
    assert (finding.effect.id, finding.joint) == ("structural_flexibility", 1)
    assert finding.steps[0].shape["about"] == about
    assert finding.values[0] == pytest.approx(compliance, rel=0.05)
    assert found.laws == () and found.corrections.play == {"joint2": "pin"} and "sensor" not in finding.steps[0].shape


@pytest.mark.slow
@pytest.mark.parametrize("moves", [False, True])
def test_the_efforts_tell_whether_the_piston_moves_by_what_gives_way(moves: bool) -> None:
    """It gives way much: friction turns with the piston's own speed, or with the joint's."""
    (finding,) = kinematics(bent_session(lambda q, load, time: 1e-5 * load, moves=moves)).findings
    assert finding.effect.id == "structural_flexibility" and finding.steps[0].shape["sensor"] == (not moves)


@pytest.mark.slow
def test_an_encoders_zero_is_told_from_a_pin_beside_a_structure_that_bends_much() -> None:
    """It bends by a hundredth under its load: no mean of both sensors is right, nor the load at that mean."""
    machine, offset, compliance = planar_machine(2), 4e-4, 6e-5

    def change(q: np.ndarray, load: np.ndarray, time: np.ndarray) -> np.ndarray:
        x = machine.joints[1].cylinder.linkage.piston_position  # type: ignore[union-attr]
        return compliance * lever(machine, q[:, 1]) ** 2 * load + x(q[:, 1] - offset) - x(q[:, 1])

    session = bent_session(change)
    own = gap_posteriors(session)[1]
    zero, structure = (one.part for one in own.conclusions())
    assert zero is not None and structure is not None
    assert (zero.effect.id, structure.effect.id) == ("encoder_offset", "structural_flexibility")
    assert [one.rivals for one in own.conclusions()] == [(), ()]
    scores = own.scores(own.conclusions()[0].chosen)
    for score, true in zip(scores, (offset, compliance), strict=True):
        assert score.values[0] == pytest.approx(true, rel=0.02)


@pytest.mark.slow
def test_no_explanation_is_worth_more_than_a_perfect_fit() -> None:
    """Columns that nearly cancel, of a gap of thousands of deviations: no digit of the evidence is made up."""
    machine = planar_machine(2)

    def change(q: np.ndarray, load: np.ndarray, time: np.ndarray) -> np.ndarray:
        return 6e-5 * lever(machine, q[:, 1]) ** 2 * load + 1e-3 * np.sin(q[:, 1])

    session = bent_session(change)
    rows = with_forces(_rows(session, session.plain, session.base_model.views, 1), session.base_model)
    odds = [own.odds for own in _Evidence(rows).weighed()]
    assert len(odds) > 10
    assert max(odds) <= 0.5 * float(np.sum(rows.values**2))


@pytest.mark.slow
@pytest.mark.parametrize("outside", ["time", "joint1.joint_position", "piston_position"])
def test_what_is_in_no_catalogue_is_a_law_and_no_name(outside: str) -> None:
    """A scale that warms up, a frame that bends with the neighbour, a wave along the rod: 30 to 100 micrometres."""
    machine = planar_machine(2)
    x = machine.joints[1].cylinder.linkage.piston_position  # type: ignore[union-attr]

    def change(q: np.ndarray, load: np.ndarray, time: np.ndarray) -> np.ndarray:
        if outside == "time":
            return 1e-4 * (1 - np.exp(-time / 15.0))
        return 1e-4 * np.sin(2 * q[:, 0]) if outside.startswith("joint1") else 3e-5 * np.sin(x(q[:, 1]) / 0.006)

    found = kinematics(bent_session(change))
    assert found.findings == ()
    (law,) = found.laws
    assert (law.joint, law.law.law.variable(("joint1", "joint2"))) == (1, outside)
    assert law.probability > 0.9
    (best, *_) = found.hypotheses
    assert [term.id for term in best.terms] == ["law"]


@pytest.mark.slow
def test_two_at_once_are_both_named_and_hypotheses_have_them() -> None:
    """An encoder's offset beside mounts that give way: neither hides the other, and "nothing" is not said beside."""
    machine = planar_machine(2)
    x = machine.joints[1].cylinder.linkage.piston_position  # type: ignore[union-attr]

    def change(q: np.ndarray, load: np.ndarray, time: np.ndarray) -> np.ndarray:
        return 4e-7 * load + x(q[:, 1] - 0.002) - x(q[:, 1])

    found = kinematics(bent_session(change))
    names = [(f.effect.id, *f.rivals) for f in found.findings]
    assert len(names) == 2
    assert "encoder_offset" in names[0] and names[1] == ("structural_flexibility",)
    assert sum(h.probability for h in found.hypotheses if not h.terms) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("bits", [12, 14, 16])
def test_steps_of_a_coarse_encoder_and_a_late_bus_are_nobodys_fault(bits: int) -> None:
    """Steps of slow motion are no white noise, and a delay of 6 ms between both sensors is no law of speed."""
    machine, step = planar_machine(2), 2 * np.pi / 2**bits
    recordings = []
    for recording in make_recordings(machine, ARM, ROLES):
        late = np.interp(recording.time - 0.006, recording.time, recording.values["joint2.q"])
        values = {**recording.values, "joint2.q": np.round(late / step) * step}
        recordings.append(recording if recording.role == "unloaded" else replace(recording, values=values))
    found = kinematics(Session(machine, recordings, Options(loop=False)))
    assert found.findings == () and found.laws == ()
    assert [h.terms for h in found.hypotheses[:1]] == [()]


def test_explanations_of_positions_and_of_efforts_are_said_together_and_a_name_once() -> None:
    flexible = Term(effect("structural_flexibility"), 1, {"about": 1.0})
    offset, same = Term(effect("encoder_offset"), 0), Term(effect("structural_flexibility"), 1)
    positions = (Hypothesis((flexible, offset), 0.9), Hypothesis((), 0.1))
    both = together(positions, (Hypothesis((same,), 0.75), Hypothesis((), 0.25)))
    assert [h.probability for h in both] == pytest.approx([0.675, 0.225, 0.075, 0.025])
    assert [{t.family for t in h.terms} for h in both[:2]] == [{flexible.family, offset.family}] * 2
    assert all(len(h.terms) == len({t.family for t in h.terms}) for h in both)
    assert sum(h.probability for h in both) == pytest.approx(1.0)
