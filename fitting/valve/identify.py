"""From recordings to a report on each axis' valve (schema ``hilfit/valve/1``) and the models that are handed out."""

from __future__ import annotations

import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import numpy as np

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.messages import Sentence, with_their_messages
from daq.recordings.recording import Recording
from fitting.arrays import FloatArray
from fitting.progress import Progress, quiet
from fitting.regression.freedom import SIGMAS
from fitting.valve.checks import axis_checks, compensated_edge, moves
from fitting.valve.choose import Candidate, Chosen, chosen
from fitting.valve.drift import Kept
from fitting.valve.effects import EFFECTS
from fitting.valve.fit import Fit, peers_of, predicted, profile, relative
from fitting.valve.inverse import ValveModel, direction_of, model_of
from fitting.valve.laws import LAWS
from fitting.valve.model import WAYS
from fitting.valve.pump import PumpLimit, pump_limits_of
from fitting.valve.rows import Axis, axis_of

SCHEMA = "hilfit/valve/1"
#: Share of full speed at whose command an edge is reported: what a controller needs does not hang on the exponent then.
EDGE_SPEED = 0.02
_UNITS = {"delay": "s", "margin": "Pa", "order": "1", "exponent": "1", "power": "1"}
#: Points of the curves of a report.
_POINTS = 61


@dataclass(frozen=True)
class Identified:
    """Valves of a machine.

    Attributes
    ----------
    report : content of ``valve.json`` (schema ``hilfit/valve/1``)
    models : what is handed out, by joint
    """

    report: dict[str, Any]
    models: dict[str, ValveModel]


def identify_valves(
    machine: Machine,
    recordings: Sequence[Recording],
    validate: Sequence[Recording],
    *,
    bandwidth_hz: float | None = None,
    loop: bool = True,
    progress: Progress = quiet,
) -> Identified:
    """Identify command to speed of every axis whose command was recorded.

    Parameters
    ----------
    recordings : what is fitted; several, so that laws are chosen on another motion
    validate : another motion, on which nothing is chosen but that nothing is handed out which is worse there than a
        static curve; may be empty
    loop : whether effects are looked for
    progress : called with the share done and what is being done

    Raises
    ------
    InputError
        If no axis has a command, or none moves, or a recording is to be fitted and judged on.
    """
    joints = [joint for joint in machine.joints if machine.channel("command", joint.name) is not None]
    if not joints:
        raise InputError("fitting.machine_no_channel_quantity", machine=machine.name)
    if not recordings:
        raise InputError("fitting.valve_no_recording")
    digests = {own.sha256 for own in recordings} - {""}
    for own in validate:
        if own.sha256 in digests:
            raise InputError("fitting.fitted_judged_once", file=own.file)
    axes, models, resting = dict[str, Any](), dict[str, ValveModel](), list[str]()
    seen = dict[str, tuple[Axis, Axis | None, Chosen]]()
    for number, joint in enumerate(joints):
        progress(number / len(joints), Sentence("fitting.valve_of", joint=joint.name))
        axis = axis_of(machine, joint, recordings, bandwidth_hz=bandwidth_hz)
        if not moves(axis):
            resting.append(joint.name)
            continue
        judged = None
        if validate:
            judged = axis_of(machine, joint, validate, bandwidth_hz=bandwidth_hz, like=axis)
            judged = judged if moves(judged) else None
        seen[joint.name] = axis, judged, chosen(axis, judged, loop=loop)
    kind = "unknown" if machine.supply is None else machine.supply.kind
    pump = pump_limits_of([picked.fits[-1] for *_, picked in seen.values()], kind) if seen and loop else ()
    for name, what in seen.items():
        axes[name], models[name] = _of_axis(machine, *what, pump)
    if not axes:
        raise InputError("fitting.no_axis_moved_command", file=recordings[0].file, resting=", ".join(resting))
    report = {
        "schema": SCHEMA,
        "machine": machine.name,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": {"hilfit": version("hilfit"), "python": platform.python_version(), "numpy": version("numpy")},
        "data": [
            {"role": role, "file": own.file, "sha256": own.sha256, "samples": len(own)}
            for role, several in (("train", recordings), ("validate", validate))
            for own in several
        ],
        "axes": axes,
        "resting": resting,
        "warnings": [Sentence("fitting.not_move_command_any", name=name) for name in resting],
    }
    return Identified(with_their_messages(report), models)


