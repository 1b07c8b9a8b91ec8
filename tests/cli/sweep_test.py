#!/usr/bin/env python3
"""esmc sweep from outside: bad specifications, the same files whatever the number of threads and processes, a kill in the
middle and the same command again. Usage: sweep_test.py ESMC [sanitized] [--sample COUNT]"""

import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time

from command import CIRCLE as SCENE
from command import ESMC, MORE, PROGRAM, SAMPLE, esmc, read_table, sample, sets

SANITIZED = MORE == ["sanitized"]  # slow, and MPI has leaks of its own
N = 8 if SANITIZED else 240
ALONE = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMIX_", "PMI_"))}
failed = 0

GOOD = f"""scene = "{SCENE}"
set = ["simulation.duration=0.3", "simulation.step=1e-3"]
objectives = ["settled_rms_m", "torque_activity_nm", "energy_j", "faulted"]
pareto = [["settled_rms_m", "torque_activity_nm"]]
[sample]
method = "latin_hypercube"
count = {N}
[[vary]]
key = "plant.legs.1.m1"
factor = [0.8, 1.2]
[[vary]]
key = "control.gain"
from = 10.0
to = 400.0
log = true
[[vary]]
key = "control.law"
values = ["esmc", "ctc"]
cross = true
"""


def check(condition, what):
    global failed
    if not condition:
        failed += 1
        print(f"sweep_test: {what}")


def sweep(*arguments, status=0):
    r = esmc("sweep", *arguments, env=ALONE)
    check(r.returncode == status, f"{arguments}: status {r.returncode}, {r.stderr.strip()[:600]}")
    return r


def refused(folder, text, *wanted):
    """One line on stderr with these words, nothing on stdout, nothing left behind."""
    spec = folder / "bad.toml"
    spec.write_text(text, encoding="utf-8")
    out = folder / "refused"
    r = sweep(spec, "--out", out, status=2)
    check(r.stdout == "" and r.stderr.count("\n") == 1 and r.stderr.startswith("esmc: "), f"not one line: {r.stderr!r}")
    for w in wanted:
        check(w in r.stderr, f"{w!r} is not in {r.stderr!r}")
    check(not out.exists(), f"{out} was left behind for {wanted}")


