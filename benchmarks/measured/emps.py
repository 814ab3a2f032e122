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
from daq.machine.machine_file import Machine, load_machine
from daq.recordings.recording import Recording, read_recording, write_recording
from fitting.arrays import FloatArray
from fitting.loop.session import Options, Session
from fitting.residual.terms import Term

MACHINE = Path(__file__).parent / "machines" / "emps.yaml"
FORCE_PER_VOLT = 35.1507  # N/V, the drive's published gain
PERIOD_ROWS = 6240
#: Of its recordings: two periods to fit, two to hear the noise on, the pulses to predict.
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
    found : what the loop said
    speed, residual_before, residual_after : (K,) of the own motion, decimated
    parameters : names, units and values of the model with what was added
    """

    base: dict[str, float]
    before: tuple[float, float]
    after: tuple[float, float]
    asymmetric: tuple[float, float]
    raw: tuple[float, float]
    found: Found
    speed: FloatArray
    residual_before: FloatArray
    residual_after: FloatArray
    parameters: tuple[tuple[str, float], ...]


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
    return _published_names(session, theta), _errors(stacks, theta, _decimated), _errors(stacks, theta, _every)


def evaluate(data: Path, directory: Path) -> Emps:
    """Evaluate the base model, the loop, and errors before and after."""
    paths = files(data, directory)
    found = loop(MACHINE, [(role, paths[role]) for role in ROLES], directory / "emps")
    session = _whole(paths)
    stacks = _stacks(session, ())
    theta = stacks[0].fit()
    more = _stacks(session, found.terms, found)
    theta_more = more[0].fit()
    names = _names(session, found)
    one_sided = [term for term in found.terms if term.id == "asymmetric_friction"]
    alone = _stacks(session, one_sided, found) if one_sided else stacks
    return Emps(
        base=_published_names(session, theta),
        before=_errors(stacks, theta, _decimated),
        after=_errors(more, theta_more, _decimated),
        asymmetric=_errors(alone, alone[0].fit(), _decimated),
        raw=_errors(stacks, theta, _every),
        found=found,
        speed=_decimated(session.plain.design.segments[0].v[:, 0]),
        residual_before=_decimated(stacks[0].target[0] - stacks[0].columns[0] @ theta),
        residual_after=_decimated(more[0].target[0] - more[0].columns[0] @ theta_more),
        parameters=tuple(zip(names, theta_more.tolist(), strict=True)),
    )


def _whole(paths: dict[str, Path]) -> Session:
    machine: Machine = load_machine(MACHINE)
    recordings: list[Recording] = [
        read_recording(paths["whole"], machine, "train"),
        read_recording(paths["validate"], machine, "validate"),
    ]
    return Session(machine, recordings, Options(bandwidth_hz=BANDWIDTH_HZ))


def _stacks(session: Session, terms: Sequence[Term], found: Found | None = None) -> tuple[Stack, Stack]:
    model = refitted(session, terms, found)
    return stack_of(model, 0), stack_of(model, 1)


def _decimated(values: FloatArray) -> FloatArray:
    return np.asarray(signal.decimate(values, DECIMATION, zero_phase=True))


def _every(values: FloatArray) -> FloatArray:
    return values


def _errors(stacks: tuple[Stack, Stack], theta: FloatArray, low: Low) -> tuple[float, float]:
    own, cross = (relative(low(s.target[0] - s.columns[0] @ theta), low(s.target[0])) for s in stacks)
    return own, cross


def _published_names(session: Session, theta: FloatArray) -> dict[str, float]:
    values = dict(zip(session.plain.design.parameters.names, theta.tolist(), strict=True))
    return {
        "M": values["m1"],
        "Fv": values["carriage.f_v"],
        "Fc": values["carriage.f_c"],
        "offset": values["carriage.f_0"],
    }


def _names(session: Session, found: Found) -> tuple[str, ...]:
    joints = session.plain.design.parameters.joints
    return (*session.plain.design.parameters.names, *(n for term in found.terms for n in term.names(joints)))
