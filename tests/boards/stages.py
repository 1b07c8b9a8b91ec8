#!/usr/bin/python3
"""Where the instructions of a tick go, stage by stage and law by law, and what a law buys with them: the emulator writes down
every instruction of one tick, and the debug information says of which function of the sources it is.

usage: stages.py ELF MACHINE SCALAR ESMC SCENE DOCS [--update]    ELF: of tests/boards/count.cpp
       stages.py --self-test"""
import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import board_test
import page_table

STAGES = ("decode", "checks", "closure", "reference", "law", "model", "allocation", "limits", "encode")
# By function, the innermost one that is named here. What is named nowhere (sine, arc tangent, a part of a formula that is a
# function of its own) belongs to the stage that called it.
OF = {stage: names.split() for stage, names in {
    "decode": "receive take",
    "checks": "tick open gather drive_fault check_shafts status apply_link_commands send_telemetry begin_tick raise compute observe accept keep advance",
    "closure": "estimate_from_base estimate_from_all",
    "reference": "follow desire desired desired_at_effector join_feasible start",
    "law": "fused_acceleration channelwise_acceleration smc_acceleration ctc_acceleration torque_pd",
    "model": "force",
    "allocation": "apply_law base_torque gather_on_base allocate_all to_base_motors",
    "limits": "guard guarded limit limit_torque allowed",
    "encode": "transmit put_torque try_send",
}.items()}
STAGE_OF = {name: stage for stage, names in OF.items() for name in names}
LAWS = ("esmc", "esmc_projected", "smc", "ctc", "pd")
# What the scene leaves open for laws that it does not use.
GAINS = {"ctc": ("control.kp=1600.0", "control.kd=80.0"), "pd": ("control.kp=40.0", "control.kd=1.0")}
CLOCK_MHZ = {"mps2-an386": 170, "mps2-an500": 400}
CYCLES_PER_INSTRUCTION = 1.5  # assumed: docs/boards.md


def bare(name):
    """ns::C<...>::f<...>(...) const -> f"""
    previous = None
    name = re.sub(r"operator\W+\(", "operator(", name)
    while name != previous:
        previous, name = name, re.sub(r"<[^<>]*>", "", name)
    return name.split("(")[0].split("::")[-1].split(" ")[-1]


def chains(elf, addresses):
    """Of each address the functions it belongs to, the innermost first."""
    text = subprocess.run(["arm-none-eabi-addr2line", "-a", "-i", "-f", "-C", "-e", elf],
                          input="\n".join(map(hex, addresses)), capture_output=True, text=True, check=True).stdout
    out = {}
    for line in text.splitlines():
        if re.fullmatch(r"0x[0-9a-f]+", line):
            names = out[int(line, 16)] = []
            odd = True
        else:
            if odd:
                names.append(bare(line))
            odd = not odd
    return out


def trace(elf, machine):
    """The addresses of all instructions that were executed, in order."""
    with tempfile.TemporaryDirectory() as folder:
        said, log = Path(folder, "said"), Path(folder, "log")
        board = subprocess.Popen(["qemu-system-arm", "-M", machine, "-display", "none", "-monitor", "none", "-icount",
                                  "shift=6,sleep=off", "-kernel", elf, "-serial", f"file:{said}", "-singlestep", "-d",
                                  "exec,nochain", "-D", log, *board_test.preset(elf, "esmc_states_to_count", 1)])
        for _ in range(600):
            time.sleep(0.1)
            if said.exists() and "done" in said.read_text(encoding="ascii"):
                break
        board.kill()
        board.wait()
        counted = dict(re.findall(r"(\w+) states 1 refused 0 .* most (\d+)", said.read_text(encoding="ascii")))
        out = []
        for line in log.read_text(encoding="ascii").splitlines():
            if line.startswith("Trace"):
                out.append(int(line.split("/")[1], 16))
            elif line.startswith("cpu_io_recompile"):
                out.pop()  # an access to a device: it is executed again
    return out, {law: int(n) for law, n in counted.items()}


def ticks_of(functions_of, executed):
    """The instructions of each tick that was counted, from one reading of the timer to the next."""
    in_timer = {a for a, f in functions_of.items() if "now" in f}
    readings = []  # first and last instruction of each; a compiler puts others between them
    for i, a in enumerate(executed):
        if a in in_timer:
            if readings and i - readings[-1][1] < 40:
                readings[-1][1] = i
            else:
                readings.append([i, i])
    return (executed[begin[1] + 1:end[0]] for begin, end in zip(readings[::2], readings[1::2]))