def bad_specifications(folder):
    line = lambda what: f"bad.toml:{GOOD[: GOOD.index(what)].count(chr(10)) + 1}"
    change = lambda a, b: GOOD.replace(a, b, 1)
    refused(folder, change("objectives", "objektives"), line("objectives"), "did you mean objectives")
    refused(folder, change('"energy_j"', '"energy"'), "unknown objective 'energy'")
    refused(folder, change('"energy_j"', '"settled_rms_m"'), "none twice")
    refused(folder, change(f"count = {N}", "count = 0"), line(f"count = {N}"), "1 to 10000000")
    refused(folder, change(f"count = {N}", "count = 1000000000000"), "1 to 10000000")
    refused(folder, change(f"count = {N}", "count = 240.5"), "an integer")
    refused(folder, change(f"count = {N}", ""), "missing 'sample.count'")
    refused(folder, change('"latin_hypercube"', '"lhs"'), "grid | random | latin_hypercube")
    refused(folder, change('method = "latin_hypercube"', 'method = "grid"'), "leave out count")
    refused(folder, change("plant.legs.1.m1", "plant.legs.1.m7"), line("[[vary]]"), "m7")
    refused(folder, change("plant.legs.1.m1", "plant.legs.3.m1"), "plant.legs.3.m1")
    refused(folder, change("plant.legs.1.m1", "plant.mass"), "plant.mass")
    refused(folder, change("control.gain", "contrl.gain"), "contrl")
    refused(folder, change("control.gain", "effects.encoder.bits"), "effects")
    refused(folder, change("control.gain", "control.reaching"), "control.reaching = 10")
    refused(folder, change("control.gain", "plant.legs.1.m1"), "varies twice")
    both = '[[vary]]\nkey = "plant.leg.m1"\nfactor = [0.9, 1.1]\n'
    refused(folder, GOOD + both, "'plant.leg.m1' sets what 'plant.legs.1.m1'")
    refused(folder, GOOD + both.replace("plant.leg.m1", "control.gain.angle"), "'control.gain.angle' sets what 'control.gain'")
    friction = change('set = [', """set = ['effects=[{type="viscous_friction", coefficient=[0.01, 0.002]}]', """)
    twice = friction.replace("plant.legs.1.m1", "effects.viscous_friction.coefficient.1").replace("control.gain", "effects.1.coefficient.1")
    refused(folder, twice.replace("from = 10.0", "from = 0.01").replace("to = 400.0", "to = 0.1"), "'effects.1.coefficient.1' sets what 'effects.viscous_friction.coefficient.1'")
    refused(folder, change("[0.8, 1.2]", "[-0.8, 1.2]"), "m1")
    refused(folder, change("[0.8, 1.2]", "[0.8]"), "two numbers")
    refused(folder, change("[0.8, 1.2]", "[1.2, 0.8]"), "from < to")
    refused(folder, change("from = 10.0", "from = nan"), "a finite number")
    refused(folder, change("to = 400.0", "to = inf"), "a finite number")
    refused(folder, change("from = 10.0", "from = 0.0"), "log needs from > 0")
    refused(folder, change("to = 400.0\n", ""), "needs both from and to")
    refused(folder, change('"esmc", "ctc"', '"esmc", "esmc"'), "none twice")
    refused(folder, change('"esmc", "ctc"', '"esmc", "lqr"'), "control.law = lqr")
    refused(folder, change('values = ["esmc", "ctc"]', "values = []"), "1 to 100000 values")
    refused(folder, change("log = true", "log = true\nsteps = 5"), "steps goes with a grid")
    refused(folder, change("log = true", "log = true\ncross = true"), "steps says in how many points")
    refused(folder, change("log = true", "log = 1"), "true or false")
    refused(folder, change('["settled_rms_m", "torque_activity_nm"]]', '["settled_rms_m"]]'), "two or more")
    refused(folder, change('"torque_activity_nm"]]', '"max_m"]]'), "two or more of the objectives")
    refused(folder, change(str(SCENE), "nowhere.toml"), "nowhere.toml: no such scene file")
    refused(folder, change("simulation.step=1e-3", "simulation.stp=1"), line("set =") + ": --set simulation.stp=1: unknown key")
    refused(folder, change("simulation.step=1e-3", "simulation.step"), line("set =") + ": --set simulation.step: ")
    refused(folder, change('"settled_rms_m", "torque', '"settled_rms_k", "torque'), line("objectives =") + ": unknown objective")
    wrong = folder / "wrong.toml"  # errors of the scene file name its lines
    wrong.write_text(SCENE.read_text(encoding="utf-8").replace("[reference]", "[reference]\nspede = 1.0"), encoding="utf-8")
    at = wrong.read_text(encoding="utf-8").split("\n").index("spede = 1.0") + 1
    refused(folder, change(str(SCENE), "wrong.toml"), f"wrong.toml:{at}: unknown key 'reference.spede'")
    control = SCENE.read_text(encoding="utf-8").split("\n").index("[control]") + 1
    refused(folder, change('"esmc", "ctc"', '"esmc", "pd"'), f"{SCENE.name}:{control} with --set control.law='pd': ")
    grid = change('method = "latin_hypercube"\ncount = %d' % N, 'method = "grid"').replace("factor = [0.8, 1.2]", "factor = [0.8, 1.2]\nsteps = 90000")
    refused(folder, grid.replace("log = true", "log = true\nsteps = 90000"), "more than 10000000 cases")
    refused(folder, "scene = [", "not valid TOML")
    r = sweep(folder / "nowhere.toml", status=2)
    check("no such sweep specification" in r.stderr, r.stderr)


