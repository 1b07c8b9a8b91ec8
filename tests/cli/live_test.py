#!/usr/bin/env python3
"""esmc live from outside, with and without permission: tokens, origins, hosts, sizes, floods.

Usage: live_test.py ESMC SCENE [sanitized]
"""

import base64
import itertools
import json
import os
import pathlib
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import urllib.parse

from cable import Cable

PATIENCE = 60  # s, for what must happen; nothing here measures time


class Bench:
    """A running bench."""

    def __init__(self, esmc, scene, *options):
        self.process = subprocess.Popen([esmc, "live", scene, "--json", *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                        text=True)
        self.url = self.process.stderr.readline().strip()
        parts = urllib.parse.urlsplit(self.url)
        assert parts.scheme == "http" and parts.hostname == "127.0.0.1" and parts.path == "/", self.url
        self.port = parts.port
        self.token = urllib.parse.parse_qs(parts.query)["token"][0]
        self.own = f"http://127.0.0.1:{self.port}"

    def connect(self):
        return socket.create_connection(("127.0.0.1", self.port), PATIENCE)

    def end(self):
        self.process.send_signal(signal.SIGINT)
        out, err = self.process.communicate(timeout=PATIENCE)
        assert self.process.returncode == 0, (self.process.returncode, err)
        return json.loads(out)


def request(bench, target=None, method="GET", host=None, headers=()):
    """Status, headers and body; status 0: closed without a word."""
    target = f"/?token={bench.token}" if target is None else target
    host = f"127.0.0.1:{bench.port}" if host is None else host
    lines = [f"{method} {target} HTTP/1.1", *([f"Host: {host}"] if host else []), "Connection: close", *headers, "", ""]
    with bench.connect() as s:
        s.sendall("\r\n".join(lines).encode())
        data = b""
        try:
            while part := s.recv(65536):
                data += part
        except ConnectionResetError:
            pass
    head, _, body = data.partition(b"\r\n\r\n")
    first, *rest = head.decode("latin-1").split("\r\n")
    return int(first.split()[1]) if first else 0, {k.lower(): v.strip() for k, v in (line.split(":", 1) for line in rest)}, body


class Page:
    """A WebSocket as a browser speaks it, and as none would."""

    def __init__(self, bench, origin="own", target=None, host=None):
        self.s = bench.connect()
        self.data = b""
        key = base64.b64encode(os.urandom(16)).decode()
        lines = [f"GET {target or '/bench?token=' + bench.token} HTTP/1.1", f"Host: {host or f'127.0.0.1:{bench.port}'}", "Upgrade: websocket",
                 "Connection: Upgrade", f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13"]
        if origin is not None:
            lines.append(f"Origin: {bench.own if origin == 'own' else origin}")
        self.s.sendall("\r\n".join([*lines, "", ""]).encode())
        try:
            while b"\r\n\r\n" not in self.data:
                part = self.s.recv(4096)
                if not part:
                    break
                self.data += part
        except ConnectionResetError:
            pass
        head, _, self.data = self.data.partition(b"\r\n\r\n")
        self.status = int(head.split()[1]) if head else 0

    def take(self, n):
        while len(self.data) < n:
            part = self.s.recv(65536)
            if not part:
                raise EOFError
            self.data += part
        out, self.data = self.data[:n], self.data[n:]
        return out

    def frame(self):
        """Opcode and payload."""
        first, second = self.take(2)
        size = second & 0x7F
        if size == 126:
            size = struct.unpack(">H", self.take(2))[0]
        elif size == 127:
            size = struct.unpack(">Q", self.take(8))[0]
        return first & 0xF, self.take(size)

    def hear(self):
        """The next message."""
        while True:
            opcode, payload = self.frame()
            if opcode == 1:
                return json.loads(payload)
            if opcode == 8:
                raise EOFError

    def wait(self, wanted, what):
        give_up = time.monotonic() + PATIENCE
        while time.monotonic() < give_up:
            message = self.hear()
            if wanted(message):
                return message
        raise AssertionError(f"never came: {what}")

    def closed(self):
        """Waits until the server ends it; the code it gives, or 0."""
        try:
            while True:
                opcode, payload = self.frame()
                if opcode == 8:
                    return struct.unpack(">H", payload[:2])[0] if len(payload) >= 2 else 0
        except (EOFError, ConnectionResetError):
            return 0

    def send(self, payload, opcode=1, last=True, masked=True, says=None):
        payload = payload if isinstance(payload, bytes) else payload.encode()
        size = len(payload) if says is None else says
        head = bytes([opcode | (0x80 if last else 0)])
        mask = 0x80 if masked else 0
        head += bytes([mask | size]) if size < 126 else bytes([mask | 126]) + struct.pack(">H", size) if size < 65536 else \
            bytes([mask | 127]) + struct.pack(">Q", size)
        if masked:
            key = os.urandom(4)
            payload = bytes(b ^ key[i % 4] for i, b in enumerate(payload))
            head += key
        try:
            self.s.sendall(head + payload)
        except (BrokenPipeError, ConnectionResetError):
            pass

    def say(self, **message):
        self.send(json.dumps(message))

    def close(self):
        self.s.close()


def now(page):
    return page.wait(lambda m: "now" in m, "a sample")["now"]


def goes_on(page):
    """The loop still ticks, and still controls."""
    before = now(page)["t"]
    after = page.wait(lambda m: "now" in m and m["now"]["t"] > before + 0.1, "a later sample")["now"]
    assert after["dropped"] == 0, after
    return after


def who_may_see_the_page(bench):
    status, headers, body = request(bench)
    assert status == 200 and headers["content-type"].startswith("text/html"), (status, headers)
    for name in ("content-security-policy", "referrer-policy", "cache-control", "x-content-type-options"):
        assert name in headers, name
    body_of_the_page = body
    assert b"{{" not in body and bench.token.encode() in body
    assert "unsafe" not in headers["content-security-policy"]
    for file in ("live.js", "live.css"):
        status, _, text = request(bench, f"/{file}?token={bench.token}")
        assert status == 200 and len(text) > 1000 and b"ESMC_INCLUDE" not in text, (file, status)
        assert request(bench, f"/{file}")[0] == 403, file

    wrong = bench.token[:-1] + ("0" if bench.token[-1] != "0" else "1")
    for token in ("", "0", wrong, bench.token + "0", bench.token[:-1], bench.token.upper() + "g", "%00" + bench.token, "x" * 3000):
        status = request(bench, f"/?token={token}")[0]
        assert status in (403, 0) and (status == 403 or len(token) > 1000 or "%" in token), (token, status)
    assert request(bench, "/")[0] == 403
    for host in ("evil.example", f"evil.example:{bench.port}", "127.0.0.1", f"127.0.0.1:{bench.port + 1}", f"127.0.0.1.evil.example:{bench.port}",
                 f"[::1]:{bench.port}", ""):
        assert request(bench, host=host)[0] != 200, host
    assert request(bench, host=f"localhost:{bench.port}")[0] == 200
    for origin in ("http://evil.example", "null", f"https://127.0.0.1:{bench.port}", f"http://127.0.0.1:{bench.port + 1}"):
        assert request(bench, headers=[f"Origin: {origin}"])[0] == 403, origin
    for method in ("POST", "PUT", "DELETE", "OPTIONS", "HEAD", "BREW"):
        status, _, body = request(bench, method=method)
        assert status != 200 and bench.token.encode() not in body, (method, status)
    for path in ("/../../../../etc/passwd", "/..%2f..%2fetc/passwd", "//", "/live.js/..", "/bench", "/etc/passwd", "/%00"):
        status, _, text = request(bench, f"{path}?token={bench.token}")
        assert status != 200 or text == body_of_the_page, (path, status)  # another way to say /


def who_may_open_a_socket(bench):
    for origin in (None, "null", "http://evil.example", f"https://127.0.0.1:{bench.port}", f"http://127.0.0.1:{bench.port + 1}",
                   f"http://127.0.0.1:{bench.port}.evil.example", "http://127.0.0.1", "file://"):
        page = Page(bench, origin=origin)
        assert page.status != 101, origin
        page.close()
    for target in ("/bench", "/bench?token=", f"/bench?token={bench.token[:-1]}", f"/?token={bench.token}", f"/other?token={bench.token}"):
        page = Page(bench, target=target)
        assert page.status != 101, target
        page.close()
    page = Page(bench, host="evil.example")
    assert page.status != 101
    page.close()
    pages = [Page(bench) for _ in range(8)]
    assert [p.status for p in pages] == [101] * 8
    ninth = Page(bench)
    assert ninth.status == 503, ninth.status
    for p in [*pages, ninth]:
        p.close()
    # Their places are free again.
    give_up = time.monotonic() + PATIENCE
    while (page := Page(bench)).status != 101:
        assert time.monotonic() < give_up
        page.close()
    return page


def nonsense(bench, page):
    for text in ("", "{", "null", "[]", "3", '"do"', '{"do":"explode"}', '{"do":3}', '{"hand":1}', '{"hand":{"at":[1]}}', '{"hand":{"at":[1e999,0]}}',
                 '{"hand":{"at":["a","b"]}}', '{"inject":5}', '{"set":"control.law=pd"}', '{"set":[5]}', '{"effects":[5]}', '{"unknown":1}', "[" * 20000,
                 '{"a":' * 5000, "\x00\x01", "\xff" * 100):
        page.send(text)
    page.send(b"\xff\xfe\x00", opcode=2)
    page.send(b"", opcode=9)
    goes_on(page)
    for says in ({"set": ["control.lambda=-1"]}, {"set": ["control.law=wish"]}, {"set": ["nothing"]}, {"set": ["mechanism.type=rr"]},
                 {"effects": ['type = "bit_timing"']}, {"effects": ["}, {"]}, {"set": ["reference.radius=5.0"]}, {"inject": {"fault": "gremlin"}},
                 {"inject": {"fault": "drive_error", "drive": 9}}, {"set": ["a=1\n\x1b[31mb"]}):
        page.say(**says)
        answer = page.wait(lambda m: "answers" in m, f"a refusal of {says}")["answers"]
        assert len(answer) == 1 and "\n" not in answer[0] and "\x1b" not in answer[0] and len(answer[0]) > 10, answer
    assert goes_on(page)["state"] == "running"

    long = Page(bench)
    long.send("x" * (64 * 1024 + 1))
    assert long.closed() in (1009, 0)
    lies = Page(bench)
    lies.send(b"x" * 100, says=1 << 40)
    assert lies.closed() in (1009, 1002, 0)
    pieces = Page(bench)
    pieces.send("[", last=False)
    for _ in range(70):
        pieces.send("1," * 500, opcode=0, last=False)
    assert pieces.closed() in (1009, 0)
    for opcode in (3, 11, 15):
        odd = Page(bench)
        odd.send("x", opcode=opcode)
        odd.closed()
    goes_on(page)


def crowds(bench, page):
    slow = []
    for _ in range(100):  # more than the server has places for: some wait in the system's queue
        s = bench.connect()
        s.sendall(b"GET / HTTP/1.1\r\nHost: ")
        slow.append(s)
    goes_on(page)
    # Unfinished requests are closed.
    for s in slow[:20]:
        s.settimeout(PATIENCE)
        try:
            while s.recv(4096):
                pass
        except ConnectionResetError:
            pass
    for s in slow:
        s.close()
    for _ in range(300):  # and connections closed at once
        bench.connect().close()
    deaf = Page(bench)  # reads nothing, while the loop goes on
    goes_on(page)
    for _ in range(50):
        page.say(hand={"at": [0.0, 0.2]})
        page.say(set=["control.lambda=-1"])
    page.say(hand={})
    goes_on(page)
    deaf.close()
    give_up = time.monotonic() + PATIENCE
    while request(bench)[0] != 200:
        assert time.monotonic() < give_up, "no room for a page after the crowd"


def what_a_page_can_do(page):
    page.say(hand={"at": [0.1, 0.3]})
    pulled = page.wait(lambda m: "now" in m and m["now"]["anchor"] == [0.1, 0.3], "the hand")["now"]
    assert sum(f * f for f in pulled["force"]) > 0.01, pulled
    page.say(hand={"at": [1e306, 0.0], "push": [0.0, -1e200]})
    pulled = page.wait(lambda m: "now" in m and m["now"]["anchor"] == [1000.0, 0.0], "a hand far away")["now"]
    assert sum(f * f for f in pulled["force"]) > 0.01 and pulled["fault"] == "none", pulled
    page.say(hand={})
    page.wait(lambda m: "now" in m and m["now"]["force"] == [0.0, 0.0], "no hand")
    page.say(set=["simulation.integrator=radau5"])
    page.say(effects=['type = "backlash", gap = 1e-3, rotor_inertia = 1e-9'])
    page.wait(lambda m: any("radau5 cannot solve" in e["text"] for e in m.get("events", [])), "an integration that fails")
    page.say(set=[])
    page.say(do="home")
    page.wait(lambda m: "now" in m and m["now"]["state"] == "running", "home after it")
    if "sanitized" not in sys.argv:  # the design takes minutes there
        page.say(set=['control.gain="robust"', "uncertainty={m1=0.5, m2=0.9}"])
        page.wait(lambda m: any("no tube around the motion" in a for a in m.get("answers", [])), "gains that cannot be designed")
    page.say(set=["control.law=smc", "control.gain=60.0"])
    page.wait(lambda m: m.get("scene", {}).get("law") == "smc", "another law")
    page.wait(lambda m: "now" in m and m["now"]["state"] == "enabling", "a restart")
    page.wait(lambda m: "now" in m and m["now"]["state"] == "running", "the new law at work")
    page.say(effects=['type = "payload", mass = 0.1'])
    assert page.wait(lambda m: "scene" in m, "the scene with an effect")["scene"]["effects"] == [{"type": "payload", "parameters": "mass = 0.1"}]
    page.say(inject={"fault": "drive_error", "drive": 2})
    fault = page.wait(lambda m: "now" in m and m["now"]["state"] == "fault", "the fault")["now"]
    assert fault["fault"] == "drive_error", fault
    page.say(do="home")
    page.wait(lambda m: "now" in m and m["now"]["state"] == "running", "home")
    page.say(set=[])
    scene = page.wait(lambda m: "scene" in m, "the scene as given")["scene"]
    assert scene["law"] == "esmc" and scene["effects"] == [] and scene["sets"] == [], scene
    page.wait(lambda m: "now" in m and m["now"]["state"] == "running", "the scene as given at work")


def a_hand_goes_with_its_page(bench, page):
    other = Page(bench)
    other.say(hand={"at": [0.1, 0.3]})
    page.wait(lambda m: "now" in m and m["now"]["anchor"] is not None, "the other's hand")
    other.close()
    page.wait(lambda m: "now" in m and m["now"]["anchor"] is None and m["now"]["force"] == [0.0, 0.0], "its end")


def only_on_loopback(bench):
    listening = [line.split() for line in pathlib.Path(f"/proc/{bench.process.pid}/net/tcp").read_text().splitlines()[1:]]
    places = [f[1] for f in listening if f[3] == "0A" and f[1].endswith(f":{bench.port:04X}")]
    assert places == [f"0100007F:{bench.port:04X}"], places
    six = pathlib.Path(f"/proc/{bench.process.pid}/net/tcp6")
    if six.exists():
        assert not [line for line in six.read_text().splitlines()[1:] if line.split()[3] == "0A" and f":{bench.port:04X} " in line]


class NoTurn(Exception):
    """The other process lost its drives before they were given a fault: it had no turn on this machine for too long."""


def a_controller_elsewhere(esmc, scene):
    for _ in range(5):
        try:
            return a_controller_with_its_turn(esmc, scene)
        except NoTurn as e:
            print(e, file=sys.stderr)
    raise AssertionError("the controller elsewhere never kept its turn")


def a_controller_with_its_turn(esmc, scene):
    """Drives and mechanism on a bus; the controller is another process, which comes, and goes."""
    patient = ["--set", "control.rate_hz=200", "--set", "limits.max_age_ticks=100", "--set", "drives.watchdog_timeout=5.0",
               "--set", "drives.heartbeat_timeout=5.0", "--set", "reference.speed=1.0",
               "--set", "drives.confirmed=true", "--set", "drives.sign_test=false", "--set", "drives.watchdog_test=false"]  # of a machine that does other things as well
    with tempfile.TemporaryDirectory() as folder:
        cable = Cable(folder)
        plant, controller = cable.paths
        bench = Bench(esmc, scene, "--bus", f"slcan:unix:{plant}", *patient)
        page = Page(bench)
        hello = page.wait(lambda m: "hello" in m, "the greeting")["hello"]
        assert hello["controller"] is False and "controller_death" not in [f["name"] for f in hello["faults"]], hello
        assert now(page)["state"] == "waiting" and now(page)["brake"]
        other = subprocess.Popen([esmc, "controller", scene, "--realtime", "--bus", f"slcan:unix:{controller}", "--json", *patient,
                                  "--set", "simulation.duration=1000"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            armed = page.wait(lambda m: "now" in m and m["now"]["state"] == "armed", "drives that are armed")["now"]
            moved = page.wait(lambda m: "now" in m and (m["now"]["state"] != "armed" or abs(m["now"]["effector"][0] - armed["effector"][0]) > 0.005),
                              "the reference followed")["now"]
            if moved["state"] != "armed":
                bench.process.kill()
                raise NoTurn(f"armed, and then {moved['state']}")
            page.say(hand={"push": [0.5, 0.0]})
            page.wait(lambda m: "now" in m and m["now"]["force"] == [0.5, 0.0], "a push")
            page.say(hand={})
            page.say(set=["control.lambda=20.0"])
            assert "controller is on" in page.wait(lambda m: "answers" in m, "a refusal")["answers"][0]
            page.say(effects=['type = "payload", mass = 0.05'])
            page.wait(lambda m: "scene" in m, "an effect")
            page.say(inject={"fault": "drive_error", "drive": 1})
            told = lambda m: any(e["kind"] == "fault" and "drive_error" in e["text"] for e in m.get("events", []))
            seen = page.wait(lambda m: told(m) or ("now" in m and m["now"]["state"] != "armed"), "the fault of a drive")
            if not told(seen) and not told(page.wait(lambda m: told(m) or "now" in m, "what is said of it")):
                bench.process.kill()
                raise NoTurn(f"without a fault of the drive: {seen['now']['state']}")
            # The drives say so at once; the controller learns it from the next heartbeat, and has its own turn on this machine.
            until = now(page)["t"] + 2.0
            page.wait(lambda m: "now" in m and m["now"]["t"] > until, "the controller's turn")
        finally:
            other.send_signal(signal.SIGINT)
            out, err = other.communicate(timeout=PATIENCE)
        assert [f["name"] for f in json.loads(out)["supervisor"]["faults"]] == ["drive_error"], (out, err)
        page.say(do="home")
        page.wait(lambda m: "now" in m and m["now"]["state"] == "waiting" and m["now"]["brake"], "home")
        bench.end()
        cable.close()


def torques(bench):
    """Times and torques of motor 1, as the page saves them."""
    rows = request(bench, f"/log.csv?token={bench.token}")[2].decode().splitlines()
    t, tau = (rows[0].split(",").index(name) for name in ("t", "tau11"))
    return [(float(r[t]), float(r[tau])) for r in (line.split(",") for line in rows[1:])]


def what_a_bench_shows_and_saves(esmc, scene):
    """A torque that alternates; time, whatever the tick; a fault without an end; a scene that names a file."""
    chatter = ["--set", "control.rate_hz=2000", "--set", "control.reaching=sign", "--set", "control.gain=10"]
    bench = Bench(esmc, scene, *chatter)
    now_at = lambda page, t: page.wait(lambda m: "now" in m and m["now"]["state"] == "running" and m["now"]["t"] > t, "a time")["now"]["t"]
    now_at(Page(bench), 1.0)
    seen = [abs(b - a) for (_, a), (_, b) in itertools.pairwise(torques(bench)[-200:])]
    assert sum(seen) / len(seen) > 0.2, seen
    bench.end()
    with tempfile.TemporaryDirectory() as folder:
        own = pathlib.Path(folder, "scene.toml")
        own.write_bytes(pathlib.Path(scene).read_bytes())
        pathlib.Path(folder, "ref.csv").write_text("t,x,y\n0,0.07,0.17\n50,0.05,0.18\n100,0.07,0.17\n")
        bench = Bench(esmc, own, "--set", 'reference={type="file", path="ref.csv", join=0.3}')
        page, last = Page(bench), 0.0
        for rate in (500, 1000, 250):
            last = now_at(page, last + 0.3)
            page.say(set=[f"control.rate_hz={rate}", "control.lambda=20.0"])
            page.wait(lambda m: "scene" in m, "another tick")
        now_at(page, last + 0.5)
        times = [t for t, _ in torques(bench)]
        assert all(0 < b - a < 0.2 for a, b in itertools.pairwise(times)), [p for p in itertools.pairwise(times) if not 0 < p[1] - p[0] < 0.2]
        page.say(inject={"fault": "torque_lost", "drive": 1, "ms": None})
        page.wait(lambda m: any("torque_lost" in e["text"] and "until" in e["text"] for e in m.get("events", [])), "no end")
        saved = pathlib.Path(folder, "elsewhere")
        saved.mkdir()
        (saved / "saved.toml").write_bytes(request(bench, f"/scene.toml?token={bench.token}")[2])
        bench.end()
        run = subprocess.run([esmc, "sim", saved / "saved.toml", "--set", "simulation.duration=0.1"], capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stderr


def a_bus_that_goes(esmc, scene):
    with tempfile.TemporaryDirectory() as folder:
        cable = Cable(folder)
        bench = Bench(esmc, scene, "--bus", f"slcan:unix:{cable.paths[0]}")
        now(Page(bench))
        cable.close()
        _, err = bench.process.communicate(timeout=PATIENCE)
        assert bench.process.returncode == 1 and "the slcan adapter is gone" in err, (bench.process.returncode, err)


def the_command(esmc, scene):
    """What it prints, and when it refuses."""
    # The web library keeps 72 bytes when it cannot listen; the process ends anyway.
    quiet = dict(os.environ, ASAN_OPTIONS=os.environ.get("ASAN_OPTIONS", "") + ":detect_leaks=0")
    run = lambda *options: subprocess.run([esmc, "live", scene, *options], capture_output=True, text=True, timeout=PATIENCE, env=quiet)
    done = run("--duration", "0.2")
    lines = done.stdout.splitlines()
    assert done.returncode == 0 and len(lines) == 2 and lines[0].startswith("http://127.0.0.1:") and "?token=" in lines[0], done
    with socket.create_server(("127.0.0.1", 0)) as taken:
        refused = run("--port", str(taken.getsockname()[1]))
    assert refused.returncode == 2 and refused.stdout == "" and "--port" in refused.stderr, refused
    for options in (["--port", "70000"], ["--duration", "0"], ["--duration", "nan"], ["--set", "control.law=none"], ["--bus", "nowhere"], ["--set", "control.lambda=-1"]):
        refused = run(*options)
        assert refused.returncode == 2 and refused.stdout == "" and refused.stderr.count("\n") == 1, (options, refused)
    # No two benches have one token.
    assert run("--duration", "0.01").stdout.split("token=")[1] != run("--duration", "0.01").stdout.split("token=")[1]


def main():
    esmc, scene = sys.argv[1:3]
    the_command(esmc, scene)
    a_controller_elsewhere(esmc, scene)
    a_bus_that_goes(esmc, scene)
    what_a_bench_shows_and_saves(esmc, scene)
    bench = Bench(esmc, scene)
    try:
        only_on_loopback(bench)
        who_may_see_the_page(bench)
        page = who_may_open_a_socket(bench)
        page.wait(lambda m: "now" in m and m["now"]["state"] == "running", "the loop at work")
        nonsense(bench, page)
        crowds(bench, page)
        what_a_page_can_do(page)
        a_hand_goes_with_its_page(bench, page)
        assert goes_on(page)["state"] == "running"
    except BaseException:
        bench.process.kill()
        print(bench.process.communicate()[1], file=sys.stderr)
        raise
    summary = bench.end()
    assert summary["samples_dropped"] == 0 and summary["final_state"] == "disabled", summary
    failed, *faults = [f["fault"] for f in summary["faults"]]
    assert failed.startswith("radau5 cannot solve") and faults == ["feedback_not_finite", "drive_error"], summary
    assert summary["server"]["malformed"] >= 20 and summary["server"]["too_long"] >= 2 and summary["server"]["refused"] > 40, summary
    print("live bench: refuses unauthorised clients, and goes on")


if __name__ == "__main__":
    main()
