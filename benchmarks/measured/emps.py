"""The EMPS benchmark: the published base model, and what the loop finds that it lacks.

Data and reference model: A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", 2019 Workshop on
Nonlinear System Identification Benchmarks. Free to use for research, no licence text: cited, not redistributed.

The reference repeats itself exactly every 6.24 s, so the loop is given the first two periods as `train` and the last
two as `repeat`: its noise floor is measured. The pulses on the force are another experiment: `validate`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import signal
from scipy.io import loadmat

from benchmarks.measured.stacks import Found, Low, Stack, loop, refitted, relative, stack_of
from benchmarks.targets import Check, fact, figure
from daq.machine.machine_file import load_machine
from daq.recordings.recording import read_recording, write_recording
from fitting.arrays import FloatArray
from fitting.loop.session import Options, Session
from fitting.residual.terms import Term

MACHINE = Path(__file__).parent / "machines" / "emps.yaml"
FORCE_PER_VOLT = 35.1507  # N/V, the drive's published gain
PERIOD_ROWS = 6240
#: Of its recordings: two periods to fit, two to measure the noise on, the pulses to predict.
ROLES = ("train", "repeat", "validate")
#: Published base model and relative errors in percent: own motion, and predicted on the pulses.
PUBLISHED = {"M": 95.1089, "Fv": 203.5034, "Fc": 20.3935, "offset": -3.1648}
PUBLISHED_ERRORS = (4.0834, 5.9824)
PUBLISHED_ASYMMETRIC_ERROR = 3.1117
#: The publication decimates by ten; its band is then 40 Hz, and so is the one of the base model here.
DECIMATION = 10
BANDWIDTH_HZ = 40.0


@dataclass(frozen=True)
class Emps:
    """Results on EMPS.

    Attributes
    ----------
    base : M, Fv, Fc, offset by ordinary least squares
    before, after, asymmetric : relative error on the own motion and on the pulses, percent, decimated by ten;
        of the base model, with what the loop added, and with asymmetric friction alone
    raw : the same of the base model on every sample
    found : what the loop found
    residuals : speed, residual before and after, (K,) of the own motion, decimated
    """

    base: dict[str, float]
    before: tuple[float, float]
    after: tuple[float, float]
    asymmetric: tuple[float, float]
    raw: tuple[float, float]
    found: Found
    residuals: tuple[FloatArray, FloatArray, FloatArray]

    def checks(self) -> tuple[Check, ...]:
        """Check what publication and loop have to agree in."""
        apart = max(abs(100 * (self.base[name] / PUBLISHED[name] - 1)) for name in ("M", "Fv", "Fc"))
        names = self.found.names
        return (
            figure("EMPS: largest difference from the published M, Fv, Fc", apart, "{:.2f} %", most=0.3),
            fact(
                "EMPS: asymmetric friction found unaided", "asymmetric_friction" in names, ", ".join(names) or "nothing"
            ),
            figure("EMPS: relative error after the loop, own motion", self.after[0], "{:.2f} %", most=3.2),
            figure("EMPS: relative error after the loop, predicted on the pulses", self.after[1], "{:.2f} %", most=5.4),
        )


def files(data: Path, directory: Path) -> dict[str, Path]:
    """List recordings as the product reads them: ``whole``, ``train``, ``repeat``, ``validate``."""
    machine = load_machine(MACHINE)
    result = {}
    for name, source, rows in (
        ("whole", "DATA_EMPS.mat", slice(None)),
        ("train", "DATA_EMPS.mat", slice(0, 2 * PERIOD_ROWS)),
        ("repeat", "DATA_EMPS.mat", slice(2 * PERIOD_ROWS, None)),
        ("validate", "DATA_EMPS_PULSES.mat", slice(None)),
    ):
        content = loadmat(data / source)
        values = {
            "carriage.position": content["qm"].ravel()[rows],
            "carriage.force": FORCE_PER_VOLT * content["vir"].ravel()[rows],
        }
        role = "train" if name == "whole" else name
        path = directory / f"emps-{name}.parquet"
        result[name] = write_recording(path, machine, role, content["t"].ravel()[rows], values)
    return result


def base_model(data: Path, directory: Path) -> tuple[dict[str, float], tuple[float, float], tuple[float, float]]:
    """Fit base parameters; return errors decimated by ten, and on every sample (own motion, pulses)."""
    session = _whole(files(data, directory))
    stacks = _stacks(session, ())
    theta = stacks[0].fit()
    return _published_names(session, theta), _errors(stacks, theta, _decimated), _errors(stacks, theta, np.asarray)


def evaluate(data: Path, directory: Path) -> Emps:
    """Evaluate the base model, the loop, and errors before and after."""
    paths = files(data, directory)
    found = loop(MACHINE, [(role, paths[role]) for role in ROLES], directory / "emps")
    session = _whole(paths)
    stacks = _stacks(session, ())
    theta = stacks[0].fit()
    more = _stacks(session, found.terms, found)
    theta_more = more[0].fit()
    one_sided = [term for term in found.terms if term.id == "asymmetric_friction"]
    alone = _stacks(session, one_sided, found) if one_sided else stacks
    return Emps(
        base=_published_names(session, theta),
        before=_errors(stacks, theta, _decimated),
        after=_errors(more, theta_more, _decimated),
        asymmetric=_errors(alone, alone[0].fit(), _decimated),
        raw=_errors(stacks, theta, np.asarray),
        found=found,
        residuals=(
            _decimated(session.plain.design.segments[0].v[:, 0]),
            _decimated(stacks[0].target[0] - stacks[0].columns[0] @ theta),
            _decimated(more[0].target[0] - more[0].columns[0] @ theta_more),
        ),
    )


def _whole(paths: dict[str, Path]) -> Session:
    machine = load_machine(MACHINE)
    files = (("whole", "train"), ("validate", "validate"))
    recordings = [read_recording(paths[name], machine, role) for name, role in files]
    return Session(machine, recordings, Options(bandwidth_hz=BANDWIDTH_HZ))


def _stacks(session: Session, terms: Sequence[Term], found: Found | None = None) -> tuple[Stack, Stack]:
    model = refitted(session, terms, found)
    return stack_of(model, 0), stack_of(model, 1)


def _decimated(values: FloatArray) -> FloatArray:
    return np.asarray(signal.decimate(values, DECIMATION, zero_phase=True))


def _errors(stacks: tuple[Stack, Stack], theta: FloatArray, low: Low) -> tuple[float, float]:
    own, cross = (relative(low(s.target[0] - s.columns[0] @ theta), low(s.target[0])) for s in stacks)
    return own, cross


def _published_names(session: Session, theta: FloatArray) -> dict[str, float]:
    values = dict(zip(session.plain.design.parameters.names, theta.tolist(), strict=True))
    own = ("m1", "carriage.f_v", "carriage.f_c", "carriage.f_0")
    return {name: values[key] for name, key in zip(PUBLISHED, own, strict=True)}
