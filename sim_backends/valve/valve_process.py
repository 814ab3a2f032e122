"""The process of a machine with valves and of its own controller, behind the simulated buses.

It is what :mod:`sim_backends.plant.plant_process` is, with the other plant: commands come first and motion follows from
them. Each period the controller looks where the pistons are and sends commands, which are held until the next one; what
it sends stands beside pressures and positions of the same moment, for whoever listens.

It takes two kinds of files from its inbox: valve motions (:mod:`daq.valve_motions`), whose commands it plays, and
motion files (:mod:`daq.motion_files`), which it follows by feedback and what its people guess of the valves.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import numpy as np

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.valve_motions import VALVE_SCHEMA, Does, Step, ValveAxis, ValveMotion
from sim_backends.arrays import FloatArray
from sim_backends.plant.controller import Phase as State
from sim_backends.plant.motion import Motion, SplinePath, read_motion
from sim_backends.plant.plant_process import ended_quietly, serve
from sim_backends.plant.sensors import SensorChain
from sim_backends.plant.truth import SensorQuality
from sim_backends.valve.effects import ValveEffectSpec, with_effect
from sim_backends.valve.motion import Follow, GoTo, Guess, Hold, Operator, Phase, Swing
from sim_backends.valve.plant import ValvePlant
from sim_backends.valve.recording import COMMAND_STEPS, Course, channel_values, guesses_of
from sim_backends.valve.truth import ValvePlantTruth


def is_valve_motion(path: str | Path) -> bool:
    """Test whether a file begins as a valve motion does; False as well for an unreadable one."""
    try:
        with Path(path).open("rb") as file:
            return file.read(64).startswith(f"# {VALVE_SCHEMA}".encode())
    except OSError:
        return False


def read_valve_motion(path: str | Path, machine: Machine) -> ValveMotion:
    """Read a valve motion and check it for ``machine``: axes with valves, commands and positions within their ranges.

    Raises
    ------
    InputError
        With one line: file, line, what is wrong.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        raise InputError("sim_backends.valve_motion_not_readable", path=path) from None
    head = [line for line in lines if line.startswith("#")]
    table = lines[len(head) :]
    if not head or not head[0].startswith(f"# {VALVE_SCHEMA} machine=") or not table:
        raise InputError("sim_backends.not_a_valve_motion", path=path, schema=VALVE_SCHEMA)
    name = head[0].partition("machine=")[2]
    if name != machine.name:
        raise InputError("sim_backends.valve_motion_other_machine", path=path, owner=name, machine=machine.name)
    axes = tuple(_axis(f"{path}:{place}", line, machine) for place, line in enumerate(head[1:], start=2))
    place = len(head) + 1
    if table[0] != ",".join(["does,seconds,hz", *(own.axis for own in axes)]):
        raise InputError("sim_backends.valve_motion_header", path=path, line=place)
    steps = tuple(_step(f"{path}:{place + k}", line, axes) for k, line in enumerate(table[1:], start=1))
    if not steps:
        raise InputError("sim_backends.valve_motion_without_steps", path=path)
    return ValveMotion(name, axes, steps)


def _axis(where: str, line: str, machine: Machine) -> ValveAxis:
    words: Mapping[str, str] = dict(word.split("=", 1) for word in line.removeprefix("#").split() if "=" in word)
    try:
        known = [float(words[field.name]) for field in fields(ValveAxis)[1:]]
        own = ValveAxis(words["axis"], *known)
    except (KeyError, ValueError):
        needs = [field.name for field in fields(ValveAxis)]
        raise InputError("sim_backends.valve_axis_needs", where=where, needs=needs) from None
    joint = next((joint for joint in machine.joints if joint.name == own.axis), None)
    if joint is None or joint.cylinder is None or joint.cylinder.valve is None:
        raise InputError("sim_backends.valve_axis_no_joint", where=where, machine=machine.name, axis=own.axis)
    low, high = joint.limits.position
    fits = np.isfinite(known).all() and low <= own.low < own.high <= high and 0 <= own.edge < 1 and own.delay >= 0
    if not fits or own.full == 0 or own.speed <= 0 or not 0 < own.most <= 1 or own.rate <= 0:
        raise InputError("sim_backends.valve_axis_beyond", where=where, axis=own.axis, low=low, high=high)
    return own


