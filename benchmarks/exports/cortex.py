"""The exported C on a Cortex-M4F under QEMU: instructions of a call, stack, heap, size.

QEMU counts instructions (one nanosecond of its time for each), not cycles: on the silicon a load, a division or a
branch takes more than one. At 168 MHz a millisecond is 168,000 cycles.
"""

from __future__ import annotations

import shutil
import struct
import subprocess
import tempfile
from importlib.resources import files
from pathlib import Path

import numpy as np

from benchmarks.targets import Check
from fitting.arrays import FloatArray
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export import export_model
from fitting.model.export.functions import identifier

COMPILER, MACHINE = "arm-none-eabi-gcc", "qemu-system-arm"
_FLAGS = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-O2", "-std=c11")
_LIMITS = {"instructions": 168_000, "bytes": 64_000}


def cortex(name: str, model: ArmModel) -> list[Check]:
    """Check one model; return a check with the reason where the tools are absent."""
    if shutil.which(COMPILER) is None or shutil.which(MACHINE) is None:
        how = "apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
        return [Check(f"{name}: Cortex-M4F", None, f"{COMPILER} or {MACHINE} is missing ({how})")]
    middle = float(np.mean([joint.limits.position for joint in model.machine.joints]))
    with tempfile.TemporaryDirectory() as place:
        instructions, stack, tau, heap, size = _run(model, Path(place), middle)
    q = middle + 0.002 * (199 + 7 * np.arange(len(model.joints)))[None]  # the last of the program's calls
    right = motion.on_motion(motion.at_rest(model), q, 0 * q + 0.1 - 0.199, 0 * q + 0.2, [0.0]).joint_effort(0)[0]
    share = float(np.max(np.abs(tau - right)) / np.max(np.abs(right)))
    shown = f"{instructions} ({instructions / 168e3:.2f} ms at 168 MHz if each took a cycle)"
    what, most = f"{name}: Cortex-M4F,", _LIMITS
    return [
        Check(f"{what} floats against the model", share, f"{share:.1e}", "at most", 2e-4, "2e-04"),
        Check(f"{what} instructions of a call", instructions, shown, "at most", most["instructions"], "1 ms"),
        Check(f"{what} code, tables", size, f"{size} bytes; stack {stack}", "at most", most["bytes"], "64 kB"),
        Check(f"{what} functions of a heap", len(heap), ", ".join(heap) or "none", "at most", 0, "none"),
    ]


def _run(model: ArmModel, folder: Path, middle: float) -> tuple[int, int, FloatArray, list[str], int]:
    """Return instructions of a call, bytes of stack, efforts (n,) of the last call, heap, bytes in all."""
    arm, n = identifier(model.machine.name), len(model.joints)
    export_model(model, "c", folder)
    for file in ("cortex_m4.c", "cortex_m4.ld"):
        (folder / file).write_text(files("benchmarks.exports").joinpath(file).read_text(encoding="utf-8"))
    (folder / "model.h").write_text(
        f'#include "{arm}.h"\n#define JOINTS {n}\n#define MIDDLE {middle!r}f\n'
        f"#define INVERSE_DYNAMICS {arm}_inverse_dynamicsf\n"
    )

    def output_of(*command: str) -> list[str]:
        done = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True, timeout=120)
        return (done.stdout + done.stderr).splitlines()

    options = [*_FLAGS, "-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections", "-nostartfiles"]
    sources, libraries = (f"{arm}.c", "cortex_m4.c"), ("-T", "cortex_m4.ld", "-lm", "--specs=nosys.specs")
    output_of(COMPILER, *options, "-o", "arm.elf", *sources, *libraries)
    lines = output_of(
        MACHINE, "-M", "mps2-an386", "-icount", "shift=0", "-nographic", "-semihosting", "-kernel", "arm.elf"
    )
    words = [line.split() for line in lines if len(line.split()) == 2]
    numbers = {key: int(value) for key, value in words if key in ("instructions", "stack")}
    tau = [struct.unpack("<f", struct.pack("<I", int(value)))[0] for key, value in words if key == "tau"]
    symbols = output_of("arm-none-eabi-nm", "arm.elf")
    heap = [word for word in ("malloc", "_sbrk") if any(line.endswith(f" {word}") for line in symbols)]
    size = sum(map(int, output_of("arm-none-eabi-size", "arm.elf")[1].split()[:2]))
    return numbers["instructions"], numbers["stack"], np.array(tau), heap, size
