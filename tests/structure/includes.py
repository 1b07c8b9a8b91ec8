#!/usr/bin/env python3
"""Allowed includes: arrows go down only. A rule whose folder is gone, or holds no file, fails.

  hal/*.hpp             std, hal/*.hpp
  hal/<back end>        hal, std and the headers of its OS or vendor
  hal/slcan, fdcan, zynqmp_can, flash, virtual   hal, std: portable; linux uses slcan
  firmware/numeric      std
  firmware/mechanism    std, Eigen (through types), types, numeric, mechanism
  firmware/control      the same and control
  firmware/safety       std, safety
  firmware/drive        std, hal/*.hpp, drive
  firmware/link         std, hal/*.hpp, safety, link
  firmware/cycle        std, Eigen (through types), all firmware, hal/*.hpp
  host_sim/<room>       std, libraries, hal, and the rooms that HOST lists for it: each of them stands above it in that table, so
                        no circle can be listed. Of firmware: types, numeric, parameters and wire formats only, but for the rooms
                        that HOST marks with the controller
  boards                std, firmware, hal/*.hpp, boards, the board's own chip.hpp, the baked scene.hpp and bench_frames.inc; never host_sim or tests
  boards/<board>        the same and hal/slcan, hal/fdcan, hal/zynqmp_can, hal/flash; boards/linux: the same and hal/linux
  nothing in firmware or hal includes host_sim, boards or tests; nothing in host_sim includes tests

No circle of files either, NAME.hpp and NAME.cpp being one file.
"""

import pathlib
import re
import sys
import tempfile

INCLUDE = re.compile(r'^\s*#\s*(?:include|import)\s*([<"])([^>"]+)[>"]')
STD = r"<[a-z_]+>"  # C++ headers have neither path nor suffix; C and OS headers do
HAL = r"hal/[a-z_]+\.hpp"
MODEL = STD + r"|firmware/(types\.hpp|numeric/.*|mechanism/.*)"
SHARED = r"firmware/(types\.hpp|numeric/.*|mechanism/params\.hpp|(drive/(odrive|canopen|cia402|mit|moteus)|link/codec)\.hpp)"

BOARDS = rf"{STD}|{HAL}|firmware/.*|boards/.*|(chip|scene)\.hpp|bench_frames\.inc"

# folder, search below it too, what its files may include (a whole match)
RULES = [
    ("hal", False, rf"{STD}|{HAL}"),
    ("hal/linux", True, rf"<.*>|{HAL}|hal/(linux|slcan)/.*"),
    ("hal/slcan", True, rf"{STD}|{HAL}|hal/slcan/.*"),
    ("hal/fdcan", True, rf"{STD}|{HAL}|hal/fdcan/.*"),
    ("hal/flash", True, rf"{STD}|{HAL}|hal/flash/.*"),
    ("hal/zynqmp_can", True, rf"{STD}|{HAL}|hal/zynqmp_can/.*"),
    ("hal/virtual", True, rf"{STD}|{HAL}|hal/virtual/.*"),
    ("firmware", False, rf"{STD}|<Eigen/Core>|firmware/numeric/.*"),
    ("firmware/numeric", True, rf"{STD}|firmware/numeric/.*"),
    ("firmware/mechanism", True, MODEL),
    ("firmware/control", True, rf"{MODEL}|firmware/control/.*"),
    ("firmware/safety", True, rf"{STD}|firmware/safety/.*"),
    ("firmware/drive", True, rf"{STD}|{HAL}|firmware/drive/.*"),
    ("firmware/link", True, rf"{STD}|{HAL}|firmware/(safety|link)/.*"),
    ("firmware/cycle", True, rf"{STD}|{HAL}|firmware/.*"),
    ("boards", False, BOARDS),
    ("boards/linux", True, rf"{BOARDS}|hal/linux/.*"),
    ("host_sim", False, rf"<.*>|hal/.*|host_sim/[a-z_]+\.hpp|{SHARED}"),
    ("host_sim/design", True, rf"{STD}|<fmt/.*>|firmware/.*|host_sim/(design/.*|scene/(friction|uncertainty)\.hpp)"),
]

