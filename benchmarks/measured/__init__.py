"""``hilfit bench measured``: identification and loop on measured machines, and the page that shows it.

The data stays where it is (see ``docs/measured-machines.md`` for whose it is); what is absent is skipped and said.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.measured import actuator, emps, seals, sets, splits, staubli
from benchmarks.measured.emps import Emps
from benchmarks.measured.seals import Seal
from benchmarks.measured.splits import MOST_WORSE, Ways, named, ways
from benchmarks.measured.staubli import Staubli
from benchmarks.targets import Check, Outcome, Show, fact, figure, silent

__all__ = ["DATA", "MACHINES", "run"]

#: Where the data is looked for: beside the repository.
DATA = Path(__file__).parents[2].parent / "shared" / "data"
#: Relative error of the KUKA on another motion, percent: of the base model at most, and with what the loop added.
#: Published: 13.2 %.
KUKA_BASE, KUKA_AFTER = 4.4, 4.4
MACHINES = ("emps", "staubli_tx40", "kuka_lwr4", "pneumatic_cylinder", "hydraulic_actuator")


def run(
    data: Path = DATA,
    page: Path | None = None,
    only: str | None = None,
    show: Show = silent,
) -> Outcome:
    """Evaluate the measured machines whose data is there.

    Parameters
    ----------
    data : folder with one folder for each of :data:`MACHINES`
    page : write the page here, and its figures into a folder of the same name beside it
    only : one of :data:`MACHINES`
    show : called with a line when something begins or is skipped
    """
    there = [name for name in MACHINES if only in (None, name) and (data / name).is_dir()]
    notes = [f"{name}: no data in {data}, skipped" for name in MACHINES if only in (None, name) and name not in there]
    for note in notes:
        show(note)
    first: Emps | None = None
    second: Staubli | None = None
    third: list[Seal] = []
    beside: list[Ways] = []
    tried: list[splits.Split] = []
    refused: list[str] = []
    simulated: list[float] = []
    with TemporaryDirectory(prefix="hilfit-measured-") as scratch:
        directory = Path(scratch)
        if "emps" in there:
            show("EMPS: base model, loop")
            first = emps.evaluate(data / "emps", directory)
        if "staubli_tx40" in there:
            show("Staubli TX40: base model, loop, five blocks")
            second = staubli.evaluate(data / "staubli_tx40", directory)
        if "kuka_lwr4" in there:
            show("KUKA LWR: base model, loop")
        for name, shown in (("EMPS", "EMPS"), ("TX40", "TX40, last 30 %"), ("KUKA LWR", "KUKA LWR")):
            if sets.FOLDERS[name] in there:
                session = sets.session(name, data, directory, loop=name == "KUKA LWR")
                assert session is not None
                beside.append(ways(shown, session))
        if only is None:
            show("every split and three bandwidths: base models")
            tried, refused = splits.evaluate(data, directory)
        for seal in seals.SEALS if "pneumatic_cylinder" in there else ():
            show(f"pneumatic cylinder: {seal}")
            third.append(seals.evaluate(data / "pneumatic_cylinder", directory, seal))
        if "hydraulic_actuator" in there:
            show("hydraulic actuator: its second half")
            simulated.append(actuator.evaluate(data / "hydraulic_actuator"))
    checks = (
        *(() if first is None else _emps_checks(first)),
        *(() if second is None else _staubli_checks(second)),
        *(check for own in beside if own.after is not None for check in _kuka_checks(own)),
        *(_beside(own) for own in beside),
        *_seal_checks(third),
        *(splits.checks(tried) if tried else ()),
        *(figure("Hydraulic actuator: RMS of the second half", own, "{:.3f}", most=actuator.MOST) for own in simulated),
    )
    if page is not None:
        _write(page, first, second, third, beside, splits.table(tried, refused) if tried else "", checks)
    return Outcome(checks, tuple(notes))


def _write(
    page: Path,
    first: Emps | None,
    second: Staubli | None,
    third: list[Seal],
    beside: list[Ways],
    tried: str,
    checks: tuple[Check, ...],
) -> None:
    from benchmarks.measured import page as figures
    from benchmarks.measured.page import page as text

    folder = page.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    if first is not None:
        drawn = figures.residuals(first.speed, first.residual_before, first.residual_after, "speed [m/s]", "N")
        (folder / "emps.svg").write_text(drawn, encoding="utf-8")
    if second is not None:
        drawn = figures.residuals(
            second.speed, second.residual_before, second.residual_after, "speed of joint 1 [rad/s]", "N m"
        )
        (folder / "staubli.svg").write_text(drawn, encoding="utf-8")
    if third:
        (folder / "seals.svg").write_text(figures.friction(third), encoding="utf-8")
    page.write_text(text(first, second, third, beside, tried, checks), encoding="utf-8")


def _percent(name: str, value: float, target: float) -> Check:
    return figure(name, value, "{:.2f} %", most=target)


def _emps_checks(result: Emps) -> tuple[Check, ...]:
    apart = max(abs(100 * (result.base[name] / emps.PUBLISHED[name] - 1)) for name in ("M", "Fv", "Fc"))
    return (
        _percent("EMPS: largest difference from the published M, Fv, Fc", apart, 0.3),
        fact(
            "EMPS: asymmetric friction found unaided",
            "asymmetric_friction" in result.found.names,
            ", ".join(result.found.names) or "nothing",
        ),
        _percent("EMPS: relative error after the loop, own motion", result.after[0], 3.2),
        _percent("EMPS: relative error after the loop, predicted on the pulses", result.after[1], 5.4),
    )


def _staubli_checks(result: Staubli) -> tuple[Check, ...]:
    refused = not set(staubli.REFUSED) & set(result.found.names)
    return (
        figure("TX40: parameters told", result.parameters, least=61.0, shown=str(result.parameters)),
        _percent("TX40: relative error of the base model, every row", result.base.every_row, 8.4),
        figure("TX40: five blocks before the loop", result.base.every_row_blocks, "{:.2f} %"),
        _percent("TX40: five blocks after the loop", result.after.every_row_blocks, 8.1),
        fact("TX40: asymmetric and load-dependent friction refused", refused, ", ".join(result.found.names)),
    )


def _kuka_checks(result: Ways) -> tuple[Check, ...]:
    assert result.after is not None
    shown = ", ".join(named(v) for v in result.impossible) or "none"
    return (
        _percent("KUKA: relative error of the base model on another motion", result.base, KUKA_BASE),
        _percent("KUKA: the same with what the loop added", result.after, KUKA_AFTER),
        Check("KUKA: impossible parameters that the report names", None, shown),
    )


def _beside(result: Ways) -> Check:
    """Compare the resulting base with plain least squares on a motion that neither has seen."""
    shown = (
        f"{result.base:.2f} % ({result.chosen}) beside {result.held_out['one_shot']:.2f} %, {100 * result.worse:+.1f} %"
    )
    name = f"{result.machine}: base model against plain least squares, held-out motion"
    return figure(name, 100 * result.worse, "{:g} % worse", most=100 * MOST_WORSE, shown=shown)


def _seal_checks(results: list[Seal]) -> tuple[Check, ...]:
    checks = []
    for seal in results:
        runs = [trial for trial in seal.trials if trial.kept is not None]
        named = sum(trial.named for trial in runs)
        slope = f"{seal.slope:.2f} ± {seal.slope_std:.2f} N/bar"
        name = f"pneumatic cylinder, {seal.name}: runs that name pressure-dependent friction, alone or in a set"
        if runs:
            checks.append(figure(name, float(named), least=1.0, shown=f"{named} of {len(runs)}; {slope}"))
        else:
            checks.append(Check(name, None, f"two pressures only; {slope}"))
    return tuple(checks)
