#!/usr/bin/python3
"""Images of boards: built by their presets, run in QEMU where it has the processor.

usage: board_test.py build ROOT BOARD ESMC       with the esmc command that bakes
       board_test.py image ELF SCALAR [FLASH RAM]   what must not be in it, and what it takes of the memories, at most
       board_test.py image ELF SCALAR COSTS         the same, where board_costs.hpp says what it takes
       board_test.py parts ELF [NAME...]         the optional parts of the controller in it are these, and no others
       board_test.py loop ELF MACHINE SCALAR ESMC SCENE
                                                    closes the loop with `esmc plant` over slcan: the same digest as
                                                    `esmc hil --scalar SCALAR`, to the last bit
       board_test.py count ELF MACHINE DOCS COSTS [--update | --sample COUNT]
                                                    instructions per tick, and what optional parts add: the tables of
                                                    docs/boards.md and of host_sim/controller/board_costs.hpp; with
                                                    --sample of esmc and of COUNT other laws
       board_test.py hot ELF                        a tick's functions lie in the fast memory, and nothing that runs before the copy
       board_test.py crash ELF MACHINE              faults that it provokes leave their record
       board_test.py same ROOT BOARD BOARD          two boards link the same control archive, byte for byte"""
import json
import re
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import page_table
import stack_bound
import zcu102

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
import sample  # noqa: E402

LAWS = ("esmc", "esmc_projected", "smc", "ctc", "pd")  # in the order of count.cpp
OPTIONS = ("super_twisting", "implicit_coupled", "elbow_rotors", "motor_map", "momentum_observer", "predictor", "closure_projection", "four_motors")
LARGEST = ("super_twisting", "momentum_observer", "predictor", "closure_projection")  # that fit together
SET_POINTS = {"new_set_point": 3000, "set_point_tick": 600}  # instructions at most, of a Cortex-M4F
# What a tick under ESMC runs, mangled. Every function of such a name must lie in the fast memory; the first three may be inlined.
HOT = ("9TimedLoopI.*4turn", "5CycleI.*8transmitI", "3hal5FdcanI.*4pump", "5CycleI.*6decideE", "10ControllerI.*4tickE",
       "10ControllerI.*7desiredE", "10ControllerI.*9apply_lawE", "9ReferenceI.*4fromEy", "20clamped_accelerationILNS_7LawKindE0E",
       "18estimate_from_base")
ICOUNT = "shift=6,sleep=off"  # an instruction is 64 ns; the emulator does not wait for anybody
# With a plant beside it an instruction is 8 ns: a plant that does not get its turn on a loaded machine is late by fewer of the image's seconds.
ICOUNT_LOOP = "shift=3,sleep=off"


def run(*command, **more):
    return subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False, **more)