def by_stage(functions_of, executed):
    """Instructions per stage of each tick."""
    for part in ticks_of(functions_of, executed):
        counts, stage = dict.fromkeys(STAGES, 0), "decode"
        for a in part:
            stage = next((STAGE_OF[f] for f in functions_of[a] if f in STAGE_OF), stage)
            counts[stage] += 1
        yield counts


def table_of(elf, machine):
    executed, counted = trace(elf, machine)
    functions = chains(elf, sorted(set(executed)))
    ticks = dict(zip(LAWS, by_stage(functions, executed)))
    at = board_test.symbols_of(elf)
    slow = {a for a in next(ticks_of(functions, executed)) if not at["esmc_hot_begin"] <= a < at["esmc_hot_end"]}
    # The image's own main calls from there, and so is the library.
    strange = {f[-1] for a, f in functions.items() if a in slow and not re.search("_veneer$|^__|^esmc_main$", f[-1])}
    if strange:
        raise SystemExit(f"esmc: not in the fast memory: {strange}")
    if list(counted) != list(LAWS) or set(ticks) != set(LAWS):
        raise SystemExit(f"laws counted: {counted}, seen: {list(ticks)}")
    for law in LAWS:  # a timer that counts 1.6 per instruction, and its own reading
        if abs(sum(ticks[law].values()) - counted[law]) > 12:
            raise SystemExit(f"{law}: {sum(ticks[law].values())} instructions seen, {counted[law]} counted")
        if min(ticks[law][s] for s in STAGES if not (law == "pd" and s == "model")) < 15:
            raise SystemExit(f"{law}: a stage without instructions: {ticks[law]}")
    lines = ["| | " + " | ".join(f"`{law}`" for law in LAWS) + " |", "|---" * (len(LAWS) + 1) + "|"]
    lines += [f"| {s} | " + " | ".join(str(ticks[law][s]) for law in LAWS) + " |" for s in STAGES]
    return lines, {law: sum(ticks[law].values()) for law in LAWS}


def error_of(esmc, scene, scalar, law):
    """m, of the effector, rms after the reference has been joined."""
    sets = [w for s in (f'control.law="{law}"', *GAINS.get(law, ())) for w in ("--set", s)]
    done = subprocess.run([esmc, "hil", scene, "--scalar", scalar, "--json", *sets], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{law}: {done.stderr}")
    return json.loads(done.stdout)["tracking"]["settled_rms_m"]


def stages(elf, machine, scalar, esmc, scene, docs, update):
    lines, totals = table_of(elf, machine)
    clock = CLOCK_MHZ[machine]
    lines.append("| **all** | " + " | ".join(f"**{totals[law]}**" for law in LAWS) + " |")
    lines.append(f"| us at {clock} MHz, {CYCLES_PER_INSTRUCTION} cycles each, not timed | "
                 + " | ".join(f"{totals[law] * CYCLES_PER_INSTRUCTION / clock:.0f}" for law in LAWS) + " |")
    lines.append("| tracking error on the circle, um rms | "
                 + " | ".join(f"{1e6 * error_of(esmc, scene, scalar, law):.3g}" for law in LAWS) + " |")
    table = "\n".join(lines) + "\n"
    return page_table.check(docs, f"stages {machine}", table, update)


def self_test():
    functions = {1: ["now", "measure"], 2: ["get_u32", "receive"], 3: ["arc_tangent2"], 4: ["for_each_error_row", "channelwise_acceleration", "apply_law"],
                 5: ["bare"], 6: ["try_send", "transmit", "tick"]}
    first, second = [2] * 30 + [3] * 10 + [4, 3, 5] * 5 + [6] * 7, [4] * 50
    got = list(by_stage(functions, [5, 1, 5, 1, *first, 1, *[5] * 60, 1, *second, 1]))
    assert [{k: v for k, v in t.items() if v} for t in got] == [{"decode": 40, "law": 15, "encode": 7}, {"law": 50}], got
    assert bare("esmc::Controller<esmc::FiveBar<float> >::compute(esmc::Sample<int> const&)") == "compute"
    assert bare("unroll<2, esmc::f(int)::{lambda(auto:1)#1}>") == "unroll", bare("unroll<2, esmc::f(int)::{lambda(auto:1)#1}>")
    return 0


if __name__ == "__main__":
    words = [a for a in sys.argv[1:] if a not in ("--update", "--self-test")]
    sys.exit(self_test() if "--self-test" in sys.argv else stages(*words, "--update" in sys.argv))
