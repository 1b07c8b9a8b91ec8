#!/usr/bin/python3
"""The image of zcu102_rpu closes the loop over its CAN controller and vcan0 with `esmc plant`: the same digest as
`esmc hil`, to the last bit. QEMU runs inside with_vcan, with that controller on vcan0.

usage: zcu102_test.py ESMC SCENE ELF SECONDS      of the scene"""
import json
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "boards"))
import board_test  # noqa: E402  (beside the other images)
import stack_bound  # noqa: E402
import vcan  # noqa: E402
import zcu102  # noqa: E402


def limit(seconds):
    """For the plant, in seconds: of a machine that hangs, not of a test that judges speed."""
    return 150 + 60 * float(seconds)


def listeners():
    """Number of open sockets on vcan0."""
    return Path("/proc/net/can/rcvlist_all").read_text(encoding="utf-8").count("vcan0  ")


def heard(board):
    """Whether the image sends a frame on vcan0."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as bus:
        bus.bind(("vcan0",))
        bus.settimeout(1.0)
        give_up = time.monotonic() + limit(0)
        while board.poll() is None and time.monotonic() < give_up:
            try:
                return len(bus.recv(16)) > 0
            except TimeoutError:
                pass
    return False


def inside(esmc, scene, elf, seconds, out):
    """Beside vcan0: the plant's summary and the stack that the image has used, as files in `out`."""
    run = [esmc, "plant", scene, "--bus", "socketcan:vcan0", "--json", "--set", f"simulation.duration={seconds}"]
    with (tempfile.TemporaryDirectory(dir="/dev/shm") as folder,  # a socket lives in this kernel
          Path(out, "plant.json").open("w", encoding="utf-8") as summary):
        monitor = f"{folder}/monitor"
        board = zcu102.qemu(elf, folder, "-object", "can-bus,id=bus", "-object",
                            "can-host-socketcan,id=host,if=vcan0,canbus=bus", "-serial", "none", "-qmp",
                            f"unix:{monitor},server=on,wait=off", machine="xlnx-zcu102,canbus1=bus")
        try:
            if not heard(board):  # it asks for drives
                board.kill()
                print("the image was not heard on vcan0:", board.communicate()[0])
                return 1
            # The image gives up after 5 s without drives, and a loaded machine may take longer to start the plant:
            # no time passes for the image before the plant listens.
            board_test.emulator(monitor, ("stop", {}))
            alone = listeners()
            plant = subprocess.Popen(run, stdout=summary, stderr=subprocess.PIPE, text=True)
            while listeners() == alone and plant.poll() is None:
                time.sleep(0.01)
            board_test.emulator(monitor, ("cont", {}))
            errors = plant.communicate(timeout=limit(seconds))[1]
            stack = board_test.stack_used(elf, monitor, folder)
        finally:
            board.kill()
        if plant.returncode != 0:
            print(errors, board.communicate()[0])
            return 1
    Path(out, "stack.json").write_text(json.dumps(stack), encoding="utf-8")
    return 0


def main(esmc, scene, elf, seconds):
    esmc, scene, elf = (str(Path(a).resolve()) for a in (esmc, scene, elf))

    want, other = (vcan.hil(esmc, scene, "--scalar", s, "--set", f"simulation.duration={seconds}") for s in ("double", "float"))
    assert want["supervisor"]["faults"] == [], want["supervisor"]
    assert want["digest"] != other["digest"], "the digest does not tell float from double: this test could not fail"
    with tempfile.TemporaryDirectory(dir=Path(esmc).parent) as out:
        vcan.inside(sys.executable, __file__, "--inside", esmc, scene, elf, seconds, out,
                    timeout=int(limit(0) + limit(seconds) + 20), VCAN_MEMORY_MB="512")
        got = json.loads(Path(out, "plant.json").read_text(encoding="utf-8"))
        used, reserved = json.loads(Path(out, "stack.json").read_text(encoding="utf-8"))
    vcan.same(got, want, "the image")
    assert got["tracking"] == want["tracking"]
    most = stack_bound.of_image(elf, Path(elf).parent)[0]
    print(f"{got['ticks']} ticks in {got['wall_s']:.1f} s, digest {got['digest']}; "
          f"stack: {used} of {reserved} bytes used, at most {most} by the call graph")
    assert 500 < used <= most <= reserved
    return 0


if __name__ == "__main__":
    sys.exit(inside(*sys.argv[2:]) if sys.argv[1] == "--inside" else main(*sys.argv[1:]))
