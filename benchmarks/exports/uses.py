"""Uses of a model, on the simulated machine: loops are closed, hits are hits, nothing is computed twice.

One identification of the simulated folding arm hands over the model. Then, on motions that it has not seen:

- *feedforward*: the arm under its position controller (forward dynamics, :mod:`sim_backends.plant.closed_loop`),
  without and with the pressures that ``hilfit feedforward`` writes;
- *memory*: the same with the exported C of a model that remembers, on an arm that does;
- *simulation*: the same controller on the model and on the plant;
- *overload*: forces of known size on the tip, in that closed loop (larger ones throw the wrist beyond stops that the
  plant does not have); and minutes of ordinary motion and of rest in turn for false alarms;
- *payload*: a mass that the arm picks up in the course of a motion;
- *energy*: the work that the model has beside what was measured.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
import pyarrow.csv as arrow_csv
from scipy.interpolate import CubicSpline
from scipy.stats import chi2

from benchmarks.exports.conformance import c_functions, handed_over
from benchmarks.targets import Check, Outcome, Show, figure
from daq.machine.machine_file import Machine
from daq.motion_files import Rods
from daq.recordings.recording import Recording
from fitting.arrays import FloatArray
from fitting.effects import effect
from fitting.loop.session import Options, Session
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.simulation import simulate
from fitting.model.tails import Tail
from fitting.model.uses.energy import energy_of_recording
from fitting.model.uses.feedforward import Trajectory, feedforward, read_path, write_feedforward
from fitting.model.uses.overload import alarms_in, overloads, quick, scores_of, thresholds
from fitting.model.uses.payload import payload_signal
from fitting.residual.terms import Term
from sim_backends import default_machine
from sim_backends.plant.closed_loop import FRICTION_SPEED, ClosedLoop, Run
from sim_backends.plant.motion import Motion, random_motion, write_motion
from sim_backends.plant.plant import record
from sim_backends.plant.truth import SensorQuality, Truth

#: Forces on the tip, N, and how long each acts, s.
HITS, HIT_SECONDS, BETWEEN, COUNT = (30.0, 60.0, 120.0), 0.3, 2.5, 6
#: False alarms an hour that hits are looked for at, and those that are counted: one a day is what a service promises.
STATED = (1.0, 1.0 / 24.0, 20.0)
#: The first motion or pose of those that false alarms are counted in; the others have smaller numbers.
FIRST_MINUTE = 1000
PAYLOADS = (5.0, 20.0)
#: Friction that builds up over a distance, N.
HYSTERESIS = 300.0


@dataclass(frozen=True)
class _Arm:
    """A machine, what it really is, and the seed of its motions and noise: each number another one."""

    machine: Machine
    truth: Truth
    seed: int

    def rng(self, number: int) -> np.random.Generator:
        """Return the random generator of a number."""
        return np.random.default_rng((self.seed, number))

    def recording(
        self, number: int, seconds: float, role: str, undeclared: tuple[tuple[str, str | None, float], ...] = ()
    ) -> Recording:
        """Make an ordinary recording."""
        rng, rods = self.rng(number), "unpinned" if role == "unloaded" else "pinned"
        program = random_motion(self.machine, rng, seconds, rods=cast(Rods, rods))
        return self.seen(role, number, record(self.machine, self.truth, program, undeclared=undeclared, rng=rng))

    def resting(self, number: int, seconds: float) -> Recording:
        """Hold the arm in a pose."""
        rng = self.rng(number)
        low, high = np.array([joint.limits.position for joint in self.machine.joints]).T
        pose = 0.5 * (low + high) + 0.4 * (high - low) * rng.uniform(-1.0, 1.0, len(low))
        names = tuple(joint.name for joint in self.machine.joints)
        held = Motion(self.machine.name, "pinned", names, np.array([0.0, seconds]), np.stack([pose, pose]))
        return self.seen("operation", number, record(self.machine, self.truth, held, rng=rng))

    def seen(self, role: str, number: int, table: dict[str, FloatArray]) -> Recording:
        """Make a recording of a table."""
        time, name = table.pop("time"), f"{role}-{number}"
        return Recording(self.machine.name, role, name, f"{self.seed}-{name}", self.machine.rate_hz, time, table)

    def motion(self, number: int, seconds: float) -> Motion:
        """Draw a motion."""
        return random_motion(self.machine, self.rng(number), seconds)

    def loop(self, quality: SensorQuality | None, number: int) -> ClosedLoop:
        """Put the arm under its position controller."""
        return ClosedLoop(self.machine, self.truth, quality, self.rng(number))


@dataclass(frozen=True)
class _Bench(_Arm):
    """An arm with its identified model, and what thresholds of that are made of."""

    model: ArmModel
    tails: tuple[Tail, ...]


def run(seed: int, hours: float, show: Show) -> Outcome:
    """Run all checks."""
    show("identification")
    bench = _identified(seed)
    checks: list[Check] = []
    parts = {"feedforward": _feedforward, "memory": _memory, "simulation": _simulation, "hits": _hits}
    for name, part in parts.items():
        show(name)
        checks += part(bench)
    show("false alarms")
    checks += _false_alarms(bench, hours)
    show("payload and energy")
    return Outcome((*checks, *_payload(bench), *_energy(bench)))


def _identified(seed: int) -> _Bench:
    arm = _Arm(*default_machine(), seed)
    roles = (("unloaded", 40.0), ("train", 60.0), ("train", 60.0), ("validate", 60.0))
    recordings = [arm.recording(number, seconds, role) for number, (role, seconds) in enumerate(roles)]
    model = handed_over(Session(arm.machine, recordings, Options(loop=False)), ())
    assert model.tails is not None
    return _Bench(arm.machine, arm.truth, seed, model, model.tails)


def _error(run: Run) -> FloatArray:
    """Compute the RMS tracking error per joint, rad."""
    return np.asarray(np.sqrt(np.mean((run.q - run.wanted) ** 2, axis=0)))


def _forces(bench: _Bench, program: Motion, folder: Path) -> Callable[[float], FloatArray]:
    """Return the chambers' forces by the file that ``hilfit feedforward`` writes of a motion file."""
    write_motion(folder / "motion.csv", program)
    found = feedforward(bench.model, read_path(bench.model, folder / "motion.csv"))
    write_feedforward(folder / "feedforward.csv", found)
    table = arrow_csv.read_csv(folder / "feedforward.csv").to_pydict()
    time, columns = np.array(table["time"]), []
    for joint in bench.machine.joints:
        assert joint.cylinder is not None
        head, rod = (np.array(table[f"{joint.name}.{side}_pressure"]) for side in ("head", "rod"))
        columns.append(head * joint.cylinder.head_area - rod * joint.cylinder.rod_area)
    return lambda now: np.array([np.interp(now, time, column) for column in columns])


