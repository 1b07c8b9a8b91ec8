#!/usr/bin/python3
"""The mechanisms that `esmc export` writes, in MuJoCo, against golden data of 25 digits. Python's standard library only.

usage: mujoco_test.py ESMC MUJOCO_READER REFERENCE_DIR

MJCF: joint names, start, effector; accelerations at random states under random motor torques, with viscous and Coulomb
friction; motions of two seconds. URDF: the torques of inverse dynamics, for the five-bar those of the two arms that
remain when the loop is cut, projected onto the motions of the closed loop.
MuJoCo closes a loop by a constraint that gives way a little. The error of accelerations must be small, must be in proportion to
that softness, and what is left at softness zero must be rounding. A sign or a frame that is written wrongly into the file
must be noticed: seeded errors come last."""
import json
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "golden"))
import trajectories  # noqa: E402

SOFT = 1e-4  # of the exported file: MuJoCo's smallest
ALLOWED = {"start": 1e-15, "effector": 1e-14, "open": 1e-12, "closed": 1e-3, "extrapolated": 1e-6, "inverse": 1e-12,
           "motion": 5e-6, "open motion": 1e-11}
failures = []
worst = {}


def judge(kind, name, error):
    worst[kind] = max(worst.get(kind, 0.0), error)
    if not error <= ALLOWED[kind]:
        failures.append(f"{name}: {kind} {error:.3g}, allowed {ALLOWED[kind]:.1g}")


def sign(x):
    return (x > 0) - (x < 0)


def scene_of_state(case):
    """The static case as the start of an open-loop scene, with its friction."""
    legs = case["params"].get("legs", [case["params"]])
    state = case["state"]
    whole = dict(case, id=case["id"], initial=dict(state), duration=1.0,
                 torque=[{"offset": 0.0, "terms": []}] * (4 if len(legs) == 2 else 2))
    bare = [{k: v for k, v in leg.items() if k not in ("c1", "c2")} | {"c1": 0, "c2": 0} for leg in legs]
    whole["params"] = dict(case["params"], legs=bare) if len(legs) == 2 else dict(bare[0])
    lines = trajectories.scene(whole).replace("accuracy = 1e-10", "step = 1e-5").splitlines()
    if len(legs) == 2:  # the state as it is, to the last bit, instead of through inverse kinematics
        lines = [x for x in lines if not x.startswith(("position =", "velocity ="))]
        at = lines.index("[initial]") + 1
        lines[at:at] = [f"joints = {trajectories.numbers(state['theta'])}",
                        f"joint_rates = {trajectories.numbers(state['thetad'])}"]
    for effect, key, names in (("viscous_friction", "coefficient", ("c1", "c2")), ("coulomb_friction", "torque", ("gamma1", "gamma2"))):
        values = [leg[n] for leg in legs for n in names]
        if key == "torque":  # the data have sign(0) = 0; MuJoCo holds a joint that rests, as friction does
            values = [v * abs(sign(rate)) for v, rate in zip(values, state["thetad"])]
        lines += ["[[effects]]", f'type = "{effect}"', f"{key} = {trajectories.numbers(values)}"]
    return "\n".join(lines) + "\n"


class Peer:
    """A scene, exported and loaded."""

    def __init__(self, esmc, reader, text, form, place, change=lambda exported: exported):
        scene, self.file = place / "scene.toml", place / f"scene.{form}"
        scene.write_text(text, encoding="utf-8")
        run = subprocess.run([esmc, "export", scene, "--format", form], capture_output=True, text=True)
        if run.returncode != 0:
            raise SystemExit(f"mujoco_test.py: esmc export: {run.stderr}")
        self.file.write_text(change(run.stdout), encoding="utf-8")
        self.reader = reader

    def ask(self, *questions):
        lines = "\n".join(" ".join(map(repr_number, q)) for q in questions) + "\n"
        run = subprocess.run([self.reader, self.file], input=lines, capture_output=True, text=True)
        if run.returncode != 0:
            raise SystemExit(f"mujoco_test.py: {run.stderr}")
        return [line.split() if q[0] == "names" else [float(x) for x in line.split()]
                for q, line in zip(questions, run.stdout.splitlines())]


def repr_number(x):
    return x if isinstance(x, str) else repr(x)


def distance(a, b):
    """Largest difference, relative to the largest of b, or to 1."""
    if len(a) != len(b):
        return float("inf")
    return max(abs(x - y) for x, y in zip(a, b)) / max(1.0, *(abs(y) for y in b))


def joint_accelerations(case):
    pdot = case["forward"]["pdot"]
    return pdot[2:4] + pdot[10:12] if "legs" in case["params"] else pdot[:2]


def accelerations(case, peer):
    """Errors at the file's softness, at ten times that, and extrapolated to none."""
    s, want = case["state"], joint_accelerations(case)
    tau = case["forward"].get("tau4") or case["forward"]["tau"]
    found = peer.ask(*(["forward", soft, *s["theta"], *s["thetad"], *tau] for soft in (SOFT, 10 * SOFT)))
    limit = [a + (a - b) / 9.0 for a, b in zip(*found)]
    return distance(found[0], want), distance(found[1], want), distance(limit, want)


