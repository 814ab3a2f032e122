"""Signals that DBC files offer: numbers as the file's text has them, who uses which, and sources that lead back."""

from __future__ import annotations

from pathlib import Path

import pytest
from signals_test_bench import DBC, TEMPERATURES, signals, written

from daq import load_machine
from daq.errors import MachineFileError
from daq.machine.buses import CanSignalsBus, SignalSource
from daq.machine.can_database import listed_messages
from server.can_signals.can_signals_schemas import CanSignal
from server.can_signals.signal_child import OfferedBus, offered_signals

pytest.importorskip("cantools")


def listing(folder: Path, text: str | None = None) -> OfferedBus:
    (bus,) = offered_signals(load_machine(written(folder, text)))
    return bus


def by_name(bus: OfferedBus) -> dict[str, CanSignal]:
    return {signal.signal: signal for signal in bus.signals}


def test_numbers_are_those_of_the_file(tmp_path: Path) -> None:
    found = by_name(listing(tmp_path))
    assert sorted(found) == sorted(line.split()[1] for line in DBC.splitlines() if line.startswith(" SG_"))
    angle, roll, oil = found["Angle"], found["Roll"], found["OilTemperature"]
    assert (angle.message, angle.frame_id, angle.extended, angle.pgn) == ("Boom", 0x123, False, None)
    assert (angle.start_bit, angle.bits, angle.byte_order, angle.signed) == (7, 16, "big", True)
    assert (angle.factor, angle.offset, angle.unit, angle.minimum, angle.maximum) == (0.01, 0.0, "deg", -180.0, 180.0)
    assert (roll.start_bit, roll.bits, roll.byte_order) == (48, 12, "little")
    assert (oil.frame_id, oil.extended, oil.pgn, oil.cycle_ms) == (TEMPERATURES, True, 0xFEEE, 100)
    assert (oil.factor, oil.offset, oil.signed) == (0.03125, -273.0, False)


def test_multiplexers_and_what_they_select(tmp_path: Path) -> None:
    found = by_name(listing(tmp_path))
    assert found["Page"].selects and found["Page"].multiplexer is None
    assert [(found[name].multiplexer, found[name].multiplexer_values) for name in ("Supply", "Tank")] == [
        ("Page", [0]),
        ("Page", [1]),
    ]


def test_each_signal_names_the_channels_that_use_it(tmp_path: Path) -> None:
    bus = listing(tmp_path)
    assert {signal.signal: signal.channels for signal in bus.signals if signal.channels} == {
        "Angle": ["j1.angle"], "HeadPressure": ["j1.head"], "RodPressure": ["j1.rod"], "Supply": ["supply"],
        "Tank": ["tank"], "OilTemperature": ["oil"],
    }  # fmt: skip
    assert bus.problems == [] and (bus.files[0].messages, bus.files[0].signals) == (4, 9)


def test_sources_lead_back_to_their_signal(tmp_path: Path) -> None:
    machine = load_machine(written(tmp_path))
    (bus,) = machine.buses
    assert isinstance(bus, CanSignalsBus)
    checked = 0
    for offered in listing(tmp_path).signals:
        if offered.source is None:
            assert offered.signal == "FarAway" and "20 bytes" in str(offered.refusal)
            continue
        source = SignalSource.model_validate(offered.source)
        channel = machine.channels[0].model_copy(update={"source": source})
        (listed,), problems = listed_messages(bus, [channel])
        assert problems == [] and listed.j1939 == (offered.pgn is not None)
        assert (listed.message.name, listed.wanted[0].signal.name) == (offered.message, offered.signal)
        checked += 1
    assert checked == 8


def test_an_unknown_signal_or_an_absent_file_is_a_problem_and_the_others_are_listed(tmp_path: Path) -> None:
    bus = listing(tmp_path, signals().replace("signal: Tank", "signal: Tonk"))
    (line,) = bus.problems
    assert line.startswith("tank: there is no signal 'Tonk'") and len(bus.signals) == 9
    two = listing(tmp_path, signals().replace("[mobile.dbc]", "[mobile.dbc, gone.dbc]"))
    assert [file.error is None for file in two.files] == [True, False]
    assert "gone.dbc: no such file" in two.problems[0] and len(two.signals) == 9


def test_signals_that_no_source_can_tell_apart(tmp_path: Path) -> None:
    path = written(tmp_path, signals().replace("[mobile.dbc]", "[mobile.dbc, copy.dbc]"))
    (tmp_path / "copy.dbc").write_text(DBC)
    machine = load_machine(path)
    (bus,) = offered_signals(machine)
    assert len(bus.signals) == 18 and all(signal.source is None for signal in bus.signals)
    assert any("more than once" in str(signal.refusal) for signal in bus.signals)
    assert isinstance(machine.buses[0], CanSignalsBus)
    try:
        _, problems = listed_messages(machine.buses[0], machine.channels)
    except MachineFileError:
        pytest.fail("both files can be read")
    assert len(problems) == len(machine.channels)


def test_signals_that_channels_use_are_listed_first(tmp_path: Path) -> None:
    used = [bool(signal.channels) for signal in listing(tmp_path).signals]
    assert used == sorted(used, reverse=True)
