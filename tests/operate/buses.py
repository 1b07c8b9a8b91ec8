"""Buses for consoles, controllers and plants, each with an ear for every frame: adapters that speak slcan behind a hub of
sockets, or an interface of the kernel."""
import re
import select
import socket
import struct
import threading


class SlcanHub:
    """Every frame of an adapter goes to all others, in the order in which they come."""
    LINE = re.compile(rb"([tr])([0-9A-Fa-f]{3})([0-8])([0-9A-Fa-f]*)|([TR])([0-9A-Fa-f]{8})([0-8])([0-9A-Fa-f]*)")

    def __init__(self, hear):
        self.hear, self.clients, self.lock, self.over = hear, {}, threading.Lock(), False
        self.server = socket.create_server(("127.0.0.1", 0))
        self.bus = "slcan:tcp:127.0.0.1:%d" % self.server.getsockname()[1]
        threading.Thread(target=self.run, daemon=True).start()

    def close(self):
        self.over = True

    def run(self):
        while not self.over:
            for s in select.select([self.server, *self.clients], [], [], 0.1)[0]:
                if s is self.server:
                    client = s.accept()[0]
                    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    with self.lock:
                        self.clients[client] = b""
                    continue
                try:
                    part = s.recv(65536)
                except OSError:
                    part = b""
                if not part:
                    with self.lock:
                        del self.clients[s]
                    s.close()
                    continue
                *lines, rest = (self.clients[s] + part).split(b"\r")
                self.clients[s] = rest
                for line in lines:
                    self.pass_on(line, s)
        for s in (self.server, *self.clients):
            s.close()

    def pass_on(self, line, source):
        match = self.LINE.fullmatch(line)
        if not match:
            return  # a command to the adapter
        with self.lock:
            for other in list(self.clients):
                if other is not source:
                    try:
                        other.sendall(line + b"\r")
                    except OSError:
                        pass
        if match[1] == b"t":
            self.hear(int(match[2], 16), bytes.fromhex(match[4].decode()))

    def send(self, identifier, data):
        self.pass_on(b"t%03X%d%s" % (identifier, len(data), data.hex().upper().encode()), None)


class Interface:
    FRAME = struct.Struct("<IB3x8s")

    def __init__(self, name, hear):
        self.bus, self.hear = name, hear
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4000000)
        self.socket.bind((name,))
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while True:
            identifier, size, data = self.FRAME.unpack(self.socket.recv(16))
            self.hear(identifier, data[:size])

    def close(self):
        """Its thread ends with the program."""

    def send(self, identifier, data):
        self.socket.send(self.FRAME.pack(identifier, len(data), bytes(data)))
        self.hear(identifier, bytes(data))  # one's own frames do not come back