def _of_axis(
    machine: Machine, axis: Axis, judged: Axis | None, picked: Chosen, pump: Sequence[PumpLimit]
) -> tuple[dict[str, Any], ValveModel]:
    peers, curve = peers_of(axis, judged or axis)
    fit, found, provided = picked.fits[-1], picked.found, "before" if picked.refused else "model"
    errors: dict[str, Any] = {
        "role": "train" if judged is None else "validate",
        "unit": "of the speed's RMS",
        "before": _error(picked.fits[0], judged),
        "after": _error(fit, judged),
        **peers,
        "speed_rms": float(np.sqrt(np.mean((judged or axis).speed[(judged or axis).keep] ** 2))),
    }
    if judged is not None and _error(fit, judged) > errors["static"]:
        fit, provided = curve, "static"
    errors["handed_out"] = _error(fit, judged)
    limits = {own.unit: _barred(own.value, (own.std, SIGMAS * own.std), own.unit) for own in pump}
    limit = limits.get("m^3/s")
    model = model_of(
        fit,
        error=None if judged is None else errors["handed_out"],
        pump_limit=machine.pump_limit if limit is None else limit["value"],
    )
    content = {
        "unit": axis.valve.unit,
        "full": axis.valve.full,
        "bandwidth_hz": axis.bank.bandwidth_hz,
        "rows": {"kept": int(np.count_nonzero(axis.keep)), "all": len(axis.keep)},
        "measured": {"pressures": axis.has_pressures, "supply": axis.has_supply, "oil_temperature": axis.signals.warm},
        "handed_out": provided,
        "delay": {**_value(fit, "delay", "s"), "profile": [list(point) for point in profile(fit)]},
        "directions": {way: _direction(fit, model, number) for number, way in enumerate(WAYS)},
        "stiffness": _stiffness(fit),
        "pump_limit": limit,
        "pump_power": limits.get("W"),
        "errors": errors,
        "laws": picked.laws,
        "effects": [_effect(own, alike, fit) for own, alike in zip(found, picked.sets, strict=False)],
        "unexplained": [] if picked.unknown is None else [_effect(picked.unknown, picked.sets[-1], fit)],
        "verdict": _verdict(picked),
        "candidates": [[_candidate(c) for c in step] for step in picked.steps],
        "checks": axis_checks(machine, axis, picked.fits[-1]),
        "largest_recorded": {way: own.largest for way, own in zip(WAYS, model.directions, strict=True)},
        "model": model.to_json(),
        "fit": Kept.of(fit).to_json(),
        "figures": _figures(fit, model, judged or axis),
    }
    return content, model


def _verdict(picked: Chosen) -> str:
    if picked.unknown is not None:
        return "unexplained"
    return ("ambiguous" if any(picked.sets) else "effect_added") if picked.found else "nothing_missing"


def _error(fit: Fit, judged: Axis | None) -> float:
    return fit.misfit if judged is None else relative(judged, judged.speed - predicted(judged, fit))


def _value(fit: Fit, name: str, unit: str) -> dict[str, Any]:
    return _barred(fit.shape[name] if name in fit.shape else fit.gains[name], fit.bar(name), unit)


def _barred(value: float, bar: tuple[float, float] | None, unit: str) -> dict[str, Any]:
    std, ends = (None, None) if bar is None else (bar[0], [value - bar[1], value + bar[1]])
    return {"value": value, "std": std, "ci95": ends, "unit": unit}


def _direction(fit: Fit, model: ValveModel, way: int) -> dict[str, Any]:
    name, own = WAYS[way], model.directions[way]
    if own.fastest <= 0.0:
        return {"moves": False}
    found = {
        "moves": True,
        "edge": _value(fit, f"edge.{name}", Sentence("fitting.full_command")),
        "edge_at_2_percent": _edge(fit, way),
        "compensated": _compensated(fit, way),
        "curve": fit.structure.curve,
        "law": {"id": own.law, "title": LAWS[own.law].title},
        "reference_drop": {"inlet": own.drop_in, "outlet": own.drop_out, "unit": "Pa"},
        "speed_at_largest": {"value": own.fastest, "unit": "m/s"},
    }
    if fit.structure.curve != "monotone":
        found["gain"] = _value(fit, f"gain.{name}", "m/s per full command" if own.power == 1.0 else "m/s")
    for key in [*own.law_shape, *(["power"] if fit.structure.curve == "power" else [])]:
        found[key] = _value(fit, f"{key}.{name}", _UNITS[key])
    return found


