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
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export import export_model
from fitting.model.export.functions import identifier

COMPILER, MACHINE = "arm-none-eabi-gcc", "qemu-system-arm"
_FLAGS = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-O2", "-std=c11")
_LIMITS = {"instructions": 168_000, "bytes": 64_000}


def cortex(name: str, model: ArmModel) -> list[Check]:
    """Checks of one model; one that says why not where the tools are absent."""
    if shutil.which(COMPILER) is None or shutil.which(MACHINE) is None:
        how = "apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
        return [Check(f"{name}: Cortex-M4F", None, f"{COMPILER} or {MACHINE} is missing ({how})")]
    with tempfile.TemporaryDirectory() as place:
        folder, arm = Path(place), identifier(model.machine.name)
        export_model(model, "c", folder)
        for file in ("cortex_m4.c", "cortex_m4.ld"):
            (folder / file).write_text(files("benchmarks.exports").joinpath(file).read_text(encoding="utf-8"))
        middle = float(np.mean([joint.limits.position for joint in model.machine.joints]))
        n = len(model.joints)
        (folder / "model.h").write_text(
            f'#include "{arm}.h"\n#define JOINTS {n}\n#define MIDDLE {middle!r}f\n'
            f"#define INVERSE_DYNAMICS {arm}_inverse_dynamicsf\n"
        )
        options = [*_FLAGS, "-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections", "-nostartfiles"]
        sources = [f"{arm}.c", "cortex_m4.c", "-T", "cortex_m4.ld", "-lm", "--specs=nosys.specs"]
        subprocess.run([COMPILER, *options, "-o", "arm.elf", *sources], cwd=folder, check=True, capture_output=True)
        command = [
            MACHINE,
            "-M",
            "mps2-an386",
            "-icount",
            "shift=0",
            "-nographic",
            "-semihosting",
            "-kernel",
            "arm.elf",
        ]
        done = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True, timeout=120)
        lines = [line.split() for line in (done.stdout + done.stderr).splitlines() if len(line.split()) == 2]
        told = {key: int(value) for key, value in lines if key in ("instructions", "stack")}
        tau = np.array([struct.unpack("<f", struct.pack("<I", int(v)))[0] for key, v in lines if key == "tau"])
        symbols = subprocess.run(
            ["arm-none-eabi-nm", "arm.elf"], cwd=folder, check=True, capture_output=True, text=True
        )
        heap = [
            word
            for word in ("malloc", "_sbrk")
            if any(line.endswith(f" {word}") for line in symbols.stdout.splitlines())
        ]
        sizes = subprocess.run(
            ["arm-none-eabi-size", "arm.elf"], cwd=folder, check=True, capture_output=True, text=True
        )
        size = sum(map(int, sizes.stdout.splitlines()[1].split()[:2]))
    last = 199 + 7 * np.arange(n)
    q = middle + 0.002 * last[None]
    right = motion.on_motion(motion.at_rest(model), q, 0 * q + 0.1 - 0.199, 0 * q + 0.2, [0.0]).joint_effort(0)[0]
    share = float(np.max(np.abs(tau - right)) / np.max(np.abs(right)))
    shown = f"{told['instructions']} ({told['instructions'] / 168e3:.2f} ms at 168 MHz if each took a cycle)"
    what = f"{name}: Cortex-M4F,"
    return [
        Check(f"{what} floats against the model", share, f"{share:.1e}", "at most", 2e-4, "2e-04"),
        Check(
            f"{what} instructions of a call", told["instructions"], shown, "at most", _LIMITS["instructions"], "1 ms"
        ),
        Check(
            f"{what} code and tables",
            size,
            f"{size} bytes; stack {told['stack']}",
            "at most",
            _LIMITS["bytes"],
            "64 kB",
        ),
        Check(f"{what} functions of a heap", len(heap), ", ".join(heap) or "none", "at most", 0, "none"),
    ]