def static_case(case, esmc, reader, place):
    s, loop = case["state"], "legs" in case["params"]
    peer = Peer(esmc, reader, scene_of_state(case), "mjcf", place)
    names, start, effector = peer.ask(["names"], ["start"], ["effector", *s["theta"]])
    if names != (["theta11", "theta12", "theta21", "theta22"] if loop else ["theta1", "theta2"]):
        failures.append(f"{case['id']}: joints {names}")
    judge("start", case["id"], distance(start, [*s["theta"], *s["thetad"]]))
    if loop:
        judge("effector", case["id"], distance(effector, [s["x"], s["y"]]))
    else:
        judge("effector", case["id"], distance(effector, case["effector"]["pos"]))
    error, softer, extrapolated = accelerations(case, peer)
    if not loop:
        judge("open", case["id"], error)
    else:
        judge("closed", case["id"], error)
        judge("extrapolated", case["id"], extrapolated)
        if error > 1e-7 and not 8 < softer / error < 12:
            failures.append(f"{case['id']}: ten times softer is {softer / error:.3g} times wrong, not 10 times")


def inverse_case(case, esmc, reader, place):
    s, inverse, loop = case["state"], case["inverse"], "legs" in case["params"]
    legs = case["params"]["legs"] if loop else [case["params"]]
    viscous, dry = ([leg[n] for leg in legs for n in names] for names in (("c1", "c2"), ("gamma1", "gamma2")))
    peer = Peer(esmc, reader, scene_of_state(case), "urdf", place)
    rates = s["thetad"]
    wanted = inverse["pdot"][2:4] + inverse["pdot"][10:12] if loop else inverse["thetadd"]
    friction, _, tau = peer.ask(["friction"], ["gravity", case["params"]["g"]], ["inverse", *s["theta"], *rates, *wanted])
    judge("start", case["id"], distance(friction, [*viscous, *(g * abs(sign(rate)) for g, rate in zip(dry, rates))]))
    tau = [t + g * sign(rate) for t, g, rate in zip(tau, dry, rates)]
    if loop:
        chat = case["model"]["Chat"][2:6]
        judge("inverse", case["id"], distance([sum(row[k] * t for row, t in zip(chat, tau)) for k in (0, 1)], inverse["F"]))
    else:
        judge("inverse", case["id"], distance(tau, inverse["tau"]))


def motion_case(case, esmc, reader, place):
    loop, last = "legs" in case["params"], len(case["t"]) - 1
    text = trajectories.scene(case).replace("accuracy = 1e-10", "step = 1e-4")
    peer = Peer(esmc, reader, text, "mjcf", place)
    waves = [x for w in case["torque"] for x in
             (w["offset"], len(w["terms"]), *(t[k] for t in w["terms"] for k in ("amp", "omega", "phase")))]
    (states,) = peer.ask(["run", case["t"][last], last, *waves])
    n = len(case["theta"][0])
    error = max(abs(a - b) for i, want in enumerate(case["theta"]) for a, b in zip(states[i * n:(i + 1) * n], want))
    judge("motion" if loop else "open motion", case["id"], error)


def seeded(case, esmc, reader, place):
    """What a wrong file looks like."""
    changes = {
        "leg 2 not mirrored": lambda t: t.replace(' quat="0 0 1 0"', ""),
        "gravity upwards": lambda t: t.replace('gravity="0 0 -', 'gravity="0 0 '),
        "gravity along y": lambda t: t.replace('quat="0.7071067811865476 0.7071067811865476 0 0"', ""),
        "loop open": lambda t: t[:t.index("<equality>")] + t[t.index("</equality>") + 11:],
        "one axis turned": lambda t: t.replace('name="theta22" type="hinge" axis="0 0 1"', 'name="theta22" type="hinge" axis="0 0 -1"'),
        "effector without mass": lambda t: t[:t.index('<body name="effector_mass"')] + t[t.index("</body>") + 7:],
        "no dry friction": lambda t: t.replace("frictionloss=", "margin=", 1),
        "motors exchanged": lambda t: t.replace('name="motor1" joint="theta11"', 'name="motor1" joint="theta12"'),
    }
    for name, change in changes.items():
        peer = Peer(esmc, reader, scene_of_state(case), "mjcf", place, change)
        if peer.file.read_text(encoding="utf-8") == Peer(esmc, reader, scene_of_state(case), "mjcf", place / "clean").file.read_text(encoding="utf-8"):
            failures.append(f"seeded error '{name}' changes nothing in the file")
        elif accelerations(case, peer)[0] <= ALLOWED["closed"]:
            failures.append(f"seeded error '{name}' goes unnoticed")
    return len(changes)


def main():
    if len(sys.argv) != 4:
        print(__doc__, file=sys.stderr)
        return 2
    esmc, reader, reference = sys.argv[1], sys.argv[2], Path(sys.argv[3])
    cases = lambda name: json.loads((reference / f"{name}.json").read_text(encoding="utf-8"))["cases"]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "clean").mkdir()
        static = cases("rr_static") + cases("fiver_static")
        for case in static:
            static_case(case, esmc, reader, place)
            inverse_case(case, esmc, reader, place)
        moving = [c for c in cases("rr_traj") + cases("fiver_traj") if c["duration"] == 2]
        for case in moving:
            motion_case(case, esmc, reader, place)
        errors = seeded(cases("fiver_static")[0], esmc, reader, place)
    for problem in failures:
        print(problem)
    print("worst: " + ", ".join(f"{k} {v:.2g}" for k, v in worst.items()))
    print(f"{len(static)} states, {len(moving)} motions, {errors} seeded errors, {len(failures)} problems")
    return 1 if failures or not static or not moving else 0


if __name__ == "__main__":
    sys.exit(main())