def _step(where: str, line: str, axes: tuple[ValveAxis, ...]) -> Step:
    cells = line.split(",")
    try:
        seconds, hz, *values = (float(cell) for cell in cells[1:])
    except ValueError:
        seconds, hz, values = np.nan, 0.0, []
    does: Does | None = next((own for own in get_args(Does) if own == cells[0]), None)
    if does is None or len(values) != len(axes) or not np.isfinite([hz, *values]).all() or not 0 < seconds < np.inf:
        raise InputError("sim_backends.valve_step_none", where=where, line=line[:40])
    for own, value in zip(axes, values, strict=True):
        if does == "go" and not own.low <= value <= own.high:
            raise InputError(
                "sim_backends.valve_step_position_beyond",
                where=where,
                axis=own.axis,
                value=value,
                low=own.low,
                high=own.high,
            )
        if does != "go" and abs(own.share(value)) > own.most * (1.0 + 1e-6):
            raise InputError(
                "sim_backends.valve_step_command_beyond", where=where, axis=own.axis, value=value, most=own.most
            )
    return Step(does, seconds, tuple(values), hz)


DT = 2.0e-3  # s: half the work of an offline step, to keep up with a machine at four times its speed
POWER_ON = 900.0  # s for which the machine has run: its oil is warm
#: Effects of the demonstration's crane that no file declares.
DEMO = (ValveEffectSpec("spool_hysteresis", "play", "boom", 0.02),)


def read_any_motion(path: Path, machine: Machine) -> Motion | ValveMotion:
    """Read a valve motion, or a motion file with rods pinned (InputError, one line, else)."""
    if is_valve_motion(path):
        return read_valve_motion(path, machine)
    motion = read_motion(path, machine)
    if motion.rods != "pinned":
        raise InputError("sim_backends.valves_rods_unpinned", path=path)
    return motion


class _ValveController:
    """Plays what it is given, one after the other, and closes all valves when nothing is left."""

    def __init__(self, machine: Machine, guesses: Sequence[Guess]) -> None:
        self._machine, self._guesses, self._period = machine, list(guesses), 1.0 / machine.rate_hz
        self.phase: State = "idle"
        self.motion, self.pinned = "", True
        self._queue: deque[tuple[str, State, Operator, tuple[FloatArray, FloatArray]]] = deque()
        self._share = np.zeros(len(machine.joints))

    def follow(self, motion: Motion | ValveMotion, name: str) -> None:
        """Queue a motion."""
        count = len(self._guesses)
        if isinstance(motion, ValveMotion):
            phases, guesses = played(motion, self._machine, self._guesses)
            most, rate = np.ones(count), np.full(count, np.inf)
            for own in motion.axes:
                number = self._number(own.axis)
                most[number], rate[number] = own.most, own.rate
            self._queue.append((name, "following", Operator(phases, guesses, self._period), (most, rate)))
            return
        time = np.arange(round(motion.duration / self._period) + 1, dtype=np.float64) * self._period
        path = np.tile([0.5 * (guess.low + guess.high) for guess in self._guesses], (len(time), 1))
        for joint, column in zip(motion.joints, SplinePath(motion.time, motion.positions)(time)[0].T, strict=True):
            path[:, self._number(joint)] = self._linkage(joint).piston_position(column)
        spans = zip(path[0], self._guesses, strict=True)
        start = GoTo(tuple(float((x - guess.low) / (guess.high - guess.low)) for x, guess in spans))
        free = np.ones(count), np.full(count, np.inf)
        parts: tuple[tuple[State, Phase], ...] = (("moving_to_start", start), ("following", Follow(path)))
        for state, phase in parts:
            self._queue.append((name, state, Operator([phase], self._guesses, self._period), free))

    def _number(self, joint: str) -> int:
        return [own.name for own in self._machine.joints].index(joint)

    def _linkage(self, joint: str) -> Any:
        cylinder = self._machine.joint(joint).cylinder
        assert cylinder is not None
        return cylinder.linkage

    def commands(self, x: FloatArray) -> FloatArray:
        """Return what it sends now (J,), fractions of full, positive extends, pistons at ``x`` (J,) m."""
        while self._queue:
            name, state, operator, (most, rate) = self._queue[0]
            command = operator(x)
            if operator.done:
                self._queue.popleft()
                continue
            self.motion, self.phase = name, state
            change = rate * self._period
            self._share = np.clip(np.clip(command, -most, most), self._share - change, self._share + change)
            return np.asarray(np.round(self._share * COMMAND_STEPS) / COMMAND_STEPS)
        if self.phase in ("following", "moving_to_start"):
            self.phase = "done"
        self._share = np.zeros(len(self._share))
        return self._share