def same(a, b, what):
    for name in ("cases.csv", "summary.json", "report.html", "scene.toml", "sweep.toml"):
        check((a / name).read_bytes() == (b / name).read_bytes(), f"{what}: {name} differs")


def threads_and_processes(folder):
    spec = folder / "good.toml"
    one = folder / "one"
    sweep(spec, "--out", one, "--jobs", 1)
    check(sorted(f.name for f in one.iterdir()) == ["cases.csv", "report.html", "scene.toml", "summary.json", "sweep.toml", "timing.json"],
          f"files: {sorted(f.name for f in one.iterdir())}")
    sweep(spec, "--out", folder / "two", "--jobs", 2)
    same(one, folder / "two", "two threads")
    sweep(one / "sweep.toml", "--out", folder / "again")  # what is left there runs without the folder of the first
    for name in ("cases.csv", "summary.json", "scene.toml", "sweep.toml"):
        check((one / name).read_bytes() == (folder / "again" / name).read_bytes(), f"from its results: {name} differs")
    sweep(spec, "--out", folder / "scalar", "--jobs", 2, "--scalar")
    same(one, folder / "scalar", "without lanes")
    j = json.loads(sweep(spec, "--json").stdout)
    check(j == json.loads((one / "summary.json").read_text()), "--json is not summary.json")
    if SANITIZED:  # a plan takes minutes there
        return
    program = folder / "program.toml"  # timed anew for every limit: another reference in each lane
    program.write_text(f"""scene = "{PROGRAM}"
set = ["effects=[]", "simulation.duration=0.1"]
[sample]
method = "latin_hypercube"
count = 20
[[vary]]
key = "control.torque_limit"
from = 1.0
to = 1.5
""", encoding="utf-8")
    for out, *how in (("p1", "--jobs", 1), ("p2", "--jobs", 2), ("p3", "--scalar")):
        sweep(program, "--out", folder / out, *how)
        same(folder / "p1", folder / out, f"program {how}")
    module = pathlib.Path(ESMC).parent / "esmc_mpi.so"
    if not (shutil.which("mpirun") and module.exists()):
        check(not os.environ.get("CI"), "no MPI, and CI demands it")
        return print("sweep_test: MPI is not here, its part was left out")
    for n in (1, 2, 3):
        mpirun = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-n", str(n), ESMC, "sweep"]
        subprocess.run([*mpirun, spec, "--out", folder / f"mpi{n}"], capture_output=True, check=True, env=ALONE)
        same(one, folder / f"mpi{n}", f"{n} processes")
    bad = folder / "bad.toml"
    bad.write_text("scene = 1", encoding="utf-8")
    r = subprocess.run([*mpirun, bad], capture_output=True, text=True, check=False, timeout=60, env=ALONE)
    check(r.returncode != 0 and r.stderr.count("bad.toml:1") == 1, f"under mpirun: {r.stderr}")


def quantiles(folder):
    """Of two cases the median lies between them."""
    spec = folder / "two.toml"
    spec.write_text(f'scene = "{SCENE}"\nset = ["simulation.duration=0.1"]\n[sample]\nmethod = "grid"\n[[vary]]\nkey = "control.lambda"\nvalues = [10, 60]\n', encoding="utf-8")
    for one in json.loads(sweep(spec, "--json").stdout)["objectives"].values():
        check(one is None or abs(one["median"] - (one["min"] + one["max"]) / 2) <= 1e-12 * abs(one["max"]), f"median: {one}")