def _feedforward(bench: _Bench) -> list[Check]:
    program, quality = bench.motion(100, 15.0), SensorQuality()
    with tempfile.TemporaryDirectory() as place:
        known = _forces(bench, program, Path(place))
    loops = [bench.loop(quality, 101) for _ in range(2)]
    alone, helped = (loop.follow(program, loop.gains(), own) for loop, own in zip(loops, (None, known), strict=True))
    factors = _error(alone) / _error(helped)
    shown = f"{np.min(factors):.1f} (by joint {', '.join(f'{f:.0f}' for f in factors)}; "
    shown += f"from {1e3 * np.max(_error(alone)):.1f} to {1e3 * np.max(_error(helped)):.2f} mrad at the worst joint)"
    name = "feedforward: tracking error without over with, the least of all joints"
    return [figure(name, float(np.min(factors)), least=2.0, shown=shown)]


def _memory(bench: _Bench) -> list[Check]:
    """Check an arm whose friction builds up over distance after reversals, exported C beside its controller.

    The plant's hysteresis is a force from outside, calculated from its positions. Tracking errors with the feedforward
    of the C, step by step, of the model itself, and of the model without what it remembers.
    """
    if shutil.which("cc") is None:
        return [Check("memory: closed loop with the exported C", None, "there is no C compiler (apt-get install gcc)")]
    joint, size, distance = 1, HYSTERESIS, 1e-3
    term = Term(effect("presliding_hysteresis"), joint, {"x_s": distance})
    last, n = bench.model.passes[-1], len(bench.model.joints)
    room = np.pad(bench.model.covariance, (0, 1))
    model = replace(
        bench.model,
        terms=(term,),
        passes=(replace(last, theta=np.append(last.theta, size)),),
        covariance=room,
        told=np.append(bench.model.told, True),
        rests=(),
    )
    program, errors = bench.motion(104, 12.0), {}
    with tempfile.TemporaryDirectory() as place:
        write_motion(Path(place) / "motion.csv", program)
        path = read_path(model, Path(place) / "motion.csv")
        forces = {
            "C": _c_forces(model, path, Path(place)),
            "model": motion.on_motion(model, path.q, path.qd, path.qdd, path.t).drive_effort(0),
            "forgetful": motion.on_motion(motion.at_rest(model), path.q, path.qd, path.qdd, path.t).drive_effort(0),
        }
    for name, rows in forces.items():
        loop, state = bench.loop(None, 105), {"x": np.nan, "z": 0.0, "sign": 0.0, "now": -1.0}

        def outside(now: float, q: FloatArray) -> FloatArray:
            x = float(loop.arm.piston(q[None], 0.0 * q[None], 0.0 * q[None])[0][0, joint])  # noqa: B023
            own = state  # noqa: B023
            if np.isnan(own["x"]):
                own["x"] = x
            if now > own["now"] and abs(x - own["x"]) > 1e-9:
                own["sign"] = float(np.sign(x - own["x"]))
                own["z"] = own["sign"] + (own["z"] - own["sign"]) * np.exp(-abs(x - own["x"]) / distance)
                own["x"], own["now"] = x, now
            force = np.zeros(n)
            force[joint] = -size * (own["z"] - own["sign"])
            return np.asarray(force * loop.lever(q))  # noqa: B023

        known = CubicSpline(path.t, rows)
        run = loop.follow(program, loop.gains(), lambda now: known(min(now, path.t[-1])), outside)  # noqa: B023
        errors[name] = _error(run)[joint]
    ratio = float(errors["C"] / errors["model"])
    shown = (
        f"{ratio:.3f} ({1e3 * errors['C']:.3f} mrad; without what it remembers {1e3 * errors['forgetful']:.3f} mrad)"
    )
    return [figure("memory: tracking error with the exported C over that with the model", ratio, most=1.1, shown=shown)]


