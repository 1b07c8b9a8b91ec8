#!/usr/bin/python3
"""The bench image of a board (boards/bench.hpp): its frames from a recorded run, and its result from the console.

usage: bench.py frames FRAMES_LOG OUT             the frames of the drives, as initialisers of C++
       bench.py read CONSOLE FRAMES_LOG           CONSOLE: a file, - for standard input
       bench.py flash IMAGE OPENOCD FRAMES_LOG    writes the image with openocd and reads the console: the board's serial port in
                                                  /dev/serial/by-id, or the one that the variable ESMC_PORT names

read and flash print the result. Exit 1: it is incomplete, the run ended in a fault, frames were lost, or the digest of the torques
is not the host's."""
import os
import re
import select
import subprocess
import sys
import termios
import time
import zlib
from pathlib import Path

TICKS = 1000
OF_A_DRIVE = (0x00, 0x01, 0x03, 0x05, 0x09, 0x1C)  # ODrive's messages to the controller: firmware/drive/odrive.hpp
QUIET_S = 60  # a board that prints nothing for so long does not answer


def ticks_of(log):
    """Of each recorded tick ([frame of a drive], [frame of the controller]); a frame is (identifier, bytes)."""
    ticks = [([], [])]
    for number, line in enumerate(Path(log).read_text(encoding="ascii").splitlines(), 1):
        m = re.fullmatch(r"\(\d+\.\d+\) \w+ ([0-9A-F]{3})#((?:[0-9A-F]{2}){0,8})", line)
        if not m:
            raise SystemExit(f"{log}:{number}: not a classic data frame with 11 bits of candump -L: {line}")
        frame = int(m[1], 16), bytes.fromhex(m[2])
        own = frame[0] & 0x1F not in OF_A_DRIVE
        if not own and ticks[-1][1]:  # in lockstep the drives send, and then the controller
            ticks.append(([], []))
        ticks[-1][own].append(frame)
    if len(ticks) < TICKS:
        raise SystemExit(f"{log}: {len(ticks)} ticks, the bench takes {TICKS}")
    return ticks[:TICKS]


def frames(log, out):
    rows = [f"{{{tick}, 0x{ident:03X}, {len(data)}, {{{', '.join(map(str, data))}}}}},\n"
            for tick, (received, _) in enumerate(ticks_of(log)) for ident, data in received]
    text = "".join(rows)
    if not Path(out).exists() or Path(out).read_text(encoding="ascii") != text:
        Path(out).write_text(text, encoding="ascii")
    return 0


def expected(log):
    """What the console must say of the frames, by the host's run."""
    ticks = ticks_of(log)
    sent = [frame for _, own in ticks for frame in own]
    digest = zlib.crc32(b"".join(ident.to_bytes(2, "little") + data for ident, data in sent))
    return f"frames taken {sum(len(received) for received, _ in ticks)}, sent {len(sent)}, returned {len(sent)}", f"digest {digest}"


def judge(lines, log):
    """Prints the lines of a console from the headline to the end; 0 if the result is as it must be."""
    said = []
    for line in (raw.strip() for raw in lines):
        if line.startswith("bench of "):
            said = []
        if line:
            said.append(line)
            print(line, flush=True)
        if line == "done" or line.startswith("start: "):
            break
    wrong = [] if said[-1:] == ["done"] else ["the result is not complete"]
    if "state running, fault none" not in said:
        wrong.append("the run did not end in the state running")
    wrong += [f"the host says: {line}" for line in expected(log) if line not in said]
    print(*wrong or ["the same frames as on the host"], sep="\n")
    return int(bool(wrong))


def serial_port():
    ports = [os.environ["ESMC_PORT"]] if "ESMC_PORT" in os.environ else [str(p) for p in Path("/dev/serial/by-id").glob("*STLINK*")]
    if len(ports) != 1:
        raise SystemExit(f"{len(ports)} ports of an ST-LINK in /dev/serial/by-id: name the board's with ESMC_PORT=/dev/...")
    port = os.open(ports[0], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    raw = termios.tcgetattr(port)
    raw[0] = raw[1] = raw[3] = 0
    raw[2] = termios.CS8 | termios.CREAD | termios.CLOCAL
    raw[4] = raw[5] = termios.B115200
    termios.tcsetattr(port, termios.TCSANOW, raw)
    termios.tcflush(port, termios.TCIFLUSH)
    return port


def lines_of(port):
    text = ""
    end = time.monotonic() + QUIET_S
    while select.select([port], [], [], max(0.0, end - time.monotonic()))[0]:
        text += os.read(port, 4096).decode("ascii", "replace")
        *lines, text = text.split("\n")
        yield from lines


def flash(image, openocd, log):
    port = serial_port()  # opened first: nothing that the board says is missed
    subprocess.run(["openocd", "-f", openocd, "-c", f"program {image} verify reset exit"], check=True)
    return judge(lines_of(port), log)


def read(console, log):
    with sys.stdin if console == "-" else open(console, encoding="ascii", errors="replace") as lines:
        return judge(lines, log)


if __name__ == "__main__":
    commands = {"frames": (frames, 2), "read": (read, 2), "flash": (flash, 3)}
    what, *arguments = sys.argv[1:] or [""]
    if what not in commands or len(arguments) != commands[what][1]:
        sys.exit(__doc__)
    sys.exit(commands[what][0](*arguments))
