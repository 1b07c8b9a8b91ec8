#!/usr/bin/python3
"""docs/esmc.dbc against the firmware's codec, with canmatrix as the reader of the DBC file: frames in both directions,
value tables against the enumerators in the headers of firmware/ and their names, the version of the protocol, and the
supervisor computer of tests/link against all of them.

usage: dbc_test.py LINK_FRAMES [--self-test]   --self-test: one error in the DBC file or in a header must be noticed"""
import logging
import random
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

logging.disable(logging.WARNING)  # canmatrix complains at import about formats whose libraries are missing
import canmatrix.formats  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parent))
import supervisor  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
DBC = ROOT / "docs/esmc.dbc"
BASE = 0x780
# Signal: header and enumeration. Their values are the wire format.
TABLES = {"State": ("safety/supervisor", "State"), "Fault": ("safety/faults", "Fault"), "Order": ("link/codec", "Order"),
          "Source": ("link/codec", "Source"), "Space": ("link/codec", "Space"), "Reaction": ("link/codec", "Reacted"),
          "Answer": ("link/codec", "Answer"), "Pace": ("link/codec", "Pace"), "Subject": ("link/codec", "Subject"), "Index": ("link/parameters", "Index"),
          "Store": ("link/codec", "StoreState"), "Slot_1": ("link/codec", "SlotContent"), "Slot_2": ("link/codec", "SlotContent")}


def load(path):
    matrix = canmatrix.formats.loadp_flat(str(path))
    return {frame.name: frame for frame in matrix.frames}


def run(program, mode, text=""):
    return subprocess.run([program, mode], input=text, capture_output=True, text=True, check=True).stdout.splitlines()


def parse(words):
    return {name: float(value) for name, value in (word.split("=") for word in words)}


def close(signal, a, b):
    """Scaled integers are a float times a float: two roundings of 2^-24."""
    return a == b if signal.is_float or signal.factor == 1 else abs(a - b) <= 2.0**-23 * abs(a)


def out_of_controller(program, frames):
    seen = set()
    for line in run(program, "encode"):
        name, identifier, data, *signals = line.split()
        frame = frames.get(name)
        if frame is None or frame.arbitration_id.id != int(identifier):
            yield f"{name}: identifier {identifier} is not in the DBC file"
            continue
        seen.add(name)
        told = parse(signals)
        decoded = {s: float(v.phys_value) for s, v in frame.decode(bytes.fromhex(data)).items()}
        if decoded != told:
            yield f"{name} {data}: the DBC file reads {decoded}, it says {told}"
        if frame.encode({s: v if frame.signal_by_name(s).is_float else int(v) for s, v in told.items()}) != bytes.fromhex(data):
            yield f"{name} {data}: the DBC file encodes it in another way"
        if name == "Status" and supervisor.crc8(int(identifier), int(told["Session"]), bytes.fromhex(data)) != told["Crc"]:
            yield f"Status {data}: checksum"
    for name, frame in frames.items():
        if frame.arbitration_id.id >= BASE + 16 and name not in seen:
            yield f"{name}: in the DBC file, but the firmware has no such message"


def into_controller(program, frames):
    draw = random.Random(1)
    sent = []
    for name, frame in frames.items():
        if frame.arbitration_id.id >= BASE + 16:
            continue
        for n in range(60):
            values = {}
            for s in frame.signals:
                low, high = s.calculate_raw_range()
                if s.name in TABLES and s.values:
                    raw = draw.choice(sorted(s.values))
                elif s.is_float:
                    raw = draw.uniform(-100, 100)
                else:
                    raw = {0: low, 1: high}.get(n, draw.randint(int(low), int(high)))
                values[s.name] = raw  # what canmatrix encodes
            if name == "Command":  # another percentage has no meaning, and is not read
                over = frame.signal_by_name("Order").values[values["Order"]] == "override"
                values["Percent"] = values["Percent"] % 101 if over else 0
            values["Crc"] = 0
            session = draw.randint(0, 255)
            data = bytearray(frame.encode(values))
            data[0] = supervisor.crc8(frame.arbitration_id.id, session, data)
            values["Crc"] = data[0]
            sent.append((frame, session, values, bytes(data)))
    text = "".join(f"{f.arbitration_id.id} {session} {data.hex()}\n" for f, session, _, data in sent)
    answers = run(program, "decode", text)
    if len(answers) != len(sent):
        yield "the codec did not answer every frame"
    for (frame, _, values, data), line in zip(sent, answers):
        intact, *signals = line.split()
        told = parse(signals)
        if intact != "1":
            yield f"{frame.name} {data.hex()}: checksum"
        if told.keys() != values.keys():
            yield f"{frame.name} {data.hex()}: signals {sorted(told)}, in the DBC file {sorted(values)}"
            continue
        for name, value in values.items():
            s = frame.signal_by_name(name)
            want = float(frame.decode(data)[name].phys_value)
            if not close(s, want, told[name]) or (not s.is_float and not close(s, float(value * s.factor), told[name])):
                yield f"{frame.name}.{name} {data.hex()}: {told[name]}, in the DBC file {want}"