def _compensated(fit: Fit, way: int) -> dict[str, Any] | None:
    """Return the compensated dead band, and by how much it is too small; None without one."""
    signals = fit.axis.signals
    found = compensated_edge((1.0, -1.0)[way] * signals.u, signals.first)
    if found is None:
        return None
    name, unit = f"edge.{WAYS[way]}", Sentence("fitting.full_command")
    return {"value": found, "unit": unit, "too_small_by": _barred(fit.shape[name] - found, fit.bar(name), unit)}


def _edge(fit: Fit, way: int) -> dict[str, Any]:
    """Find the command of 2 % of the largest speed, at the reference drops, with its interval."""

    def at(moved: Fit) -> float:
        own = direction_of(moved, way)
        return own.edge + own.opening(EDGE_SPEED * own.fastest)

    (here,), (std,), (half,) = (own.tolist() for own in _spread(fit, at))
    valve = fit.axis.valve
    return {
        **_barred(here, (std, half) if std else None, Sentence("fitting.full_command")),
        "command": valve.neutral + (1.0, -1.0)[way] * valve.extends * here * valve.full,
        "command_unit": valve.unit,
    }


def _spread(fit: Fit, of: Callable[[Fit], FloatArray | float]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute ``of`` a fit (k,), and its :meth:`Fit.spread`, by slopes over all free parameters."""
    (names, S, _), here = fit.covariance, np.atleast_1d(of(fit))
    slopes = np.zeros((len(here), len(names)))
    for place, name in enumerate(names):
        step = 1e-2 * max(float(np.sqrt(S[place, place])), 1e-300)
        kind = "shape" if name in fit.shape else "gains"
        numbers: dict[str, Any] = {kind: {**getattr(fit, kind), name: getattr(fit, kind)[name] + step}}
        slopes[:, place] = (of(replace(fit, **numbers)) - here) / step
    return here, *fit.spread(slopes)


def _stiffness(fit: Fit) -> dict[str, Any] | None:
    if not fit.structure.stiffness:
        return None
    compliance, hoses = fit.gains["compliance"], fit.gains["hoses"]
    return {
        "bulk_modulus": None if compliance <= 0 else {"value": 1.0 / compliance, "unit": "Pa"},
        "dead_volume": None if compliance <= 0 else {"value": hoses / compliance, "unit": "m^3"},
    }


def _effect(found: Candidate, alike: tuple[str, ...], fit: Fit) -> dict[str, Any]:
    own: dict[str, Any] = {
        "id": found.id,
        "title": found.title,
        "level": "valve",
        "probability": found.probability,
        "error_before": found.before,
        "error_after": found.error,
        "indistinguishable_from": list(alike),
        "parameters": {},
    }
    if found.law is not None:
        return own | found.law.to_json()
    effect = EFFECTS[found.id]
    leaks = {name: "m^3/s/Pa" for name in fit.gains if name.partition(".")[0] == found.id}
    for name, unit in {**{name: effect.units.get(name, "1") for name in effect.shape}, **leaks}.items():
        if name in fit.shape or name in fit.gains:
            own["parameters"][name.rpartition(".")[2]] = _value(fit, name, unit)
    return own | {"equation": effect.equation, "look_at": effect.look_at, "experiment": effect.experiment}


def _candidate(own: Candidate) -> dict[str, Any]:
    return {
        "id": own.id,
        "title": own.title,
        "probability": own.probability,
        "log_odds": own.odds,
        "error_before": own.before,
        "error_after": own.error,
        "holds_elsewhere": not own.reason,
        "reason": own.reason,
    }


def _figures(fit: Fit, model: ValveModel, judged: Axis) -> dict[str, Any]:
    """Return the curve at the reference drops, and measured and predicted speed on the judging motion."""
    u = np.linspace(-model.directions[1].largest, model.directions[0].largest, _POINTS)

    def curve(own: Fit) -> FloatArray:
        ways = direction_of(own, 0), direction_of(own, 1)
        both = ((x, ways[0 if x > 0 else 1]) for x in u)
        return np.array([np.sign(x) * way.speed(abs(x) - way.edge) for x, way in both])

    v, std, _ = _spread(fit, curve)
    period = 1.0 / judged.bank.reduced_rate_hz
    measured = np.where(judged.keep, judged.speed, np.nan)
    return {
        "curve": {"command": u.tolist(), "speed": v.tolist(), "std": std.tolist()},
        "time": (np.arange(len(judged.speed)) * period).tolist(),
        "measured": [None if np.isnan(own) else own for own in measured.tolist()],
        "predicted": predicted(judged, fit).tolist(),
    }