def played(motion: ValveMotion, machine: Machine, known: Sequence[Guess]) -> tuple[list[Phase], list[Guess]]:
    """Return phases of a valve motion, and what is known of its axes; other valves remain closed."""
    guesses, places, senses = list(known), list[int](), list[float]()
    names = [joint.name for joint in machine.joints]
    for own in motion.axes:
        joint = machine.joint(own.axis)
        assert joint.cylinder is not None
        low, high = (float(x) for x in joint.cylinder.linkage.piston_position(np.array([own.low, own.high])))
        places.append(names.index(own.axis))
        senses.append(float(np.sign(high - low)))
        speed = own.speed * abs(high - low) / (own.high - own.low)
        guesses[places[-1]] = Guess(min(low, high), max(low, high), speed, own.edge, own.delay)
    phases: list[Phase] = []
    for step in motion.steps:
        if step.does == "go":
            pose = [0.5] * len(names)
            for place, own, q in zip(places, motion.axes, step.values, strict=True):
                joint = machine.joint(own.axis)
                assert joint.cylinder is not None
                x = float(joint.cylinder.linkage.piston_position(np.array([q]))[0])
                pose[place] = (x - guesses[place].low) / (guesses[place].high - guesses[place].low)
            phases.append(GoTo(tuple(pose), step.seconds))
            continue
        shares = [0.0] * len(names)
        for place, sense, own, value in zip(places, senses, motion.axes, step.values, strict=True):
            shares[place] = sense * own.share(value)
        held = Hold(tuple(shares), step.seconds)
        phases.append(held if step.does == "hold" else Swing(tuple(shares), step.hz, step.hz * step.seconds))
    return phases, guesses


class ValveMachine:
    """A machine with valves, its controller and its transducers, a period at a time."""

    def __init__(
        self, machine: Machine, truth: ValvePlantTruth, quality: SensorQuality, rng: np.random.Generator
    ) -> None:
        guessing, restless, sensors = rng.spawn(3)
        self._machine = machine
        self._plant = ValvePlant([(machine, truth)], DT, POWER_ON, [restless])
        self._per_period = round(1.0 / machine.rate_hz / DT)
        self._chain = SensorChain(machine, quality, sensors)
        self.controller = _ValveController(machine, guesses_of(machine, truth, guessing))

    def coming(self, most: int) -> int:
        """Count the periods to compute at once, of ``most``."""
        return 1 if self.controller.phase in ("following", "moving_to_start") else most

    def advance(self, periods: int) -> FloatArray:
        """Run so many periods; measured values (periods, channels) in SI at their beginnings, commands as sent then."""
        names = [joint.name for joint in self._machine.joints]
        rows = []
        for _ in range(periods):
            state = self._plant.state
            command = self.controller.commands(state.x[:, 0])
            now = Course(np.zeros(1), command[None], state.q.T, state.x.T, state.v.T, state.stroke.T,
                         np.moveaxis(state.pressure, 2, 0), state.supply, state.tank, state.temperature)  # fmt: skip
            rows.append([
                float(channel_values(self._machine, now, c.quantity, names.index(c.joint) if c.joint else -1)[0])
                for c in self._machine.channels
            ])  # fmt: skip
            for _ in range(self._per_period):
                self._plant.step(command[:, None])
        return self._chain(np.array(rows))


def build(configuration: Mapping[str, Any], machine: Machine) -> ValveMachine:
    """Build the machine of a process' configuration."""
    truth = ValvePlantTruth.from_dict(configuration["truth"])
    undeclared = configuration["undeclared"]
    for spec in DEMO if undeclared == "demo" else [ValveEffectSpec(*item) for item in undeclared]:
        truth = with_effect(machine, truth, spec)
    quality = SensorQuality(**configuration["quality"])
    return ValveMachine(machine, truth, quality, np.random.default_rng(configuration["seed"]))


if __name__ == "__main__":
    ended_quietly(lambda: serve(build, read_any_motion))