# The rooms of host_sim from the bottom up: what they may see of firmware, and which rooms below them. Files that lie in host_sim
# itself are everybody's. docs/architecture.md shows this table; `includes.py --table` prints it.
VALUES, MODELS, CONTROLLER = "values", "model", "controller"
HOST = {
    "integrate": (VALUES, ""),
    "effects": (VALUES, ""),
    "plant": (VALUES, "effects integrate"),
    "problems": (MODELS, "integrate"),
    "report": (VALUES, "plant"),
    "scene": (VALUES, "effects plant"),
    "bus": (VALUES, "effects report scene"),
    "drives": (VALUES, "effects plant scene"),
    "export": (VALUES, "scene"),
    "plan": (CONTROLLER, "design scene"),
    "controller": (CONTROLLER, "design drives plan scene"),
    "record": (CONTROLLER, "bus controller plant report scene"),
    "loop": (CONTROLLER, "bus controller drives plant record scene"),
    "web": (VALUES, ""),
    "operate": (CONTROLLER, "bus controller loop record report scene web"),
    "calibrate": (CONTROLLER, "controller record report scene"),
    "identify": (CONTROLLER, "controller record report scene"),
    "check": (CONTROLLER, "bus controller design drives effects loop plant record report scene"),
    "spatial": (CONTROLLER, "effects loop record scene"),
    "campaign": (CONTROLLER, "bus controller drives loop operate plant record report scene"),
    "sweep": (CONTROLLER, "controller integrate loop plant record report scene"),
    "studies": (CONTROLLER, "check controller drives effects integrate loop plan plant problems record report scene sweep"),
    "python": (CONTROLLER, "check controller drives loop record scene studies sweep"),
    "live": (CONTROLLER, "bus campaign controller drives effects loop plant record report scene web"),
    "cli": (CONTROLLER, "bus calibrate campaign check controller export identify live loop operate record scene spatial studies sweep"),
}
# Files that share a room with what sees the controller, and no more: the plant in space, the judge of a campaign and what it
# judges, the supervisor computer's codec, the equations of estimations.
ALONE = [
    (r"host_sim/spatial/plant\.[ch]pp", rf"{STD}|<Eigen/.*>|host_sim/spatial/(plant|params)\.hpp|{SHARED}"),
    (r"host_sim/campaign/(computer|protocol_traits|draw|injections|judge|times|faulty_bus|faulty_plant)\.[ch]pp",
     rf"<.*>|hal/.*|host_sim/(bus|campaign|drives|plant|scene)/.*|host_sim/operate/link_client\.hpp|host_sim/error\.hpp|{SHARED}"),
    (r"host_sim/operate/link_client\.[ch]pp", rf"{STD}|hal/.*|host_sim/operate/link_client\.hpp|{SHARED}"),
    (r"host_sim/(calibrate/(?!calibrate\.)|identify/(?!identify\.))[a-z_]+\.[ch]pp",
     rf"<.*>|host_sim/(calibrate|identify|record)/.*|host_sim/(error|least_squares)\.hpp|{SHARED}"),
]
FIRMWARE = {VALUES: SHARED, MODELS: rf"{MODEL}|{SHARED}", CONTROLLER: r"firmware/.*"}


def alone(place):
    return next((allowed for files_, allowed in ALONE if re.fullmatch(files_, str(place))), None)


def host_rules():
    seen = {"design"}
    for room, (firmware, below) in HOST.items():
        rooms = below.split()
        for other in rooms:
            if other not in seen:
                sys.exit(f"includes.py: {room} lists {other}, which does not stand above it in HOST")
        seen.add(room)
        own = "|".join((room, *rooms))
        yield f"host_sim/{room}", True, rf"<.*>|hal/.*|host_sim/({own})/.*|host_sim/[a-z_]+\.hpp|{FIRMWARE[firmware]}"


def table():
    """The picture of docs/architecture.md."""
    lines = ["| room | of the firmware | rooms below it that it sees |", "|---|---|---|"]
    for room, (firmware, below) in reversed(HOST.items()):
        lines.append(f"| `{room}` | {firmware} | {' '.join(below.split()) or '-'} |")
    return "\n".join(lines)
