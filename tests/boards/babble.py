#!/usr/bin/python3
"""A node that babbles, between an emulated board and `esmc plant`: some foreign frames are none of the board's business, more
than a tick may read end in zero torque at once and drives that are asked to idle.

usage: babble.py ELF MACHINE ESMC SCENE"""
import selectors
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from board_test import ICOUNT_LOOP, qemu

TORQUE, STATE, IDLE = 0x0E, 0x07, "01000000"  # of ODrive CANSimple: message of an identifier, request of an axis state
NOISE, FLOOD = 300, 1200                      # frames in one tick; the cycle reads 1024


class Middle:
    """Carries bytes both ways and reads what the board says, line by line."""

    def __init__(self, plant, board):
        self.plant, self.board, self.line = plant, board, b""
        self.torques, self.idle = [], set()  # in the order of the frames: (node, whether there is torque)
        self.select = selectors.DefaultSelector()
        for s in (plant, board):
            self.select.register(s, selectors.EVENT_READ)

    def hear(self, line):
        if not line.startswith("t"):
            return
        identifier, data = int(line[1:4], 16), line[5:]
        node, message = identifier >> 5, identifier & 0x1F
        if message == TORQUE:
            self.torques.append((node, int(data[:8], 16) & ~0x80 != 0))  # little endian: the sign is the top bit of byte 3
        elif message == STATE and data.startswith(IDLE):
            self.idle.add(node)

    def carry(self, until, insert=b""):
        """Until it is so, or a side closes, or nothing comes. `insert`: bytes for the board before the plant's next ones."""
        give_up = time.monotonic() + 300
        while not until() and time.monotonic() < give_up:
            for key, _ in self.select.select(10.0):
                part = key.fileobj.recv(65536)
                if not part:
                    return False
                if key.fileobj is self.plant:
                    # Between two lines, or what is inserted would cut one.
                    if insert and part.endswith(b"\r"):
                        part, insert = part + insert, b""
                    self.board.sendall(part)
                else:
                    *lines, self.line = (self.line + part).split(b"\r")
                    for line in lines:
                        self.hear(line.strip(b"\a").decode("ascii", "replace"))
                    try:
                        self.plant.sendall(part)
                    except OSError:
                        return False
        return until()


def attempt(elf, machine, esmc, scene):
    """0; None: the board did not arm."""
    with tempfile.TemporaryDirectory() as folder:
        uart, mine = f"{folder}/uart", f"{folder}/middle"
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(mine)
        listener.listen(1)
        board = qemu(elf, machine, f"unix:{uart},server=on,wait=on", icount=ICOUNT_LOOP)
        plant = None
        try:
            while not Path(uart).exists() and board.poll() is None:
                time.sleep(0.05)
            plant = subprocess.Popen([esmc, "plant", scene, "--bus", f"slcan:unix:{mine}", "--json"], stdout=subprocess.PIPE,
                                     stderr=subprocess.PIPE, text=True)
            theirs, _ = listener.accept()
            to_board = socket.socket(socket.AF_UNIX)
            to_board.connect(uart)
            m = Middle(theirs, to_board)
            # The emulator's seconds pass faster than the machine's: on a busy one the board may give up arming before the plant speaks.
            if not m.carry(lambda: sum(t for _, t in m.torques) >= 100):
                return None
            foreign = b"t3018DEADBEEFDEADBEEF\r"  # of a node that is not ours; to ours, or to all, it would be another fault
            m.idle.clear()
            begin = len(m.torques)
            assert m.carry(lambda: len(m.torques) >= begin + 100, foreign * NOISE), "noise stopped it"
            assert all(t for _, t in m.torques[begin + 20:]) and not m.idle, "noise took the torque away"
            begin = len(m.torques)
            # Without data: an emulator on a busy machine takes seconds for long ones, and the plant waits five for an answer.
            m.carry(lambda: len(m.torques) >= begin + 60, b"t3010\r" * FLOOD)
            after = m.torques[begin:]
            first = next((i for i, (_, t) in enumerate(after) if not t), None)
            print(f"after the flood: {first} torque frames with torque, then {len(after) - (first or 0)} without; idle asked of {sorted(m.idle)}")
            assert first is not None and len(after) - first >= 20 and not any(t for _, t in after[first:]), after
            # Frames of ticks that were already on their way; the tick that reads the flood has none with torque.
            assert first <= 8, after[:first + 1]
            assert len(m.idle) == 2, m.idle
        finally:
            board.kill()
            if plant is not None:
                plant.kill()
                plant.communicate()
    return 0


if __name__ == "__main__":
    sys.exit(0 if any(attempt(*sys.argv[1:]) == 0 for _ in range(5)) else "the board never ran")