def what_the_table_says(folder):
    """A case of the table is what esmc sim says of that scene, and the design is what was asked for."""
    out = folder / "table"
    sweep(folder / "good.toml", "--out", out)
    rows = read_table(out / "cases.csv")
    check(len(rows) == 2 * N and [r["case"] for r in rows] == [str(i) for i in range(2 * N)], "rows of cases.csv")
    gains = sorted(float(r["control.gain"]) for r in rows[:N])
    check(all(10 * 40 ** (i / N) <= g * (1 + 1e-12) and g <= 10 * 40 ** ((i + 1) / N) * (1 + 1e-12) for i, g in enumerate(gains)), "strata of the gains")
    check({r["control.law"] for r in rows[:N]} == {"esmc"} and {r["control.law"] for r in rows[N:]} == {"ctc"}, "crossed")
    check([r["control.gain"] for r in rows[:N]] == [r["control.gain"] for r in rows[N:]], "the same samples for both")
    spec = folder / "believed.toml"
    text = GOOD.replace("plant.legs.1.m1", "mechanism.leg.m1").replace(f"count = {N}", "count = 3")
    spec.write_text(text, encoding="utf-8")
    sweep(spec, "--out", folder / "believed")
    for r in read_table(folder / "believed" / "cases.csv"):
        mass = float(r["mechanism.leg.m1"]) * 0.1
        s = json.loads(esmc("sim", SCENE, "--json", *sets("simulation.duration=0.3", "simulation.step=1e-3", f"mechanism.leg.m1={mass!r}",
                                                          f"control.gain={r['control.gain']}", f"control.law={r['control.law']}")).stdout)
        check(float(r["settled_rms_m"]) == s["tracking"]["settled_rms_m"], f"case {r['case']}: settled_rms_m")
        check(float(r["torque_activity_nm"]) == s["torque"]["mean_abs_delta_nm"], f"case {r['case']}: torque_activity_nm")
    summary = json.loads((out / "summary.json").read_text())
    front = summary["fronts"][0]["cases"]
    points = [(float(rows[i]["settled_rms_m"]), float(rows[i]["torque_activity_nm"])) for i in front]
    check(points == sorted(points) and all(a[1] > b[1] for a, b in zip(points, points[1:])), "the front is not one")
    for r in rows:
        p = (float(r["settled_rms_m"]), float(r["torque_activity_nm"]))
        check(any(q[0] <= p[0] and q[1] <= p[1] for q in points), f"case {r['case']} is beyond the front")
    check(sum(summary["outcomes"].values()) == 2 * N, "outcomes")


def kill_at_some_moment(spec, killed):
    with subprocess.Popen([ESMC, "sweep", spec, "--out", killed, "--scalar"], stdout=subprocess.DEVNULL, env=ALONE) as p:
        journal = killed / "sweep.journal"
        before = journal.stat().st_size if journal.exists() else 0
        for _ in range(3000):
            if p.poll() is not None or (journal.exists() and journal.stat().st_size > max(before, 100)):
                break
            time.sleep(0.01)
        p.send_signal(signal.SIGKILL)


def varied_files_belong_to_it(folder):
    """A file that only cases name: once it is another one, a journal is of another sweep; and it is not replaced."""
    text = pathlib.Path(SCENE).read_text(encoding="utf-8")
    (folder / "s.toml").write_text(text, encoding="utf-8")
    for name, length in (("one", 0.121), ("two", 0.119)):
        (folder / f"{name}.toml").write_text(text.replace("l1 = 0.12,", f"l1 = {length},"), encoding="utf-8")
    spec, out = folder / "files.toml", folder / "files"
    spec.write_text(f"""scene = "s.toml"
set = ["simulation.duration={0.3 if SANITIZED else 1.0}"]
objectives = ["settled_rms_m"]
[sample]
method = "grid"
[[vary]]
key = "control.model.mechanism"
values = ["one.toml", "two.toml"]
[[vary]]
key = "control.lambda"
values = [{", ".join(str(20.0 + 0.1 * i) for i in range(16 if SANITIZED else 400))}]
""", encoding="utf-8")
    kill_at_some_moment(spec, out)
    check((out / "sweep.journal").exists(), "it was over before the kill")
    before = (folder / "two.toml").read_text(encoding="utf-8")
    (folder / "two.toml").write_text(before.replace("l1 = 0.119,", "l1 = 0.118,"), encoding="utf-8")
    check("another sweep" in sweep(spec, "--out", out, status=2).stderr, "a varied file has changed")
    (folder / "two.toml").write_text(before, encoding="utf-8")
    check("cases were done before" in sweep(spec, "--out", out).stdout, "it did not go on")
    (out / "scene_model.toml").write_text(before, encoding="utf-8")
    spec.write_text(spec.read_text(encoding="utf-8").replace('"two.toml"', '"files/scene_model.toml"'), encoding="utf-8")
    check("scene_model.toml would replace" in sweep(spec, "--out", out, "--restart", status=2).stderr, "a varied file would be lost")
    check((out / "scene_model.toml").read_text(encoding="utf-8") == before, "a varied file is lost")