NEVER_EIGEN = ("hal", "firmware/safety", "firmware/drive", "firmware/link", "firmware/numeric")
HOSTED = re.compile(r"<(iostream|[io]?fstream|[io]?sstream|cstdio|cstdlib|new|memory|string|string_view|vector|deque|list|"
                    r"map|set|unordered_map|unordered_set|functional|exception|stdexcept|system_error|typeinfo|typeindex|"
                    r"any|regex|locale|random|thread|mutex|condition_variable|future|filesystem|format)>")


def files(root, folder, below):
    found = (root / folder).rglob("*") if below else (root / folder).glob("*")
    return sorted(f for f in found if f.suffix in (".hpp", ".cpp", ".h", ".c", ".in") and f.is_file())


def unlisted_rooms(root):
    known = {*HOST, "design", "scenes", "sweeps"}
    return sorted(d.name for d in (root / "host_sim").glob("*") if d.is_dir() and d.name not in known)


def board_folders(root):
    return sorted(f"boards/{d.name}" for d in (root / "boards").glob("*") if d.is_dir() and d.name != "linux")


def back_ends(root):
    named = {"hal/linux", "hal/slcan", "hal/fdcan", "hal/zynqmp_can", "hal/flash", "hal/virtual"}
    return sorted(f"hal/{d.name}" for d in (root / "hal").glob("*") if d.is_dir() and f"hal/{d.name}" not in named)


def rules(root):
    yield from RULES
    yield from host_rules()
    for room in unlisted_rooms(root):
        yield f"host_sim/{room}", True, "nothing: it has no line in HOST"
    for folder in board_folders(root):
        yield folder, True, rf"{BOARDS}|hal/(slcan|fdcan|zynqmp_can|flash)/.*"
    for folder in back_ends(root):
        yield folder, True, rf"<.*>|{HAL}|{folder}/.*|\"[^/]*\""


def violations(root):
    for folder, below, allowed in rules(root):
        found = files(root, folder, below)
        if not found and (any(folder == r[0] for r in RULES) or folder.removeprefix("host_sim/") in HOST):
            yield f"{folder}: gone or empty, its rule would pass for ever"
        for file in found:
            place = file.relative_to(root)
            for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
                match = INCLUDE.match(line)
                if not match:
                    if re.match(r"\s*#\s*(include|import)\b", line):
                        yield f"{place}:{number}: an include that cannot be read: {line.strip()}"
                    continue
                what = match[2] if match[1] == '"' else f"<{match[2]}>"
                if not re.fullmatch(alone(place) or allowed, what):
                    yield f"{place}:{number}: {folder} may not include {what}"
                elif folder.startswith("firmware") and HOSTED.fullmatch(what):
                    yield f"{place}:{number}: {what} needs an operating system, a heap or exceptions"
                elif folder.startswith(NEVER_EIGEN) and "Eigen" in what:
                    yield f"{place}:{number}: {folder} may not include {what}"
                elif match[1] == '"' and "/" in what and not (root / what).is_file() and not what.endswith("version.hpp"):
                    yield f"{place}:{number}: {what} does not exist"


def circles(root):
    """Files that include each other, in one way or another: what remains once all are gone that include none that remains."""
    graph = {}
    for top in ("boards", "hal", "firmware", "host_sim"):
        for file in files(root, top, True):
            name = str(file.relative_to(root).with_suffix(""))
            found = re.findall(r'^\s*#\s*include\s*"([^"]+)"', file.read_text(encoding="utf-8"), re.M)
            graph.setdefault(name, set()).update(str(pathlib.Path(f).with_suffix("")) for f in found if (root / f).is_file())
    for name, included in graph.items():
        included.discard(name)
    while leaves := {name for name, included in graph.items() if not included & graph.keys()}:
        graph = {name: included for name, included in graph.items() if name not in leaves}
    while roots := graph.keys() - set().union(*graph.values()):  # what only leads to a circle
        graph = {name: included for name, included in graph.items() if name not in roots}
    if graph:
        yield "a circle of files among " + ", ".join(sorted(graph))