def header(name, root):
    """Text of a header of firmware/ without its comments."""
    return re.sub(r"//[^\n]*", "", (root / f"firmware/{name}.hpp").read_text(encoding="utf-8"))


def enumerators(name, enum, root):
    """{value: enumerator}; every enumerator must have its value in the source, so that an insertion renumbers none."""
    body = re.search(rf"enum class (?:\[\[nodiscard\]\] )?{enum} : std::uint8_t\s*\{{(.*?)\}}", header(name, root), re.S)
    entries = [entry.split("=") for entry in body[1].split(",") if entry.strip()] if body else []
    if not entries or any(len(entry) != 2 for entry in entries):
        raise ValueError(f"firmware/{name}.hpp: {enum}: an enumerator without its value")
    values = {int(value, 0): enumerator.strip() for enumerator, value in entries}
    if len(values) != len(entries):
        raise ValueError(f"firmware/{name}.hpp: {enum}: a value twice")
    return values


def value_tables(program, frames, root):
    tables = {signal: enumerators(*where, root) for signal, where in TABLES.items()}
    names = {}
    for line in run(program, "tables"):
        title, number, name = line.split()
        names.setdefault(title, {})[int(number)] = name
    if names.keys() != {"State", "Fault", "Store", "Slot_1", "Slot_2"}:
        yield f"names of {sorted(names)}"
    for title, table in names.items():
        if table != tables[title]:
            yield f"{title}: names {table}, enumerators {tables[title]}"
    for frame in frames.values():
        for s in frame.signals:
            values = {int(k): v for k, v in s.values.items()}
            if s.name in TABLES and values and (s.min, s.max) != (0, max(values)) and s.name != "Index":
                yield f"{frame.name}.{s.name}: from {s.min} to {s.max}, with the values {values}"
            if s.name in TABLES and values != tables[s.name]:
                yield f"{frame.name}.{s.name}: values {values}, in the firmware {tables[s.name]}"
            if s.name not in TABLES and values:
                yield f"{frame.name}.{s.name} has values that nothing is compared with"


def protocol_version(program, path, root):
    """The constant of the codec, the Identity that it encodes, VERSION of the DBC file, the page and supervisor.py."""
    constant = int(re.search(r"protocol_version = (\d+);", header("link/codec", root))[1])
    page = (ROOT / "docs/command-interface.md").read_text(encoding="utf-8")
    said = {"the DBC file": re.findall(r'^VERSION "(\d+)"', path.read_text(encoding="utf-8"), re.M),
            "command-interface.md": re.findall(r"\*\*protocol version (\d+)\*\*", page),
            "supervisor.py": [str(supervisor.PROTOCOL_VERSION)]}
    for where, versions in said.items():
        if versions != [str(constant)]:
            yield f"protocol version {constant}, in {where} {versions}"
    desk = supervisor.Desk(BASE)
    for line in run(program, "encode"):
        name, identifier, data, *_ = line.split()
        if name == "Identity":
            desk.hear(int(identifier), bytes.fromhex(data))
            if desk.version != constant:
                yield f"Identity {data}: protocol version {desk.version}, in the header {constant}"
    try:
        supervisor.Desk(BASE).hear(BASE + 0x1C, bytes([1, 2, 3, 4, constant + 1, 0, 0, 0]))
        yield "supervisor.py takes a controller of another protocol version"
    except RuntimeError:
        pass


def layout(frames):
    for frame in frames.values():
        if frame.size != 8 or not BASE <= frame.arbitration_id.id < BASE + 32 or frame.arbitration_id.extended:
            yield f"{frame.name}: size or identifier"
        used = set()
        for s in frame.signals:
            bits = set(range(s.start_bit, s.start_bit + s.size))
            if bits & used or not s.is_little_endian or max(bits) > 63:
                yield f"{frame.name}.{s.name}: overlaps, or is not little endian"
            used |= bits


def own_computer(frames):
    """The other implementation of these tests, tests/link/supervisor.py."""
    desk = supervisor.Desk(BASE)
    desk.session, desk.tick, desk.parameters = 9, 0x12345, 0xABCD1234
    for order, name in frames["Command"].signal_by_name("Order").values.items():
        identifier, data = desk.order(name)
        d = frames["Command"].decode(data)
        got = (identifier, d["Order"].raw_value, d["Tick"].raw_value, d["Parameters"].raw_value)
        if got != (BASE, int(order), 0x2345, 0x1234):
            yield f"supervisor.py: order {name} is {got}"
    identifier, data = desk.pair(1, (-0.123456, 0.2), 1e-6)
    d = frames["Set_Point"].decode(data)
    if abs(float(d["Position_1"].phys_value) + 0.123456) > 1e-9 or abs(float(d["Position_2"].phys_value) - 0.2) > 1e-9:
        yield f"supervisor.py: set point {data.hex()}"


