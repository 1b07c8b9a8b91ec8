"""A serial line between two programs that speak slcan."""
import socket
import threading
import time
from pathlib import Path


class Cable:
    """Two slcan endpoints; what one program sends, the other one hears."""

    def __init__(self, folder):
        self.paths = [str(Path(folder, name)) for name in ("a", "b")]
        self.servers = []
        for path in self.paths:
            server = socket.socket(socket.AF_UNIX)
            server.bind(path)
            server.listen()
            self.servers.append(server)
        self.ends = [None, None]
        for i in range(2):
            threading.Thread(target=self.carry, args=(i,), daemon=True).start()

    def close(self):
        for one in self.servers + [end for end in self.ends if end is not None]:
            one.close()

    def carry(self, i):
        self.ends[i], _ = self.servers[i].accept()
        while self.ends[1 - i] is None:
            time.sleep(0.001)
        rest = b""
        try:
            while part := self.ends[i].recv(65536):
                *lines, rest = (rest + part).split(b"\r")
                self.ends[1 - i].sendall(b"".join(line + b"\r" for line in lines if line and line[:1] in b"tTrR"))
        except OSError:  # one of them has ended
            return
