"""``hilfit bench measured``: identification and loop on measured machines, and the page that shows it.

The data stays where it is (see ``docs/measured-machines.md`` for whose it is); what is absent is skipped, with a line.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks import pages
from benchmarks.measured import actuator, emps, seals, sets, splits, staubli
from benchmarks.targets import Check, Outcome, Show, figure

__all__ = ["DATA", "MACHINES", "run"]

#: Where the data is looked for: beside the repository.
DATA = Path(__file__).parents[2].parent / "shared" / "data"
MACHINES = ("emps", "staubli_tx40", "kuka_lwr4", "pneumatic_cylinder", "hydraulic_actuator")


def run(data: Path, page: Path | None, only: str | None, show: Show) -> Outcome:
    """Evaluate the measured machines whose data is there."""
    there = [name for name in MACHINES if only in (None, name) and (data / name).is_dir()]
    notes = [f"{name}: no data in {data}, skipped" for name in MACHINES if only in (None, name) and name not in there]
    for note in notes:
        show(note)
    carriage: emps.Emps | None = None
    arm: staubli.Staubli | None = None
    ways: list[splits.Ways] = []
    sealed: list[seals.Seal] = []
    tried: list[splits.Split] = []
    refused: list[str] = []
    simulated: list[Check] = []
    with TemporaryDirectory(prefix="hilfit-measured-") as scratch:
        directory = Path(scratch)
        if "emps" in there:
            show("EMPS: base model, loop")
            carriage = emps.evaluate(data / "emps", directory)
        if "staubli_tx40" in there:
            show("Staubli TX40: base model, loop, five blocks")
            arm = staubli.evaluate(data / "staubli_tx40", directory)
        if "kuka_lwr4" in there:
            show("KUKA LWR: base model, loop")
        for name, shown in (("EMPS", "EMPS"), ("TX40", "TX40, last 30 %"), ("KUKA LWR", "KUKA LWR")):
            if sets.FOLDERS[name] in there:
                session = sets.session(name, data, directory, loop=name == "KUKA LWR")
                assert session is not None
                ways.append(splits.ways(shown, session))
        if only is None:
            show("every split and three bandwidths: base models")
            tried, refused = splits.evaluate(data, directory)
        for seal in seals.SEALS if "pneumatic_cylinder" in there else ():
            show(f"pneumatic cylinder: {seal}")
            sealed.append(seals.evaluate(data / "pneumatic_cylinder", directory, seal))
        if "hydraulic_actuator" in there:
            show("hydraulic actuator: its second half")
            rms = actuator.evaluate(data / "hydraulic_actuator")
            simulated = [figure("Hydraulic actuator: RMS of the second half", rms, "{:.3f}", most=actuator.MOST)]
    checks = [check for machine in (carriage, arm) if machine is not None for check in machine.checks()]
    checks += [*splits.ways_checks(ways), *seals.checks(sealed), *splits.checks(tried), *simulated]
    if page is not None:
        text = pages.filled(
            "measured/page.md.j2", checks=checks, splits=tried, refused=refused, ways=ways,
            emps=carriage, published=emps, staubli=arm, seals=sealed, seals_hz=seals.BANDWIDTH_HZ,
        )  # fmt: skip
        pages.write(page, text, _figures(carriage, arm, sealed))
    return Outcome(tuple(checks), tuple(notes))


def _figures(carriage: emps.Emps | None, arm: staubli.Staubli | None, sealed: list[seals.Seal]) -> dict[str, str]:
    """Draw what was evaluated, by name."""
    found = {}
    if carriage is not None:
        found["emps"] = pages.residuals(*carriage.residuals, "speed [m/s]", "N")
    if arm is not None:
        found["staubli"] = pages.residuals(*arm.residuals, "speed of joint 1 [rad/s]", "N m")
    if sealed:
        found["seals"] = seals.drawn(sealed)
    return found
