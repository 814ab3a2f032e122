"""A machine on a bus of plain CAN and J1939, and the DBC file that describes its messages."""

from __future__ import annotations

from pathlib import Path

from bench_machines import HEAD

DBC = """VERSION ""
NS_ :
BS_:
BU_: Sensors Engine

BO_ 291 Boom: 8 Sensors
 SG_ Angle : 7|16@0- (0.01,0) [-180|180] "deg" Vector__XXX
 SG_ HeadPressure : 16|16@1+ (0.1,0) [0|400] "bar" Vector__XXX
 SG_ RodPressure : 32|16@1+ (10,0) [0|40000] "kPa" Vector__XXX
 SG_ Roll : 48|12@1- (0.05,0) [-90|90] "deg" Vector__XXX

BO_ 292 Slow: 8 Sensors
 SG_ Page M : 0|8@1+ (1,0) [0|3] "" Vector__XXX
 SG_ Supply m0 : 8|16@1+ (0.1,0) [0|400] "bar" Vector__XXX
 SG_ Tank m1 : 8|16@1+ (0.01,0) [0|40] "bar" Vector__XXX

BO_ 2566844158 Temperatures: 8 Engine
 SG_ OilTemperature : 16|16@1+ (0.03125,-273) [-273|1735] "degC" Vector__XXX

BO_ 2566844670 Long: 20 Engine
 SG_ FarAway : 100|16@1+ (1,0) [0|0] "" Vector__XXX

BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "GenMsgCycleTime" BO_ 2566844158 100;
BA_ "VFrameFormat" BO_ 2566844158 3;
BA_ "VFrameFormat" BO_ 2566844670 3;
"""
#: Of the temperatures: priority 6, PGN 0xFEEE (SAE J1939-71: ET1), source address 0xFE for "whoever".
TEMPERATURES = 2566844158 & 0x1FFF_FFFF
CHANNELS = """
channels:
- {name: j1.angle, quantity: joint_position, joint: j1, unit: deg, source: {bus: plain, signal: Angle}}
- {name: j1.head, quantity: head_pressure, joint: j1, unit: bar, source: {bus: plain, signal: HeadPressure}}
- {name: j1.rod, quantity: rod_pressure, joint: j1, unit: bar,
    source: {bus: plain, message: Boom, signal: RodPressure, scale: 0.01}}
- {name: supply, quantity: supply_pressure, unit: bar, source: {bus: plain, signal: Supply}}
- {name: tank, quantity: tank_pressure, unit: bar, source: {bus: plain, signal: Tank}}
- {name: oil, quantity: oil_temperature, unit: degC, source: {bus: plain, pgn: 0xFEEE, signal: OilTemperature}}
buses:
- {name: plain, type: can_signals, interface: virtual, channel: CHANNEL, dbc: [mobile.dbc]}
"""
ANGLE, HEAD_PRESSURE, ROD_PRESSURE, SUPPLY, TANK, OIL = range(6)


def signals(channel: str = "none") -> str:
    """Text of the machine file; the DBC file stands beside it."""
    return HEAD.format(rate=50) + CHANNELS.replace("CHANNEL", channel)


def written(folder: Path, text: str | None = None) -> Path:
    """Machine file and DBC file in a folder."""
    (folder / "mobile.dbc").write_text(DBC)
    path = folder / "mobile.yaml"
    path.write_text(signals() if text is None else text)
    return path
