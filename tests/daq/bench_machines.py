"""Machine files of small test benches, as text."""

from __future__ import annotations

HEAD = """
schema: hilfit/machine/1
name: bench
rate_hz: {rate}
gravity: [0.0, -9.81, 0.0]
joints:
- name: j1
  dh: {{a: 1.0, alpha: 0.0, d: 0.0, theta: 0.0}}
  limits: {{position: [-1.0, 1.0], velocity: 1.0, acceleration: 1.0}}
  cylinder: {{bore: 0.08, rod: 0.04, stroke: 0.3, linkage: {{type: rack, radius: 0.1, zero: -1.2}}}}
"""
PLAIN = """
channels:
- {name: j1.angle, quantity: joint_position, joint: j1, unit: deg}
- {name: j1.piston, quantity: piston_position, joint: j1, unit: mm}
- {name: j1.head, quantity: head_pressure, joint: j1, unit: bar, range: [-1, 250]}
- {name: j1.rod, quantity: rod_pressure, joint: j1, unit: bar}
- {name: oil, quantity: oil_temperature, unit: degC}
"""
CAN = """
channels:
- {{name: j1.angle, quantity: joint_position, joint: j1, unit: rad,
    source: {{bus: can0, node: 5, object: 0x6004, data_type: uint32, scale: 1.0e-6}}}}
- {{name: j1.head, quantity: head_pressure, joint: j1, unit: bar,
    source: {{bus: can0, node: 6, object: 0x6130, subindex: 1, data_type: float32}}}}
- {{name: j1.rod, quantity: rod_pressure, joint: j1, unit: bar,
    source: {{bus: can0, node: 6, object: 0x6130, subindex: 2, data_type: float32}}}}
buses:
- name: can0
  type: canopen
  interface: {interface}
  channel: {channel}
  listen_s: 0
  nodes:
  - {{node: 5, device_type: 0x00080194, vendor_id: 0x2A, product_code: 7, boot_up_s: 0.2, heartbeat_ms: 400}}
  - {{node: 6, heartbeat_ms: 300, boot_up_s: 0.2, settings: {{"0x61A1:1 uint16": 3}}}}
"""
MODBUS = """
channels:
- {{name: j1.angle, quantity: joint_position, joint: j1, unit: rad,
    source: {{bus: mb, unit: 1, register: 6, data_type: float32}}}}
- {{name: j1.head, quantity: head_pressure, joint: j1, unit: bar,
    source: {{bus: mb, unit: 1, register: 2, data_type: float32, sentinels: [-999.0]}}}}
- {{name: j1.rod, quantity: rod_pressure, joint: j1, unit: bar,
    source: {{bus: mb, unit: 2, register: 4, data_type: int16, scale: 0.1, offset: -1.0}}}}
buses:
- {bus}
"""


def plain(rate: float = 50) -> str:
    """For recordings only: five channels in units that are not SI, no buses."""
    return HEAD.format(rate=rate) + PLAIN


def can(channel: str, rate: float = 50, interface: str = "virtual") -> str:
    """Encoder node 5 and pressure node 6 on a bus; no busy computer makes their heartbeats late by as much."""
    return HEAD.format(rate=rate) + CAN.format(channel=channel, interface=interface)


def listening(rod: str) -> str:
    """The same bus, only listened to: TPDOs 0x185 and 0x186; ``rod`` says which one the rod's pressure is in, where."""
    text = can("none").replace("listen_s: 0", "listen_only: true")
    text = text.replace("object: 0x6004,", "object: 0x6004, cob_id: 0x185,")
    return text.replace("subindex: 1,", "subindex: 1, cob_id: 0x186,").replace("subindex: 2,", f"subindex: 2, {rod},")


def socketcand(port: int, rate: float = 50) -> str:
    """The same nodes behind a server on this computer."""
    text = can("can0", rate)
    return text.replace(
        "interface: virtual\n", f"interface: socketcand\n  options: {{host: 127.0.0.1, port: {port}}}\n"
    )


def modbus(port: int, rate: float = 50, timeout_s: float = 5.0) -> str:
    """Units 1 and 2 behind one TCP port; the time-out is long enough that a busy computer is no dead device."""
    return HEAD.format(rate=rate) + MODBUS.format(
        bus=f"{{name: mb, type: modbus_tcp, host: 127.0.0.1, port: {port}, timeout_s: {timeout_s}}}"
    )


def modbus_serial(port: str, timeout_s: float = 0.25) -> str:
    """Units 1 and 2 on a serial line."""
    return HEAD.format(rate=20) + MODBUS.format(
        bus=f"{{name: mb, type: modbus_rtu, port: {port}, parity: N, timeout_s: {timeout_s}}}"
    )