def shown_frames(frames):
    """The frames of docs/command-interface.md that anybody may send."""
    page = (DBC.parent / "command-interface.md").read_text(encoding="utf-8")
    shown = dict(re.findall(r"780#([0-9A-F]{16}) +# (\w+)", page))
    if sorted(shown.values()) != ["disarm", "off"]:
        yield f"command-interface.md: shows {shown}"
    for text, order in shown.items():
        data = bytes.fromhex(text)
        d = frames["Command"].decode(data)
        if supervisor.crc8(BASE, 0, data) != data[0] or str(d["Order"].named_value) != order:
            yield f"command-interface.md: 780#{text} is not {order}"


def problems(program, path, root=ROOT):
    frames = load(path)
    yield from layout(frames)
    yield from value_tables(program, frames, root)
    yield from protocol_version(program, path, root)
    yield from out_of_controller(program, frames)
    yield from into_controller(program, frames)
    yield from own_computer(frames)
    yield from shown_frames(frames)


def self_test(program):
    good = DBC.read_text(encoding="utf-8")
    wrong = [(r"SG_ Tick : 32\|24", "SG_ Tick : 32|23"), (r'(?<=Fault )0 "none" 1 "feedback_not_finite"', '0 "none" 1 "nothing"'),
             (r'8 "fault" ;', '8 "failed" ;'), (r"\(1e-06,0\)", "(1e-05,0)"), (r"SIG_VALTYPE_ 1939 Value : 1;", ""),
             (r"BO_ 1937 Fault_Record", "BO_ 1951 Fault_Record"), (r"SG_ Drive_Error : 32\|32@1\+", "SG_ Drive_Error : 32|32@0+"),
             (r"SG_ Space : 12\|1@", "SG_ Space : 13|1@"), (r"\Z", 'BO_ 1951 More: 8 Controller\n SG_ A : 0|8@1+ (1,0) [0|1] "" Supervisor\n'),
             (r"SG_ Count : 16\|16@1\+ \(1,0\)", "SG_ Count : 16|16@1- (1,0)"), (r"(?<=Store )0 \"none\"", '0 "no"'),
             (r"SG_ Slot_2 : 24\|8", "SG_ Slot_2 : 16|8"), (r'10 "forget"', '10 "erase"'), (r'VERSION "1"', 'VERSION "2"'),
             (r"SG_ Fault : 16\|8@1\+ \(1,0\) \[0\|32\]", "SG_ Fault : 16|8@1+ (1,0) [0|30]")]
    # In a header: two enumerators that changed places, one put into the middle, one without its value, one that is new.
    enums = [("safety/faults", r"feedback_jump = 2,(.*?)stale_feedback = 3,", r"feedback_jump = 3,\1stale_feedback = 2,"),
             ("safety/faults", r"stale_feedback = 3,", "inserted = 3,\n stale_feedback = 4,"),
             ("safety/faults", r"stale_feedback = 3,", "stale_feedback,"),
             ("safety/faults", r"(home_no_stop = 32,)", r"\1\n one_more = 33,"),
             ("safety/supervisor", r"running = 3,", "running = 9,"), ("link/codec", r"forget = 10,", "erase = 10,"),
             ("link/codec", r"protocol_version = 1;", "protocol_version = 2;"), ("link/parameters", r"silence = 11,", "silence = 12,")]
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        for file, pattern, instead in [(None, *w) for w in wrong] + enums:
            root = Path(folder)
            shutil.copytree(ROOT / "firmware", root / "firmware", dirs_exist_ok=True)
            path = root / (f"firmware/{file}.hpp" if file else "wrong.dbc")
            text, n = re.subn(pattern, instead, path.read_text(encoding="utf-8") if file else good, count=1, flags=re.S)
            path.write_text(text, encoding="utf-8")
            try:
                found = list(problems(program, DBC if file else path, root))
            except Exception as error:  # noqa: BLE001: what cannot be read was noticed as well
                found = [repr(error)]
            if n != 1 or not found:
                failed += 1
                print(f"dbc_test.py: does not notice {instead!r}")
    total = len(wrong) + len(enums)
    print(f"{total - failed} of {total} seeded errors found")
    return failed


def main():
    if sys.argv[2:] == ["--self-test"]:
        return 1 if self_test(sys.argv[1]) else 0
    found = list(problems(sys.argv[1], DBC))
    print("\n".join(found[:20]) or f"{len(load(DBC))} messages agree")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
