"""Undeclared effects of valves, oil and supply: each a change of the truth, in every physical form that it may have.

An effect's name is what it shows itself as; its forms are the defects that do so. Sizes are in the unit of the form; 0
is the healthy plant (1 where the size is a ratio).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.messages import Sentence
from sim_backends.valve.truth import Land, Spool, ValvePlantTruth, ValveTruth

#: What a form does to a truth, at a joint, with a size.
Change = Callable[[ValvePlantTruth, str, float], ValvePlantTruth]


@dataclass(frozen=True)
class ValveEffect:
    """One form of an effect.

    Attributes
    ----------
    id, form : name of the effect, and which defect shows itself so
    unit, meaning : of the size
    large : sizes from noticeable to as bad as machines are still run with
    change : the truth with it
    whole : belongs to the machine, not to a joint
    compensated : needs a pressure-compensated valve
    held : needs a counterbalance valve (False: must have none)
    earlier : can be seen only against an earlier calibration
    """

    id: str
    form: str
    unit: str
    meaning: str
    large: tuple[float, float]
    change: Change
    whole: bool = False
    compensated: bool | None = None
    held: bool | None = None
    earlier: bool = False


@dataclass(frozen=True)
class ValveEffectSpec:
    """An effect with its form, its place (None: the whole machine) and its size."""

    id: str
    form: str
    joint: str | None
    size: float


def _spool(**fields: Callable[[Spool, float], float]) -> Change:
    def change(truth: ValvePlantTruth, joint: str, size: float) -> ValvePlantTruth:
        valve = truth.valves[joint]
        spool = replace(valve.spool, **{key: value(valve.spool, size) for key, value in fields.items()})
        return _with_valve(truth, joint, replace(valve, spool=spool))

    return change


def _slowed(spool: Spool, lag: float) -> float:
    """Compute the frequency over the healthy one at which the lag ``2 damping / w`` is ``lag`` s more."""
    return 1.0 / (1.0 + lag * math.pi * spool.frequency / spool.damping)


def _valve(make: Callable[[ValveTruth, float], ValveTruth]) -> Change:
    return lambda truth, joint, size: _with_valve(truth, joint, make(truth.valves[joint], size))


def _lands(make: Callable[[str, Land, float], Land]) -> Change:
    return _valve(lambda v, size: replace(v, lands={name: make(name, land, size) for name, land in v.lands.items()}))


def _with_valve(truth: ValvePlantTruth, joint: str, valve: ValveTruth) -> ValvePlantTruth:
    return replace(truth, valves={**truth.valves, joint: valve})


def _full(truth: ValvePlantTruth, joint: str) -> float:
    """Return the largest flow in m^3/s that lets oil in at full stroke."""
    return max(truth.valves[joint].lands[name].flow for name in ("head_in", "rod_in"))


def _leaking(key: str, turbulent: bool = False) -> Change:
    """Leak ``size`` of the full flow at 100 bar."""
    drop = math.sqrt(1.0e7) if turbulent else 1.0e7

    def change(truth: ValvePlantTruth, joint: str, size: float) -> ValvePlantTruth:
        leak: dict[str, Any] = {key: size * _full(truth, joint) / drop}
        own = replace(truth.cylinders[joint], **leak)
        return replace(truth, cylinders={**truth.cylinders, joint: own})

    return change


def _throttled(truth: ValvePlantTruth, joint: str, size: float) -> ValvePlantTruth:
    flow = _full(truth, joint) / math.sqrt(size)  # at the nominal drop, when full flow costs ``size`` nominal drops
    own = replace(truth.cylinders[joint], line_in=flow, line_out=flow)
    return replace(truth, cylinders={**truth.cylinders, joint: own})


def _unheld(truth: ValvePlantTruth, joint: str, size: float) -> ValvePlantTruth:
    own = replace(truth.cylinders[joint], counterbalance=None)
    return _wide(replace(truth, cylinders={**truth.cylinders, joint: own}), joint, size)


_wide = _lands(lambda name, land, size: replace(land, flow=land.flow * (size if name.endswith("_out") else 1.0)))


def _limited(truth: ValvePlantTruth, joint: str, size: float) -> ValvePlantTruth:
    demand = sum(_full(truth, name) for name in truth.valves)
    return replace(truth, supply=replace(truth.supply, flow_limit=size * demand))


def _weak(truth: ValvePlantTruth, joint: str, size: float) -> ValvePlantTruth:
    demand = sum(_full(truth, name) for name in truth.valves)
    return replace(truth, supply=replace(truth.supply, power_limit=size * demand * truth.supply.pressure))


_PERCENT = "fraction of full stroke"
_FORMS = (
    ValveEffect("spool_hysteresis", "play", _PERCENT, "half-width of a play between solenoid and spool",
                (0.015, 0.04), _spool(play=lambda _, s: s)),
    ValveEffect("spool_hysteresis", "magnetic", _PERCENT, "half-width of the solenoid's loop at full current",
                (0.025, 0.05), _spool(magnetic=lambda _, s: s)),
    ValveEffect("delay_per_direction", "dead_time", "s", "how much later the rod goes in than out",
                (0.06, 0.15), _spool(delay_retract=lambda own, s: own.delay_retract + s)),
    ValveEffect("delay_per_direction", "pilot", "s", "lag of the spool on the side that lets the rod in",
                (0.06, 0.15), _spool(retracting=lambda own, s: _slowed(own, s))),
    ValveEffect("warm_up", "viscosity", "fraction of the flow", "flow that cold oil lacks",
                (0.15, 0.35), _valve(lambda own, s: replace(own, cold_flow=s))),
    ValveEffect("warm_up", "coil", "fraction of the stroke", "stroke that a warm coil has lost",
                (0.15, 0.25), _spool(current_loss=lambda _, s: s)),
    ValveEffect("overrunning_load", "wide_outlet", "ratio", "meter-out lands over what holds the load back",
                (3.0, 6.0), _wide, held=False),
    ValveEffect("overrunning_load", "no_counterbalance", "ratio", "no load-holding valve, and meter-out lands so wide",
                (2.5, 4.0), _unheld, held=True),
    ValveEffect("undeclared_orifice", "no_compensator", "Pa", "drop at which the lands give their flow",
                (3.0e6, 6.0e6), _valve(lambda own, s: replace(own, compensation=math.inf, nominal_drop=s)),
                compensated=True),
    ValveEffect("undeclared_orifice", "soft_compensator", "1", "twice the exponent of the drop that is left",
                (0.4, 0.8), _valve(lambda own, s: replace(own, softness=s)), compensated=True),
    ValveEffect("undeclared_orifice", "line_throttle", "ratio", "drop of full flow in the line over the compensator's",
                (6.0, 15.0), _throttled, compensated=True),
    ValveEffect("piston_leak", "seal", "fraction of full flow", "laminar leak past the piston at 100 bar",
                (0.05, 0.12), _leaking("piston_leak")),
    ValveEffect("piston_leak", "scored_bore", "fraction of full flow", "turbulent leak past the piston at 100 bar",
                (0.04, 0.10), _leaking("piston_gap", turbulent=True)),
    ValveEffect("port_leak", "head_port", "fraction of full flow", "leak from the head port to tank at 100 bar",
                (0.05, 0.12), _leaking("head_leak")),
    ValveEffect("port_leak", "rod_port", "fraction of full flow", "leak from the rod port to tank at 100 bar",
                (0.05, 0.12), _leaking("rod_leak")),
    ValveEffect("pump_flow_limit", "flow", "fraction of all full flows", "what the pump gives at most",
                (0.3, 0.5), _limited, whole=True),
    ValveEffect("pump_flow_limit", "power", "fraction of all full flows at full pressure", "the motor's power",
                (0.15, 0.3), _weak, whole=True),
    ValveEffect("spool_stick", "dry", _PERCENT, "change of the command that a resting spool ignores",
                (0.02, 0.04), _spool(stick=lambda _, s: s)),
    ValveEffect("spool_stick", "silt", _PERCENT, "the same, after three seconds of rest",
                (0.04, 0.08), _spool(stick=lambda _, s: s, silt_time=lambda *_: 1.0)),
    ValveEffect("edge_wear", "shifted", _PERCENT, "how much earlier all edges open",
                (0.015, 0.035), _lands(lambda _, land, s: replace(land, edge=land.edge - s)), earlier=True),
    ValveEffect("edge_wear", "rounded", _PERCENT, "stroke over which an edge lets oil through before it opens",
                (0.02, 0.04), _lands(lambda _, land, s: replace(land, rounding=s)), earlier=True),
    ValveEffect("null_shift", "spring", _PERCENT, "stroke at command 0",
                (0.01, 0.03), _spool(null=lambda _, s: s), earlier=True),
    ValveEffect("slower_spool", "pilot", "ratio", "natural frequency over that of a healthy spool",
                (0.2, 0.5), _spool(frequency=lambda own, s: own.frequency * s), earlier=True),
    ValveEffect("air_in_oil", "foam", "ratio", "bulk modulus over that of clean oil", (0.15, 0.4),
                lambda truth, _, s: replace(truth, oil=replace(truth.oil, bulk_modulus=truth.oil.bulk_modulus * s)),
                whole=True, earlier=True),
)  # fmt: skip

#: Every form of every effect, by ``(id, form)``.
VALVE_EFFECTS: dict[tuple[str, str], ValveEffect] = {(form.id, form.form): form for form in _FORMS}


def valve_obstacle(effect: ValveEffect, machine: Machine, truth: ValvePlantTruth, joint: str | None) -> Sentence | None:
    """Explain why the effect cannot be there; None if it can."""
    which = {"effect": effect.id, "form": effect.form, "machine": machine.name}
    if effect.whole:
        return Sentence("sim_backends.valve_effect_of_whole_machine", **which) if joint is not None else None
    if joint is None or joint not in truth.valves:
        return Sentence("sim_backends.valve_effect_no_joint", **which, joint=joint, names=list(truth.valves))
    compensated = math.isfinite(truth.valves[joint].compensation)
    if effect.compensated is not None and effect.compensated != compensated:
        return Sentence("sim_backends.valve_effect_not_compensated", **which, joint=joint)
    held = truth.cylinders[joint].counterbalance is not None
    if effect.held is not None and effect.held != held:
        code = "sim_backends.valve_effect_not_held" if effect.held else "sim_backends.valve_effect_held"
        return Sentence(code, **which, joint=joint)
    return None


def parse_valve_spec(text: str) -> ValveEffectSpec:
    """Read ``EFFECT:FORM:JOINT:SIZE``, without the joint for an effect of the whole machine (InputError)."""
    effect, *more = text.split(":")
    try:
        form, *place, size = more
        (joint,) = place or (None,)
        return ValveEffectSpec(effect, form, joint or None, float(size))
    except ValueError:
        raise InputError("sim_backends.valve_undeclared_no_quadruple", text=text) from None


def with_effect(machine: Machine, truth: ValvePlantTruth, spec: ValveEffectSpec) -> ValvePlantTruth:
    """Apply an undeclared effect to the truth.

    Raises
    ------
    InputError
        Unknown effect or form, a place that cannot have it, or a size that is no finite number.
    """
    effect = VALVE_EFFECTS.get((spec.id, spec.form))
    if effect is None:
        forms = [form for known, form in VALVE_EFFECTS if known == spec.id]
        if forms:
            raise InputError("sim_backends.valve_form_unknown", effect=spec.id, form=spec.form, names=forms)
        names = list(dict(VALVE_EFFECTS.keys()))
        raise InputError("sim_backends.valve_effect_unknown", effect=spec.id, form=spec.form, names=names)
    if not math.isfinite(spec.size):
        raise InputError("sim_backends.valve_size_not_finite", effect=spec.id, unit=effect.unit)
    found = valve_obstacle(effect, machine, truth, spec.joint)
    if found is not None:
        raise InputError(found)
    return effect.change(truth, spec.joint or "", spec.size)
