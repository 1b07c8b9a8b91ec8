"""Adapters that are none: each is a pseudo terminal, behind which python3-can speaks slcan; a hub joins two of them."""
import os
import pty
import select
import threading
import time
import tty

import can


class Adapter:
    """`path` is for the program under test. Its bytes go to the terminal that python-can has opened, and back; both
    directions are kept."""

    def __init__(self, bitrate=1000000):
        self.masters, self.slaves = zip(pty.openpty(), pty.openpty())
        for fd in self.slaves:
            tty.setraw(fd)
        self.path = os.ttyname(self.slaves[0])
        self.said = {self.masters[0]: bytearray(), self.masters[1]: bytearray()}
        self.over = threading.Event()
        self.pump = threading.Thread(target=self.carry, daemon=True)
        self.pump.start()
        self.bus = can.Bus(interface="slcan", channel=os.ttyname(self.slaves[1]), bitrate=bitrate, sleep_after_open=0)

    def carry(self):
        there = dict(zip(self.masters, reversed(self.masters)))
        while not self.over.is_set():
            for fd in select.select(self.masters, [], [], 0.05)[0]:
                part = os.read(fd, 4096)
                self.said[fd] += part
                while part:
                    part = part[os.write(there[fd], part):]

    def until_program_said(self, last):
        give_up = time.monotonic() + 120
        while not self.program.endswith(last):
            if time.monotonic() > give_up:
                raise AssertionError(f"no {last!r} at the end of {self.program!r}")
            time.sleep(0.01)

    @property
    def program(self):
        """What the program has said so far."""
        return bytes(self.said[self.masters[0]])

    @property
    def python_can(self):
        return bytes(self.said[self.masters[1]])

    def close(self):
        self.over.set()
        self.pump.join()
        for fd in self.masters + self.slaves:
            os.close(fd)


class Hub:
    """Every frame that one adapter hears the other one sends. `frames` counts them."""

    def __init__(self, one, other):
        self.frames = [0, 0]
        for i, (source, sink) in enumerate(((one, other), (other, one))):
            threading.Thread(target=self.forward, args=(i, source.bus, sink.bus), daemon=True).start()

    def forward(self, i, source, sink):
        while True:
            message = source.recv()
            if message is not None:
                sink.send(message)
                self.frames[i] += 1