def kill_and_go_on(folder):
    """-9 at some moment, three times, then to the end."""
    spec, whole, killed = folder / "long.toml", folder / "whole", folder / "killed"
    count, duration = (16, 0.3) if SANITIZED else (400, 1)
    spec.write_text(GOOD.replace(f"count = {N}", f"count = {count}").replace("duration=0.3", f"duration={duration}"), encoding="utf-8")
    sweep(spec, "--out", whole)
    for _ in range(3):
        kill_at_some_moment(spec, killed)
    check((killed / "sweep.journal").exists(), "it was over before the kill")
    with (killed / "sweep.journal").open("ab") as f:
        f.write(b"\x07" * 11)
    changed = folder / "changed.toml"
    changed.write_text(spec.read_text().replace("0.8", "0.81"), encoding="utf-8")
    r = sweep(changed, "--out", killed, status=2)
    check("another sweep" in r.stderr and r.stderr.count("\n") == 1, r.stderr)
    r = sweep(spec, "--out", killed)
    check(f"of {2 * count} cases were done before" in r.stdout, "it did not go on")
    same(whole, killed, "after three kills")
    check(sorted(f.name for f in whole.iterdir()) == sorted(f.name for f in killed.iterdir()), "something is left of the killed ones")


def places_that_cannot_be_written(folder):
    spec, file = folder / "good.toml", folder / "file"
    file.write_text("")
    check("--out" in sweep(spec, "--out", file, status=2).stderr, "a file instead of a folder")
    if pathlib.Path("/dev/full").exists():
        r = subprocess.run([ESMC, "sweep", spec], stdout=open("/dev/full", "w"), stderr=subprocess.PIPE, text=True, check=False, env=ALONE)
        check(r.returncode == 1 and "standard output" in r.stderr, f"full stdout: {r.stderr}")


