"""QEMU's ZCU102 with an image on its Cortex-R5F. That core is created powered off, whatever boot-cpu says; an A53
releases it, as the first-stage boot loader of a real one does: CPU_ON (PSCI) of CPU 4 at address 0, where the vectors of the image
are."""
import os
import struct
import subprocess
from pathlib import Path

STUB_AT = 0x100000  # where no image is
STUB = (0xD2B88000,  # movz x0, #0xc400, lsl #16
        0xF2800060,  # movk x0, #3
        0xD2800081,  # movz x1, #4
        0xD2800002,  # movz x2, #0
        0xD2800003,  # movz x3, #0
        0xD4000003,  # smc  #0
        0xD503207F,  # wfi
        0x17FFFFFF)  # b    to wfi


def qemu(elf, folder, *more, machine="xlnx-zcu102"):
    """Files that it needs go to `folder`. One thread for all cores, little memory for their code: small machines suffice."""
    stub = Path(folder, "stub.bin")
    stub.write_bytes(struct.pack(f"<{len(STUB)}I", *STUB))
    return subprocess.Popen(
        ["qemu-system-aarch64", "-M", machine, "-smp", "6", "-m", "64M", "-accel", "tcg,thread=single,tb-size=32",
         "-device", f"loader,file={elf},cpu-num=4",
         "-device", f"loader,file={stub},addr={STUB_AT:#x},cpu-num=0,force-raw=on",
         "-display", "none", "-monitor", "none", *more],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=dict(os.environ, QEMU_AUDIO_DRV="none"))