def self_test(root):
    """Each line, put at the end of its file in a copy, must be found; the copy itself must be clean."""
    seeded = [
        ("hal/can.hpp", "#include <Eigen/Core>"),
        ("hal/can.hpp", "#include <linux/can.h>"),
        ("hal/can.hpp", '#include "hal/linux/socketcan.hpp"'),
        ("hal/can.hpp", '#include "firmware/types.hpp"'),
        ("hal/linux/socketcan.hpp", '#include "firmware/types.hpp"'),
        ("hal/linux/socketcan.hpp", '#include "host_sim/error.hpp"'),
        ("hal/virtual/virtual_bus.hpp", '#include "hal/linux/socketcan.hpp"'),
        ("hal/slcan/slcan.hpp", "#include <termios.h>"),
        ("firmware/types.hpp", '#include "hal/can.hpp"'),
        ("firmware/numeric/elementary.hpp", '#include "firmware/types.hpp"'),
        ("firmware/mechanism/rr.hpp", '#include "hal/can.hpp"'),
        ("firmware/mechanism/rr.hpp", '#include "firmware/control/law.hpp"'),
        ("firmware/mechanism/rr.hpp", "#include <vector>"),
        ("firmware/control/law.hpp", '#include "firmware/safety/guards.hpp"'),
        ("firmware/control/law.hpp", '#include "firmware/cycle/controller.hpp"'),
        ("firmware/safety/guards.hpp", '#include "firmware/types.hpp"'),
        ("firmware/safety/guards.hpp", "  #  include <Eigen/Dense>"),
        ("firmware/safety/guards.hpp", '#include "hal/can.hpp"'),
        ("firmware/drive/odrive.hpp", '#include "firmware/types.hpp"'),
        ("firmware/drive/odrive.hpp", '#include "firmware/safety/faults.hpp"'),
        ("firmware/link/codec.hpp", '#include "firmware/types.hpp"'),
        ("firmware/link/codec.hpp", '#include "firmware/drive/odrive.hpp"'),
        ("firmware/link/command_link.hpp", '#include "firmware/cycle/setpoint_generator.hpp"'),
        ("firmware/cycle/cycle.hpp", '#include "hal/virtual/virtual_bus.hpp"'),
        ("firmware/cycle/cycle.hpp", '#include "boards/linux/main.hpp"'),
        ("firmware/cycle/cycle.hpp", "#include <cstdio>"),
        ("firmware/cycle/cycle.hpp", "#include SOME_MACRO"),
        ("firmware/cycle/cycle.hpp", '#include "guards.hpp"'),
        ("boards/node.hpp", '#include "host_sim/error.hpp"'),
        ("boards/node.hpp", '#include "hal/linux/socketcan.hpp"'),
        ("boards/stm32/main.cpp", '#include "hal/linux/realtime.hpp"'),
        ("boards/linux/main.cpp", '#include "hal/fdcan/fdcan.hpp"'),
        ("hal/fdcan/fdcan.hpp", '#include "hal/slcan/slcan.hpp"'),
        ("hal/flash/bank_slots.hpp", '#include "hal/fdcan/registers.hpp"'),
        ("boards/linux/main.cpp", '#include "hal/flash/bank_slots.hpp"'),
        ("hal/zynqmp_can/zynqmp_can.hpp", '#include "hal/fdcan/registers.hpp"'),
        ("boards/mps2/main.cpp", '#include "tests/support/odrive_bytes.hpp"'),
        ("host_sim/plant/plant.hpp", '#include "firmware/mechanism/five_bar.hpp"'),
        ("host_sim/spatial/plant.hpp", '#include "host_sim/spatial/rotation.hpp"'),
        ("host_sim/plant/plant.hpp", '#include "firmware/control/reference.hpp"'),
        ("host_sim/plant/plant.hpp", '#include "firmware/drive/odrive_axis.hpp"'),
        ("host_sim/scene/scene.hpp", '#include "firmware/safety/guards.hpp"'),
        ("host_sim/error.hpp", '#include "firmware/cycle/cycle.hpp"'),
        ("host_sim/plant/plant.hpp", '#include "host_sim/problems/closed_chains.hpp"'),
        ("host_sim/problems/problems.hpp", '#include "firmware/control/law.hpp"'),
        ("host_sim/problems/problems.hpp", '#include "host_sim/scene/scene.hpp"'),
        ("host_sim/plant/plant.hpp", '#include "host_sim/loop/waiting.hpp"'),
        ("host_sim/plant/plant.hpp", '#include "host_sim/controller/controller_config.hpp"'),
        ("host_sim/effects/effects.hpp", '#include "host_sim/plant/plant.hpp"'),
        ("host_sim/scene/scene.hpp", '#include "host_sim/drives/actuators.hpp"'),
        ("host_sim/controller/bake.hpp", '#include "host_sim/loop/run.hpp"'),
        ("host_sim/record/recording.hpp", '#include "host_sim/sweep/journal.hpp"'),
        ("host_sim/campaign/judge.hpp", '#include "host_sim/live/session.hpp"'),
        ("host_sim/campaign/judge.hpp", '#include "firmware/safety/supervisor.hpp"'),
        ("host_sim/calibrate/geometry.hpp", '#include "firmware/mechanism/five_bar.hpp"'),
        ("host_sim/identify/identification.hpp", '#include "host_sim/controller/controller_config.hpp"'),
        ("host_sim/design/extremes.hpp", '#include "host_sim/plant/plant.hpp"'),
        ("host_sim/design/extremes.hpp", '#include "host_sim/scene/scene.hpp"'),
        ("host_sim/plan/plan.hpp", '#include "host_sim/plant/plant.hpp"'),
        ("host_sim/studies/studies.hpp", '#include "tests/support/fake_bus.hpp"'),
    ]
    failed = 0
    with tempfile.TemporaryDirectory() as scratch:
        copy = pathlib.Path(scratch)
        for top in ("boards", "hal", "firmware", "host_sim"):
            for file in files(root, top, True):
                (copy / file.relative_to(root)).parent.mkdir(parents=True, exist_ok=True)
                (copy / file.relative_to(root)).write_text(file.read_text(encoding="utf-8"), encoding="utf-8")
        clean = set(violations(copy))
        for name, line in seeded:
            file = copy / name
            if not file.is_file():
                print(f"includes.py: {name} of the self-test is gone")
                failed += 1
                continue
            before = file.read_text(encoding="utf-8")
            file.write_text(before + line + "\n", encoding="utf-8")
            if not set(violations(copy)) - clean:
                print(f"includes.py: does not notice {line} in {name}")
                failed += 1
            file.write_text(before, encoding="utf-8")
        plant = copy / "host_sim/plant/simd_pair.hpp"
        before = plant.read_text(encoding="utf-8")
        clean_circles = set(circles(copy))
        plant.write_text(before + '#include "host_sim/plant/five_bar_plant.hpp"\n', encoding="utf-8")
        if not set(circles(copy)) - clean_circles:
            print("includes.py: does not notice a circle of files")
            failed += 1
        plant.write_text(before, encoding="utf-8")
        (copy / "host_sim/cellar").mkdir()
        (copy / "host_sim/cellar/new.hpp").write_text("#include <vector>\n", encoding="utf-8")
        if not any("host_sim/cellar" in v for v in violations(copy)):
            print("includes.py: does not notice a room that has no line")
            failed += 1
        (copy / "host_sim/cellar/new.hpp").unlink()
        for file in files(copy, "firmware/safety", True):
            file.unlink()
        if not any("firmware/safety: gone" in v for v in violations(copy)):
            print("includes.py: does not notice that a folder is gone")
            failed += 1
    print(f"{len(seeded) + 3 - failed} of {len(seeded) + 3} seeded violations found")
    return failed


def main():
    arguments = sys.argv[1:]
    root = pathlib.Path(__file__).resolve().parents[2]
    if arguments == ["--self-test"]:
        return 1 if self_test(root) else 0
    if arguments == ["--table"]:
        print(table())
        return 0
    if arguments:
        print("includes.py: usage: includes.py [--self-test | --table]", file=sys.stderr)
        return 2
    found = [*violations(root), *circles(root)]
    if table() not in (root / "docs/architecture.md").read_text(encoding="utf-8"):
        found.append("docs/architecture.md: its table of rooms is not what `includes.py --table` prints")
    for violation in found:
        print(violation)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