def qemu(elf, machine, serial, *more, icount=ICOUNT):
    return subprocess.Popen(["qemu-system-arm", "-M", machine, "-display", "none", "-monitor", "none", "-icount", icount,
                             "-kernel", elf, "-serial", serial, *more], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def build(root, board, esmc, other=None):
    """other: a board with the same processor, built before."""
    launcher = f"{Path(__file__).with_name('shared_objects.py')};{Path(root).resolve()}/build/{other}" if other else ""
    # What the images of these two need; the others' tests look into the whole archive.
    instances = "five_bar" if board in ("linux", "zcu102_rpu") else ""
    for step in (["cmake", "--preset", board, f"-DESMC_TOOL={esmc}", "-DESMC_BENCH=ON", f"-DESMC_LAUNCHER={launcher}",
                  f"-DESMC_INSTANCES={instances}"],
                 ["cmake", "--build", "--preset", board]):
        done = run(*step, cwd=root)
        if done.returncode != 0:
            print(done.stdout[-4000:], done.stderr[-4000:])
            return 1
    return 0


def bounds_of(costs, board):
    """Bytes of flash and RAM that board_costs.hpp says the image of a board takes."""
    return re.search(rf'\{{"{board}", \w+, [\d.e]+, \d+, \d+, (\d+), (\d+)\}}', Path(costs).read_text(encoding="utf-8")).groups()


def flash_and_ram(elf):
    size = run("arm-none-eabi-size", elf).stdout.splitlines()[1].split()
    return int(size[0]) + int(size[1]), int(size[1]) + int(size[2])


def image(elf, scalar, flash_max=1 << 20, ram_max=1 << 17):
    if str(flash_max).endswith(".hpp"):
        flash_max, ram_max = bounds_of(flash_max, Path(elf).stem)
    names = run("arm-none-eabi-nm", "-C", elf).stdout
    hosted = (r"_?malloc\w*|_?free|_sbrk\w*|operator new.*|operator delete.*|__cxa_\w*|_Unwind\w*|__gxx_personality\w*|"
              r"typeinfo .*|vtable .*|\w*printf\w*|_write|_read|.*aligned_malloc.*")
    software = r"|__aeabi_d\w+" if scalar == "float" else ""  # of a processor that has no double
    bad = re.findall(rf"^.* [tTwWbBdDrRvV] ({hosted}{software})$", names, re.M)
    flash, ram = flash_and_ram(elf)
    print(f"forbidden symbols: {bad}; flash {flash} of {flash_max} bytes, RAM {ram} of {ram_max} bytes with the stack")
    with tempfile.TemporaryDirectory() as folder:
        run("arm-none-eabi-objcopy", "-O", "binary", elf, f"{folder}/flash")
        first = struct.unpack("<16I", Path(folder, "flash").read_bytes()[:64])
    if not starts(first, symbols_of(elf)):
        print("vectors:", " ".join(f"{word:x}" for word in first))
        return 1
    if not flashed_alike(Path(elf)):
        return 1
    return 1 if bad or flash > int(flash_max) or ram > int(ram_max) else 0


def segments(elf):
    """Bytes of the ELF's loadable segments by their address in the flash."""
    data = elf.read_bytes()
    headers, = struct.unpack_from("<I", data, 28)
    size, count = struct.unpack_from("<HH", data, 42)
    memory = {}
    for i in range(count):
        kind, at, _, place, length = struct.unpack_from("<5I", data, headers + i * size)
        if kind == 1:
            memory.update(enumerate(data[at:at + length], place))
    return memory


def hex_bytes(path):
    """The same of an Intel HEX file, its checksums checked."""
    memory, base = {}, 0
    for line in path.read_text(encoding="ascii").split():
        record = bytes.fromhex(line[1:])
        assert line[0] == ":" and sum(record) % 256 == 0 and len(record) == record[0] + 5, line
        data = record[4:-1]
        if record[3] == 0:
            memory.update(enumerate(data, base + int.from_bytes(record[1:3], "big")))
        elif record[3] in (2, 4):
            base = int.from_bytes(data, "big") << (16 if record[3] == 4 else 4)
    return memory


def flashed_alike(elf):
    """Whether .hex and .bin beside the ELF hold its segments, and nothing else but filling."""
    wanted, plain = segments(elf), elf.with_suffix(".bin").read_bytes()
    first = min(wanted)
    filled = {a: plain[a - first] if a - first < len(plain) else None for a in wanted}
    good = hex_bytes(elf.with_suffix(".hex")) == wanted and filled == wanted and len(plain) == max(wanted) - first + 1
    print(f".hex and .bin {'equal' if good else 'DIFFER FROM'} the segments of the ELF, {len(wanted)} bytes from {first:#x}")
    return good


def misplaced(functions, begin, end, early):
    """What lies on the wrong side, of {mangled name: address}; `early`: runs before the copy, or after a crash."""
    inside = {f for f, a in functions.items() if begin <= a < end}
    wrong = [f"no function {h}" for h in HOT[3:] if not any(re.match(f"_ZNK?4esmc{h}", f) for f in functions)]
    wrong += [f"in the flash: {f}" for f in functions if f not in inside and any(re.match(f"_ZNK?4esmc{h}", f) for h in HOT)]
    return wrong + [f"in the fast memory: {f}" for f in inside if f in early or not re.match("_ZN|__+.*_veneer$", f)]


def hot(elf):
    """The functions of the image by the linker's symbols, what runs early by the compiler's call graph."""
    elf = Path(elf)
    at = symbols_of(elf)
    begin, end, load = (at[f"esmc_hot_{name}"] for name in ("begin", "end", "image"))
    functions = {f: int(a, 16) & ~1 for a, f in re.findall(r"^([0-9a-f]+) [tTwW] (\S+)$", run("arm-none-eabi-nm", elf).stdout, re.M)
                 if not f.startswith(("$", "esmc_hot_"))}
    _, calls = stack_bound.read_graph(p.read_text() for p in sorted(elf.parent.rglob("*.ci")))
    early, new = set(), {f for f in functions if f.startswith("esmc_") and f not in ("esmc_main", "esmc_can_interrupt")}
    while new:
        early |= new
        new = set().union(*(calls.get(f, set()) for f in new)) - early - {"esmc_main"}
    wrong = misplaced(functions, begin, end, early)
    # The copy: whole words of the flash, which hold code; the bytes are in .hex and .bin, by `image`.
    memory = segments(elf)
    if (end - begin) % 4 or not all(load + i in memory for i in range(end - begin)) or {"esmc_reset", "memcpy", "memset"} - early:
        wrong.append(f"the copy of {end - begin} bytes from {load:#x}, by functions {sorted(early)[:9]}")
    tick = next(f for f in functions if re.match(f"_ZNK?4esmc{HOT[4]}", f))
    for moved, to in ((tick, at["esmc_reset"]), ("memcpy", begin), ("esmc_crash", begin)):
        if not misplaced({**functions, moved: to}, begin, end, early):
            wrong.append(f"{moved} could lie on the wrong side and this test would not see it")
    print("\n".join(wrong) or f"{end - begin} bytes at {begin:#x}, {len(early)} early functions elsewhere")
    return 1 if wrong else 0


def parts(elf, *names):
    symbols = run("arm-none-eabi-nm", "-C", elf).stdout
    found = {part for part in OPTIONS if re.search(rf"\besmc::part::{part}<", symbols)}
    print("optional parts:", " ".join(sorted(found)) or "none")
    return 0 if "esmc::Controller<" in symbols and found == set(names) else 1


def starts(first, at):
    """Whether the processor begins where it should with these first words of the flash."""
    if "esmc_entry" not in at:  # Cortex-M: its stack, then its first instruction
        return first[0] == at["esmc_stack_top"] and first[1] == at["esmc_reset"] | 1
    # Cortex-R: eight times "ldr pc, [pc, #24]", Arm instructions, and where each of them goes: Arm code, so even addresses.
    handlers = ("entry", "undefined", "call", "prefetch_abort", "data_abort", "unused", "irq", "fiq")
    return first[:8] == (0xE59FF018,) * 8 and first[8:] == tuple(at[f"esmc_{h}"] for h in handlers)


def symbols_of(elf):
    return {n: int(a, 16) for a, n in re.findall(r"^([0-9a-f]+) \w (\w+)$", run("arm-none-eabi-nm", elf).stdout, re.M)}


def emulator(monitor, *commands):
    """Commands to the QEMU that listens at `monitor`, each a name and its arguments."""
    with socket.socket(socket.AF_UNIX) as qmp:
        qmp.connect(monitor)
        talk = qmp.makefile("rw")
        for name, arguments in (("qmp_capabilities", {}), *commands):
            talk.write(json.dumps({"execute": name, "arguments": arguments}) + "\n")
            talk.flush()
            while "return" not in json.loads(talk.readline()):
                pass


def stack_used(elf, monitor, folder):
    """Bytes of the stack that no longer hold the start-up's paint, of how many."""
    at = symbols_of(elf)
    bottom, top = at["esmc_stack_bottom"], at["esmc_stack_top"]
    emulator(monitor, ("pmemsave", {"val": bottom, "size": top - bottom, "filename": f"{folder}/stack"}))
    memory = Path(folder, "stack").read_bytes()
    painted = 0
    while memory[painted:painted + 4] == bytes.fromhex("5a5aa5a5"):
        painted += 4
    return top - bottom - painted, top - bottom


def loop(elf, machine, scalar, esmc, scene):
    duration = "simulation.duration=2.0"
    with tempfile.TemporaryDirectory() as folder:
        uart, monitor = f"{folder}/uart", f"{folder}/monitor"
        board = qemu(elf, machine, f"unix:{uart},server=on,wait=on", "-qmp", f"unix:{monitor},server=on,wait=off",
                     icount=ICOUNT_LOOP)
        try:
            while not Path(uart).exists() and board.poll() is None:
                time.sleep(0.05)
            plant = run(esmc, "plant", scene, "--bus", f"slcan:unix:{uart}", "--json", "--set", duration, timeout=400)
            used, reserved = stack_used(elf, monitor, folder)
        finally:
            board.kill()
    if plant.returncode != 0:
        print(plant.stdout[-500:], plant.stderr, board.communicate()[0])
        return 1
    got = json.loads(plant.stdout)
    want = json.loads(run(esmc, "hil", scene, "--scalar", scalar, "--json", "--set", duration).stdout)
    most = stack_bound.of_image(elf, Path(elf).parent)[0]
    print(f"stack: {used} of {reserved} bytes used, at most {most} by the call graph")
    if not 500 < used <= most <= reserved:
        return 1
    print(f"{got['ticks']} ticks, settled rms {got['tracking']['settled_rms_m']:.3g} m, digest {got['digest']}")
    same = all(got[key] == want[key] for key in ("digest", "ticks", "final_state", "tracking"))
    other = json.loads(run(esmc, "hil", scene, "--scalar", "float" if scalar == "double" else "double", "--json", "--set",
                           duration).stdout)
    if got["digest"] == other["digest"]:
        print("the digest does not tell float from double: this test could not fail")
        return 1
    if not same or want["supervisor"]["faults"]:
        print(f"esmc hil --scalar {scalar}: digest {want['digest']}, faults {want['supervisor']['faults']}")
        return 1
    return 0


def flash_of_options(folder):
    """Bytes that optional parts add to the image of a board without any: it is linked again with their functions."""
    board = folder.name
    link = run("ninja", "-t", "commands", f"{board}.elf", cwd=folder).stdout.splitlines()[-1]
    symbols = run("arm-none-eabi-nm", folder / "firmware/libesmc_control.a").stdout
    without = flash_and_ram(folder / f"{board}.elf")

    def symbol(option):
        return re.search(rf" (_ZN4esmc4part[0-9]+{option}INS_7FiveBar\w+)", symbols)[1]

    def added(*options):
        keep = " ".join(f"-Wl,-u,{symbol(o)}" for o in options)
        with tempfile.TemporaryDirectory() as temporary:
            command = re.sub(r"-Map=\S+", f"-Map={temporary}/map", link).replace(f"-o {board}.elf", f"-o {temporary}/with.elf {keep}")
            done = run("sh", "-c", command, cwd=folder)
            if done.returncode != 0:
                raise SystemExit(done.stdout + done.stderr)
            flash, ram = flash_and_ram(f"{temporary}/with.elf")
        if ram != without[1]:
            raise SystemExit(f"{options} take RAM: {ram - without[1]} bytes")
        return flash - without[0]

    return {**{o: added(o) for o in OPTIONS}, "largest": added(*LARGEST)}


def preset(elf, symbol, value):
    """What makes the emulator write this value before the start."""
    return ["-device", f"loader,addr={symbols_of(elf)[symbol]:#x},data={value:#x},data-len=4"]


def selected(elf, count):
    """What makes the emulator tell the image of `count` to count esmc, and that many other laws drawn by the commit's hash."""
    drawn = [0, *sample.drawn(range(1, len(LAWS)), count, lambda i: LAWS[i])]
    if len(drawn) == len(LAWS):
        return len(LAWS), []
    return len(drawn), preset(elf, "esmc_laws_to_count", sum(1 << i for i in drawn))


def count(elf, machine, docs, costs, update, at_most):
    laws, options, set_points = {}, {}, {}
    wanted, more = selected(elf, at_most)
    board = qemu(elf, machine, "stdio", *more)
    for line in board.stdout:
        if line.startswith("done"):
            break
        m = re.fullmatch(r"(\w+) states (\d+) refused (\d+) least (\d+) mean (\d+) most (\d+)", line.strip())
        if not m:
            print("unexpected:", line)
            board.kill()
            return 1
        name, states, refused, least, mean, most = m[1], *map(int, m.groups()[1:])
        if refused or states < 1000:
            print(f"{name}: {refused} states in which no tick was counted, {states} counted")
            board.kill()
            return 1
        (options if name in (*OPTIONS, "largest") else set_points if name in SET_POINTS else laws)[name] = (least, mean, most)
    board.kill()
    if len(laws) != wanted:
        print(f"{len(laws)} laws counted, not {wanted}")
        return 1
    check = page_table.check if wanted == len(LAWS) else page_table.check_some
    rows = "".join(f"| `{law}` | {least} | {mean} | {most} |\n" for law, (least, mean, most) in laws.items())
    rounding = 2  # a timer that counts 1.6 per instruction may be off by one, the difference of two counts by two
    failed = check(docs, f"count {machine}", "| law | least | mean | most |\n|---|---|---|---|\n" + rows, update, rounding)
    rows = "".join(f"| {name.replace('_', ' ')} | {least} | {mean} | {most} |\n" for name, (least, mean, most) in set_points.items())
    failed |= page_table.check(docs, f"setpoints {machine}", "| | least | mean | most |\n|---|---|---|---|\n" + rows, update, rounding)
    if machine == "mps2-an386" and any(set_points[name][2] > limit for name, limit in SET_POINTS.items()):
        print(f"set points cost more than {SET_POINTS}")
        failed = 1
    flash = flash_of_options(Path(elf).parent)
    more = {name: most - laws["esmc"][2] for name, (_, _, most) in options.items()}
    rows = "".join(f"| `{o}` | {more[o]} | {flash[o]} |\n" for o in OPTIONS)
    rows += f"| {', '.join(f'`{o}`' for o in LARGEST)} together | {more['largest']} | {flash['largest']} |\n"
    head = "| optional part | instructions more than `esmc`, at most | bytes of flash |\n|---|---|---|\n"
    failed |= page_table.check(docs, f"costs {machine}", head + rows, update, rounding)
    rows = [f'    {{"{law}", {most}, 0}},' for law, (_, _, most) in laws.items()]
    rows += [f'    {{"{o}", {more[o]}, {flash[o]}}},' for o in OPTIONS]
    return failed | check(costs, f"costs {machine}", "\n".join(rows) + "\n    // ", update, rounding)


def crash(elf, machine):
    """MACHINE zcu102: the Cortex-R5F of that one."""
    r5f = machine == "zcu102"
    with tempfile.TemporaryDirectory() as folder:
        board = zcu102.qemu(elf, folder, "-serial", "stdio") if r5f else qemu(elf, machine, "stdio")
        lines = []
        for line in board.stdout:
            if re.match("no record|exception|done", line):  # not what the emulator says of itself
                lines.append(line.strip())
            if line.strip().endswith("done") or len(lines) > 8:
                break
        board.kill()
    print("\n".join(lines))
    symbols = symbols_of(elf)
    if len(lines) != (4 if r5f else 5) or lines[0] != "no record" or lines[-1] != "done":
        return 1
    records = [dict(re.findall(r"(\w+) ([0-9a-f]+)", line)) for line in lines[1:-1]]
    first, stack, *bites = ({k: int(v, 16) for k, v in r.items()} for r in records)
    bottom = symbols["esmc_stack_bottom"]
    if r5f:
        # The instruction that does not exist, itself.
        ok = first["exception"] == 1 and first["pc"] == symbols["not_an_instruction"] & ~1
        # A data abort, no permission (DFSR 0xD), as soon as the stack has reached its guard.
        ok = ok and stack["exception"] == 4 and stack["status"] & 0x40F == 0xD and bottom <= stack["address"] < bottom + 256
        # In the function that digs, or in what it calls to clear its memory.
        begin = symbols["_ZN4esmc4test3digEm"] & ~1
        ok = ok and any(begin <= stack[at] < begin + 256 for at in ("pc", "lr"))
        return 0 if ok and bottom - 0x1000 <= stack["sp"] < bottom + 256 else 1
    # A precise bus fault in the function that read where nothing is.
    begin = symbols["read_nowhere"] & ~1
    ok = first["exception"] == 5 and first["status"] & 0x8200 == 0x8200 and begin <= first["pc"] < begin + 16
    ok = ok and first["address"] == 0x9000_0000
    # A memory fault as soon as the stack has reached its guard; what was stacked cannot be read.
    ok = ok and stack["exception"] in (3, 4) and bottom - 0x1000 <= stack["sp"] < bottom + 256 and stack["pc"] == stack["lr"] == 0
    # The watchdog's warning, where the program hung.
    begin = symbols["hang"] & ~1
    ok = ok and bites[0]["exception"] == 2 and begin <= bites[0]["pc"] < begin + 32
    return 0 if ok else 1


def same(root, one, other):
    archives = [Path(root).resolve() / "build" / b / "firmware" / "libesmc_control.a" for b in (one, other)]
    with tempfile.TemporaryDirectory() as folder:
        members = []
        for i, archive in enumerate(archives):
            here = Path(folder, str(i))
            here.mkdir()
            run("arm-none-eabi-ar", "x", archive, cwd=here)
            members.append({f.name: f.read_bytes() for f in sorted(here.iterdir())})
    print(f"{one} and {other}: {', '.join(members[0])}")
    return 0 if members[0] == members[1] and len(members[0]) >= 8 else 1


if __name__ == "__main__":
    what, *arguments = sys.argv[1:]
    update = "--update" in arguments
    arguments = [a for a in arguments if a != "--update"]
    if what == "count":
        at_most = sample.take_option(arguments)
        sys.exit(count(*arguments, update, at_most))
    sys.exit({"build": build, "crash": crash, "hot": hot, "image": image, "loop": loop, "parts": parts, "same": same}[what](*arguments))
