#!/usr/bin/python3
"""`esmc export` from outside: well-formed files, what they say and what they leave out, bad input, files in the way.
usage: export_test.py ESMC SCENES_DIR. What the files mean is judged by tests/peers/mujoco_test.py."""
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as xml
from pathlib import Path

failures = []


def expect(truth, what):
    if not truth:
        failures.append(what)


def main():
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    esmc, scenes = sys.argv[1], Path(sys.argv[2])
    circle, friction, arm = (scenes / f"{n}.toml" for n in ("five_bar_circle", "five_bar_friction", "rr_line"))

    def export(scene, *more):
        return subprocess.run([esmc, "export", str(scene), *map(str, more)], capture_output=True, text=True)

    def good(scene, form, *more):
        run = export(scene, "--format", form, *more)
        expect(run.returncode == 0 and not run.stderr, f"{scene.name} {form}: exit {run.returncode}: {run.stderr}")
        return run.stdout

    def bad(what, *arguments):
        run = export(*arguments)
        expect(run.returncode == 2 and not run.stdout and run.stderr.startswith("esmc: ") and run.stderr.count("\n") == 1 and
               what in run.stderr, f"{arguments}: exit {run.returncode}: {run.stderr}")

    for form in ("mjcf", "urdf"):  # characters that XML forbids
        xml.fromstring(good(circle, form, "--set", 'name="a\\uFFFE<b--"'))
    for scene, joints in ((circle, 4), (friction, 4), (arm, 2)):
        tree = xml.fromstring(good(scene, "mjcf"))
        expect(len(tree.findall(".//joint")) == joints, f"{scene.name}: joints of the MJCF")
        expect(len(tree.findall("./equality/connect")) == (1 if joints == 4 else 0), f"{scene.name}: closure of the MJCF")
        expect(len(tree.findall("./actuator/motor")) == 2, f"{scene.name}: motors")
        tree = xml.fromstring(good(scene, "urdf"))
        expect(len([j for j in tree.findall("joint") if j.get("type") == "continuous"]) == joints, f"{scene.name}: joints of the URDF")
        links = {e.get("name") for e in tree.findall("link")}
        children = [e.get("link") for e in tree.findall("./joint/child")]
        expect(len(set(children)) == len(children) and links - set(children) == {"world"}, f"{scene.name}: the URDF is no tree")
        expect(("effector_cut" in links) == (joints == 4), f"{scene.name}: the cut")

    expect("cannot express it: encoder.\n" in good(friction, "mjcf"), "MJCF says what it leaves out")
    expect("cannot express it: encoder, torque_saturation.\n" in good(friction, "urdf"), "URDF says what it leaves out")
    expect("Left out" not in good(circle, "mjcf"), "nothing is left out of the circle")
    both = good(circle, "mjcf", "--set", 'effects=[{type="compute_delay", time=1e-4}, {type="delay", ticks=1}]')
    expect("cannot express it: compute_delay, delay.\n" in both, "both delays are named")
    stops = xml.fromstring(good(circle, "mjcf", "--set", 'effects=[{type="end_stops", lower=[-1, -2], upper=[2, 3]}]'))
    ranges = [j.get("range") for j in stops.iter("joint") if j.get("name")]
    expect(ranges == ["-1 2", None, "-2 3", None], f"end stops: {ranges}")
    four = xml.fromstring(good(circle, "mjcf", "--set", 'control.motors="all"', "--set", "control.torque_limit=[1, 2, 3, 4]",
                               "--set", "drives.nodes=[1, 2, 3, 4]"))
    expect([m.get("joint") + m.get("ctrlrange") for m in four.iter("motor")] ==
           ["theta11-1 1", "theta12-2 2", "theta21-3 3", "theta22-4 4"], "four motors and their limits")
    nasty = '<&"\'--><!-- ---'
    for form in ("mjcf", "urdf"):
        tree = xml.fromstring(good(circle, form, "--set", "name=" + "'''" + nasty.replace("'", "") + "'''"))
        expect("<&" in (tree.get("model") or tree.get("name")), f"{form}: a name full of markup")

    bad("--format", circle)
    bad("mjcf", circle, "--format", "sdf")
    bad("no such scene file", "gone.toml", "--format", "mjcf")
    bad("m > 0 and J > 0", circle, "--format", "mjcf", "--set", "mechanism.leg.J2=0", "--set", "mechanism.leg.lg2=0.1")
    bad("lambda", circle, "--format", "urdf", "--set", "control.lambda=-1")
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        expect(good(arm, "mjcf", "--out", place / "arm.xml") == "", "--out prints nothing")
        expect((place / "arm.xml").read_text(encoding="utf-8") == good(arm, "mjcf"), "--out writes what else is printed")
        bad("not a regular file", arm, "--format", "mjcf", "--out", place)
        bad("cannot be written", arm, "--format", "mjcf", "--out", place / "none/arm.xml")
        expect(sorted(p.name for p in place.iterdir()) == ["arm.xml"], "nothing is left behind")
    for problem in failures:
        print(problem)
    print(f"{len(failures)} problems")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
