#!/usr/bin/python3
"""`esmc export` from outside: well-formed files, what they say and what they leave out, bad input, files in the way.
usage: export_test.py ESMC. What the files mean is judged by tests/peers/mujoco_test.py."""
import xml.etree.ElementTree as xml

from command import ARM, CIRCLE, FRICTION, Case, esmc, main


class Export(Case):
    def good(self, scene, form, *more):
        run = esmc("export", scene, "--format", form, *more)
        self.assertEqual((run.returncode, run.stderr), (0, ""), (scene, form))
        return run.stdout

    def bad(self, what, *arguments):
        self.refused(esmc("export", *arguments), what)

    def test_files_are_well_formed_and_hold_what_they_must(self):
        for form in ("mjcf", "urdf"):  # characters that XML forbids
            xml.fromstring(self.good(CIRCLE, form, "--set", 'name="a\\uFFFE<b--"'))
        for scene, joints in ((CIRCLE, 4), (FRICTION, 4), (ARM, 2)):
            tree = xml.fromstring(self.good(scene, "mjcf"))
            self.assertTrue(len(tree.findall(".//joint")) == joints, f"{scene.name}: joints of the MJCF")
            self.assertTrue(len(tree.findall("./equality/connect")) == (1 if joints == 4 else 0), f"{scene.name}: closure of the MJCF")
            self.assertTrue(len(tree.findall("./actuator/motor")) == 2, f"{scene.name}: motors")
            tree = xml.fromstring(self.good(scene, "urdf"))
            self.assertTrue(len([j for j in tree.findall("joint") if j.get("type") == "continuous"]) == joints, f"{scene.name}: joints of the URDF")
            links = {e.get("name") for e in tree.findall("link")}
            children = [e.get("link") for e in tree.findall("./joint/child")]
            self.assertTrue(len(set(children)) == len(children) and links - set(children) == {"world"}, f"{scene.name}: the URDF is no tree")
            self.assertTrue(("effector_cut" in links) == (joints == 4), f"{scene.name}: the cut")

    def test_what_is_left_out_is_said(self):
        self.assertTrue("cannot express it: encoder.\n" in self.good(FRICTION, "mjcf"), "MJCF says what it leaves out")
        self.assertTrue("cannot express it: encoder, torque_saturation.\n" in self.good(FRICTION, "urdf"), "URDF says what it leaves out")
        self.assertTrue("Left out" not in self.good(CIRCLE, "mjcf"), "nothing is left out of the circle")
        both = self.good(CIRCLE, "mjcf", "--set", 'effects=[{type="compute_delay", time=1e-4}, {type="delay", ticks=1}]')
        self.assertTrue("cannot express it: compute_delay, delay.\n" in both, "both delays are named")
        stops = xml.fromstring(self.good(CIRCLE, "mjcf", "--set", 'effects=[{type="end_stops", lower=[-1, -2], upper=[2, 3]}]'))
        ranges = [j.get("range") for j in stops.iter("joint") if j.get("name")]
        self.assertTrue(ranges == ["-1 2", None, "-2 3", None], f"end stops: {ranges}")
        scene = self.tmp / "free.toml"
        scene.write_text("\n".join(line for line in CIRCLE.read_text(encoding="utf-8").splitlines() if not line.startswith("torque_limit")), encoding="utf-8")
        free = xml.fromstring(self.good(scene, "urdf", "--set", "control.law=open_loop", "--set", "control.torque=[{offset=0.1}, {offset=0.1}]", "--set",
                                        'effects=[{type="end_stops", lower=[-1, -2], upper=[2, 3]}]'))
        efforts = [float(e.get("effort")) for e in free.iter("limit")]
        self.assertTrue(len(efforts) == 2 and min(efforts) > 0, f"motors without a limit may drive: {efforts}")
        four = xml.fromstring(self.good(CIRCLE, "mjcf", "--set", 'control.motors="all"', "--set", "control.torque_limit=[1, 2, 3, 4]",
                                   "--set", "drives.nodes=[1, 2, 3, 4]"))
        self.assertTrue([m.get("joint") + m.get("ctrlrange") for m in four.iter("motor")] ==
               ["theta11-1 1", "theta12-2 2", "theta21-3 3", "theta22-4 4"], "four motors and their limits")
        wave = "control.torque=[{offset=9.0}, {offset=0.1}]"
        free = self.good(CIRCLE, "mjcf", "--set", "control.law=open_loop", "--set", wave, "--set", "simulation.step=0.02",
                         "--set", 'effects=[{type="coulomb_friction", torque=0.1, regularised=10.0}]')
        self.assertTrue("ctrlrange" not in free, "no controller limits these torques")
        self.assertTrue('timestep="0.001"' in free, "no step is longer than a tick")
        self.assertTrue("in the scene by tanh(rate / 10 rad/s)" in free, "dry friction is not rounded")
        nasty = '<&"\'--><!-- ---'
        for form in ("mjcf", "urdf"):
            tree = xml.fromstring(self.good(CIRCLE, form, "--set", "name=" + "'''" + nasty.replace("'", "") + "'''"))
            self.assertTrue("<&" in (tree.get("model") or tree.get("name")), f"{form}: a name full of markup")

    def test_what_is_refused(self):
        self.bad("--format", CIRCLE)
        self.bad("mjcf", CIRCLE, "--format", "sdf")
        self.bad("no such scene file", "gone.toml", "--format", "mjcf")
        self.bad("m > 0 and J > 0", CIRCLE, "--format", "mjcf", "--set", "mechanism.leg.J2=0", "--set", "mechanism.leg.lg2=0.1")
        self.bad("lambda", CIRCLE, "--format", "urdf", "--set", "control.lambda=-1")
        self.assertTrue(self.good(ARM, "mjcf", "--out", self.tmp / "arm.xml") == "", "--out prints nothing")
        self.assertTrue((self.tmp / "arm.xml").read_text(encoding="utf-8") == self.good(ARM, "mjcf"), "--out writes what else is printed")
        self.bad("not a regular file", ARM, "--format", "mjcf", "--out", self.tmp)
        self.bad("cannot be written", ARM, "--format", "mjcf", "--out", self.tmp / "none/arm.xml")
        self.assertTrue(sorted(p.name for p in self.tmp.iterdir()) == ["arm.xml"], "nothing is left behind")


if __name__ == "__main__":
    main()