def _c_forces(model: ArmModel, path: Trajectory, folder: Path) -> FloatArray:
    """Compute drive efforts of a motion by the compiled C, moment by moment."""
    ask, dt, rows = c_functions(model, folder), 1.0 / model.machine.rate_hz, []
    for k, row in enumerate(zip(path.q, path.qd, path.qdd, path.t, strict=True)):
        answers = ask("step", [*row, dt, None], 4) if k else ask("init", [*row, dt], 4)
        rows.append(answers[1])  # of efforts of joints and drives, pressures
    return np.array(rows)


def _simulation(bench: _Bench) -> list[Check]:
    """Run the controller without integrator, which has no state of its own, on plant and model."""
    program, loop = bench.motion(102, 6.0), bench.loop(None, 103)
    gains = loop.gains(integral=False)
    plant = loop.follow(program, gains)
    wanted_x, wanted_v, _, _ = loop.arm.piston(plant.wanted, np.gradient(plant.wanted, plant.t, axis=0), plant.qd)
    start = loop.holding(plant.wanted[0])

    def effort(now: float, q: FloatArray, qd: FloatArray) -> FloatArray:
        lever = motion.levers(bench.model, q[None])[0]
        x = loop.arm.piston(q[None], qd[None], np.zeros((1, len(q))))[0][0]
        place = min(max(now, plant.t[0]), plant.t[-1])
        k = (place - plant.t[0]) / (plant.t[1] - plant.t[0])
        low, share = int(k), k - int(k)
        high = min(low + 1, len(plant.t) - 1)
        aim, rate = ((1 - share) * own[low] + share * own[high] for own in (wanted_x, wanted_v))
        return np.asarray(lever * (start + gains.proportional * (aim - x) + gains.derivative * (rate - lever * qd)))

    found = simulate(bench.model, effort, plant.q[0], seconds=float(plant.t[-1]) - 0.1, friction_speed=FRICTION_SPEED)
    at = np.stack([np.interp(found.t, plant.t, column) for column in plant.wanted.T], axis=1)
    reached = np.stack([np.interp(found.t, plant.t, column) for column in plant.q.T], axis=1)
    ours, theirs = (np.sqrt(np.mean((q - at) ** 2, axis=0)) for q in (found.q, reached))
    apart = np.abs(ours / theirs - 1.0)
    shown = f"{np.max(apart):.1%} (by joint {', '.join(f'{a:.1%}' for a in apart)}; "
    shown += f"errors of {1e3 * theirs.min():.1f} to {1e3 * theirs.max():.1f} mrad)"
    name = "simulation: tracking error on the model against the plant's own, the worst joint"
    return [Check(name, float(np.max(apart)), shown, "at most", 0.05, "5 %")]