def what_is_not_its_own(folder):
    """A sweep replaces its own files and no others."""
    few = GOOD.replace(f"count = {N}", "count = 4").replace("duration=0.3", "duration=0.26")
    spec, out = folder / "few.toml", folder / "shared"
    spec.write_text(few, encoding="utf-8")
    mine = out / ".partial-mine" / "file"
    living = out / f".partial-{os.getpid()}" / "file"
    killed = subprocess.Popen(["true"])
    killed.wait()
    dead = out / f".partial-{killed.pid}" / "file"
    for f in (mine, living, dead):
        f.parent.mkdir(parents=True)
        f.write_text("precious")
    sweep(spec, "--out", out)
    check(mine.exists() and living.exists(), "a folder of somebody else was deleted")
    check(not dead.parent.exists(), "the rest of a killed process was left")

    link = folder / "dangling"
    link.symlink_to(folder / "not" / "mounted")
    sweep(spec, "--out", link, status=2)
    check(link.is_symlink(), "a link was deleted")

    own = folder / "own"
    own.mkdir()
    (own / "scene.toml").write_text(pathlib.Path(SCENE).read_text())
    (own / "study.toml").write_text(few.replace(str(SCENE), "scene.toml"), encoding="utf-8")
    before = (own / "scene.toml").read_bytes()
    check("no earlier run has left" in sweep(own / "study.toml", "--out", own, status=2).stderr, "a scene of somebody")
    (own / "summary.json").write_text("{}")
    check("would replace" in sweep(own / "study.toml", "--out", own, status=2).stderr, "its own scene")
    check((own / "scene.toml").read_bytes() == before, "its own scene was replaced")

    for name, options in (("text", []), ("text", ["--restart"]), ("link", ["--restart"])):
        there = folder / f"journal-{name}-{len(options)}"
        there.mkdir()
        victim = there / ("victim" if name == "link" else "sweep.journal")
        victim.write_text("hello")
        if name == "link":
            (there / "sweep.journal").symlink_to("victim")
        sweep(spec, "--out", there, *options, status=2)
        check(victim.read_text() == "hello", f"{name} {options}: a file that is no journal was overwritten")

    odd = folder / b"o\xff".decode("utf-8", "surrogateescape")
    sweep(spec, "--out", odd, "--json")
    check((odd / "cases.csv").exists(), "a name that is no UTF-8")

    spec.write_text(few + '[[vary]]\nkey = "simulation.duration"\nvalues = [0.3, 0.6]\ncross = true\n', encoding="utf-8")
    j = json.loads(sweep(spec, "--json").stdout)
    check(abs(j["simulated_s"] - 0.45 * j["cases"]) < 1e-9, f"simulated {j['simulated_s']} s in {j['cases']} cases")


def impossible_cases(folder):
    """A sample that makes no possible scene is an answer, not the end."""
    spec = folder / "impossible.toml"
    spec.write_text(GOOD.replace("plant.legs.1.m1", "plant.legs.1.l2").replace("[0.8, 1.2]", "[0.75, 1.0]").replace(f"count = {N}", "count = 40"), encoding="utf-8")
    j = json.loads(sweep(spec, "--json").stdout)
    check(0 < j["outcomes"].get("impossible", 0) < 80 and sum(j["outcomes"].values()) == 80, f"outcomes {j['outcomes']}")


def stated_accuracy(folder):
    """Cases of a stated accuracy have the errors of cases of a fine step; one that cannot be met is a case as well."""
    few = GOOD.replace(f"count = {N}", "count = 3")
    rows = {}
    for name, sets in (("fine", '"simulation.step=1e-4"'), ("stated", '"simulation.accuracy=1e-8"')):
        spec = folder / f"{name}.toml"
        spec.write_text(few.replace('"simulation.step=1e-3"', sets), encoding="utf-8")
        out = folder / name
        j = json.loads(sweep(spec, "--out", out, "--json").stdout)
        check(j["outcomes"] == {"ok": 6}, f"outcomes {j['outcomes']}")
        rows[name] = [float(r["settled_rms_m"]) for r in read_table(out / "cases.csv")]
    check(len(rows["fine"]) == 6 and all(abs(a - b) < 1e-10 for a, b in zip(rows["fine"], rows["stated"])), f"errors {rows}")
    spec.write_text(few.replace('"simulation.step=1e-3"', '"simulation.accuracy=1e-12", "control.reaching=sign", "control.gain=1e5"'), encoding="utf-8")
    j = json.loads(sweep(spec, "--json").stdout)
    check(j["outcomes"].get("inaccurate", 0) > 0, f"outcomes {j['outcomes']}")


PARTS = (bad_specifications, threads_and_processes, quantiles, what_the_table_says, impossible_cases, stated_accuracy, what_is_not_its_own, places_that_cannot_be_written,
         kill_and_go_on, varied_files_belong_to_it)

with tempfile.TemporaryDirectory() as scratch:
    here = pathlib.Path(scratch)
    (here / "good.toml").write_text(GOOD, encoding="utf-8")
    for part in sample.drawn(PARTS, SAMPLE, lambda p: p.__name__):
        part(here)
sys.exit(1 if failed else 0)