def _hits(bench: _Bench) -> list[Check]:
    """Apply forces on the tip, one after the other, in the closed loop with feedforward; across the first axis."""
    limits, quality = thresholds(bench.tails, STATED[0]), SensorQuality()
    checks = []
    for number, size in enumerate(HITS):
        rng = np.random.default_rng((bench.seed, 110 + number))
        program, loop = bench.motion(120 + number, 3.0 + BETWEEN * COUNT), bench.loop(quality, 130 + number)
        begins = 2.5 + BETWEEN * np.arange(COUNT) + rng.uniform(0.0, 1.0, COUNT)
        angles = rng.uniform(0.0, 2 * np.pi, COUNT)

        def outside(now: float, q: FloatArray) -> FloatArray:
            acts = np.flatnonzero((now >= begins) & (now < begins + HIT_SECONDS))  # noqa: B023
            if not len(acts):
                return np.zeros_like(q)
            angle = angles[acts[0]]  # noqa: B023
            return loop.tip_efforts(q, size * np.array([np.cos(angle), np.sin(angle), 0.0]))  # noqa: B023

        with tempfile.TemporaryDirectory() as place:
            known = _forces(bench, program, Path(place))
        run = loop.follow(program, loop.gains(), known, outside)
        seen = bench.seen("operation", number, loop.record(run, quality, rng))
        alarms = np.array([own.found for own in overloads(bench.model, seen, limits)])
        delays = np.array([next((a - t for a in alarms if 0 <= a - t <= HIT_SECONDS), np.inf) for t in begins])
        checks.append(_delay(size, delays))
    return checks


def _delay(size: float, delays: FloatArray) -> Check:
    soon, found = int(np.sum(delays <= 0.1)), delays[np.isfinite(delays)]
    shown = f"{soon} of {len(delays)} within 100 ms"
    if len(found):
        shown += f" (found {len(found)}; {1e3 * np.median(found):.0f} ms in the middle, "
        shown += f"at most {1e3 * found.max():.0f} ms)"
    share = soon / len(delays)
    name = f"overload: hits of {size:g} N on the tip at {STATED[0]:g} false alarm an hour"
    return Check(name, share, shown, "at least", 1.0, "all") if size == HITS[-1] else Check(name, share, shown)


def _false_alarms(bench: _Bench, hours: float) -> list[Check]:
    """Count alarms in hours of motion and rest in turn, a minute each of its own motion, pose and noise.

    A minute is one block for the plant (all physics steps in arrays) and one for the model; every stated rate is judged
    by the same scores. 24 h take eleven minutes of processor time.
    """
    minutes, joints = max(1, round(60.0 * hours)), bench.model.joints
    limits = [thresholds(bench.tails, stated) for stated in STATED]
    counts, seconds, units = np.zeros((len(STATED), len(joints)), dtype=int), 0.0, list[FloatArray]()
    for number in range(minutes):
        place = FIRST_MINUTE + number
        seen = bench.resting(place, 60.0) if number % 2 else bench.recording(place, 60.0, "operation")
        seconds += seen.duration
        scores = scores_of(quick(bench.model), seen)
        units += [part.unit[:: round(bench.machine.rate_hz)] for part in scores]
        for own, count in zip(limits, counts, strict=True):
            for alarm in alarms_in(bench.model, scores, own):
                count[alarm.joint] += 1
    checks, days = [], seconds / 86400.0
    for own, stated in zip(counts, STATED, strict=True):
        total = int(own.sum())
        low, high = (
            float(chi2.ppf(share, 2 * total + more)) / 2 / days if total + more else 0.0
            for share, more in ((0.025, 0), (0.975, 2))
        )
        shown = f"{total} in {seconds / 3600.0:.3g} h (95 % interval {low:.2g} to {high:.2g} a day; by joint "
        shown += f"{', '.join(f'{count / days:.2g}' for count in own)} a day)"
        # What chance makes of the stated rate is no miss.
        name = f"overload: false alarms a day at {24 * stated:.3g} stated"
        checks.append(figure(name, low, "{:.3g}", most=24 * stated, shown=shown))
    effort = np.concatenate(units) * limits[1]
    spread = ", ".join(f"{low:.3g} to {high:.3g}" for low, high in np.quantile(effort, [0.01, 0.99], axis=0).T)
    shown = f"{spread} N m from pose to pose (1 to 99 %), by joint"
    return [*checks, Check("overload: thresholds of one false alarm a day", None, shown)]


def _payload(bench: _Bench) -> list[Check]:
    checks = []
    for number, mass in enumerate((0.0, *PAYLOADS)):
        undeclared = (("payload", None, mass),) if mass else ()
        seen = bench.recording(200 + number, 60.0, "operation", undeclared)
        found = payload_signal(bench.model, seen)
        late = (found.t > found.t[-1] - 14.0) & np.isfinite(found.mass)  # picked up at 35 s at the latest
        error = found.mass[late] - mass
        shown = f"{np.mean(error):+.2f} kg, at most {np.max(np.abs(error)):.2f} kg; stated deviation "
        shown += f"{np.mean(found.std[late]):.2f} kg"
        off = float(np.max(np.abs(error) / found.std[late]))
        shown += f", off by {off:.1f} of them at most"
        checks.append(Check(f"payload: error at {mass:g} kg", float(np.max(np.abs(error))), shown))
    return checks


def _energy(bench: _Bench) -> list[Check]:
    found = energy_of_recording(bench.model, bench.recording(300, 60.0, "operation"))
    assert found.measured is not None
    off = np.abs(found.given / found.measured - 1.0)
    total = float(abs(found.given.sum() / found.measured.sum() - 1.0))
    shown = f"{total:.2%} of {found.measured.sum() / 1e3:.2f} kJ (worst joint {np.max(off):.2%}; friction takes "
    shown += f"{found.friction.sum() / found.given.sum():.0%})"
    return [Check("energy: work of a minute against the measured", total, shown, "at most", 0.02, "2 %")]
