#!/usr/bin/python3
"""Signals, threads, arguments and files at the edge of what the Python module takes.
usage: edges_test.py ESMC MODULE_FOLDER [CLASS[.TEST] ...]"""
import concurrent.futures
import datetime
import json
import os
import pathlib
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
import types
import unittest

ESMC, FOLDER = sys.argv[1], sys.argv[2]
sys.path.insert(0, FOLDER)
import numpy as np  # noqa: E402

import esmc  # noqa: E402

SCENES = pathlib.Path(__file__).resolve().parents[2] / "host_sim/scenes"
CIRCLE, ARM = str(SCENES / "five_bar_circle.toml"), str(SCENES / "rr_line.toml")
ENDLESS = 1e5  # s: ends by a signal alone


def short(path=CIRCLE, duration=0.2):
    return esmc.Scene.load(path).set("simulation.duration", duration)


def scene_value(scene, table, key):
    return tomllib.loads(scene.toml)[table][key]


def endless():
    return short(CIRCLE, ENDLESS).set("reference.join", 0.1)


def interrupt(after=0.2):
    threading.Timer(after, os.kill, (os.getpid(), signal.SIGINT)).start()


def python(code, timeout=60):
    """A process of its own."""
    head = f"import sys; sys.path.insert(0, {FOLDER!r})\nimport esmc, os, threading, time\nCIRCLE = {CIRCLE!r}\n"
    return subprocess.run([sys.executable, "-c", head + code], capture_output=True, text=True, check=False, timeout=timeout)


class Signals(unittest.TestCase):
    def tearDown(self):
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def test_ctrl_c_ends_what_blocks_after_a_run(self):
        esmc.run(short())
        read, write = os.pipe()
        rescued = threading.Event()
        rescue = threading.Timer(10.0, lambda: (rescued.set(), os.write(write, b"x")))  # else a failure would block for ever
        rescue.start()
        interrupt()
        with self.assertRaises(KeyboardInterrupt):
            os.read(read, 1)
        rescue.cancel()
        self.assertFalse(rescued.is_set())

    def test_a_handler_of_the_user_runs_during_a_run(self):
        class Enough(Exception):
            pass

        def handler(*_):
            raise Enough

        signal.signal(signal.SIGINT, handler)
        for work in (lambda: esmc.run(endless()), lambda: esmc.run(endless(), mode="hil"), lambda: esmc.rollout(endless(), {}, n=2)):
            interrupt()
            with self.assertRaises(Enough):
                work()
        self.assertIs(signal.getsignal(signal.SIGINT), handler)

    def test_ctrl_c_while_other_threads_of_a_batch_have_all_the_work(self):
        with tempfile.TemporaryDirectory() as d:
            spec = pathlib.Path(d, "spec.toml")
            spec.write_text(f"""scene = "{CIRCLE}"
set = ["simulation.duration={ENDLESS}", "reference.join=0.1"]
[sample]
method = "latin_hypercube"
count = 1
[[vary]]
key = "control.gain"
from = 80.0
to = 90.0
""", encoding="utf-8")
            for work in ("esmc.rollout(s, {}, n=1, threads=5)", f"esmc.sweep({str(spec)!r}, threads=5)"):
                ended = python(f"""
import signal
s = esmc.Scene.load(CIRCLE).set("simulation.duration", {ENDLESS}).set("reference.join", 0.1)
threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
try: {work}
except KeyboardInterrupt: print("ended")""", 30)
                self.assertEqual(ended.stdout, "ended\n", ended.stderr)

    def test_a_handler_that_raises_nothing_cuts_nothing(self):
        calls, whole = [], esmc.run(short(CIRCLE, 300.0)).digest
        for handler in (lambda *_: calls.append(1), signal.SIG_IGN):
            signal.signal(signal.SIGINT, handler)
            interrupt(0.1)
            self.assertEqual(esmc.run(short(CIRCLE, 300.0)).digest, whole)
            time.sleep(0.2)  # should the run be over sooner
        self.assertEqual(calls, [1])

    def test_a_handler_cannot_call_the_module(self):
        signal.signal(signal.SIGINT, lambda *_: esmc.run(short()))
        interrupt()
        with self.assertRaisesRegex(esmc.RunError, "at work in this thread"):
            esmc.run(endless())
        esmc.run(short())

    def test_runs_of_other_threads_are_whole(self):
        scene, ticks, wrong = short(CIRCLE, 5.0), [], []
        stop = threading.Event()

        def work():
            while not stop.is_set():
                try:
                    ticks.append(esmc.run(scene).summary["ticks"])
                except BaseException as e:  # pylint: disable=broad-except
                    wrong.append(e)

        threads = [threading.Thread(target=work) for _ in range(3)]
        for thread in threads:
            thread.start()
        heard = 0
        for _ in range(40):
            try:
                os.kill(os.getpid(), signal.SIGINT)
                esmc.run(scene)  # the main thread waits for its turn, and hears
            except KeyboardInterrupt:
                heard += 1
            time.sleep(0.01)
        stop.set()
        for thread in threads:
            thread.join()
        self.assertEqual((heard, set(ticks), wrong), (40, {5000}, []))

    def test_daemon_threads_do_not_hold_up_the_end(self):
        code = """
s = esmc.Scene.load(CIRCLE).set("simulation.duration", 0.5)
def work():
    while True: esmc.run(s)
for _ in range(4): threading.Thread(target=work, daemon=True).start()
time.sleep(0.1)"""
        for _ in range(12):
            ended = python(code)
            self.assertEqual((ended.returncode, ended.stdout, ended.stderr), (0, "", ""))

    def test_child_of_a_fork_during_a_run_of_another_thread(self):
        ended = python("""
import signal
s = esmc.Scene.load(CIRCLE).set("simulation.duration", 0.2)
long = s.copy().set("simulation.duration", 1e5).set("reference.join", 0.1)
threading.Thread(target=esmc.run, args=(long,), daemon=True).start()
time.sleep(0.1)
child = os.fork()
if child == 0:
    signal.alarm(20)
    print(esmc.run(s).summary["ticks"], flush=True)
    sys.exit()
print(os.waitpid(child, 0)[1])""")
        self.assertEqual((ended.returncode, ended.stdout.split(), ended.stderr), (0, ["200", "0"], ""))


class Threads(unittest.TestCase):
    def test_a_call_is_of_the_scene_as_it_was_then(self):
        """Calls copy it before they wait for their turn, without the interpreter's lock, and so before another thread can change it."""
        scene = esmc.Scene.load(str(SCENES / "five_bar_pick_and_place.toml"))
        works = {"run": lambda: esmc.run(scene).digest, "plan": lambda: esmc.plan(scene).summary, "check": lambda: esmc.check(scene), "margins": lambda: esmc.margins(scene),
                 "rollout": lambda: list(esmc.rollout(scene, {"control.lambda": [30.0, 31.0]})["rms_m"])}
        before, got = {name: work() for name, work in works.items()}, {}
        threads = [threading.Thread(target=lambda n=n, w=w: got.update({n: w()})) for n, w in works.items()]

        def change():
            time.sleep(0.2)  # the endless run has its turn
            for thread in threads:
                thread.start()
            time.sleep(1.0)
            scene.set("control.torque_limit", 1.1).set("control.lambda", 25.0).set("control.gain", 77.0)
            os.kill(os.getpid(), signal.SIGINT)

        changer = threading.Thread(target=change)
        changer.start()
        with self.assertRaises(KeyboardInterrupt):
            esmc.run(endless())
        for thread in (changer, *threads):
            thread.join()
        self.assertEqual(got, before)
        for name, work in works.items():
            self.assertNotEqual(work(), before[name], name)


class Scenes(unittest.TestCase):
    def test_a_key_that_is_set_again_takes_the_place_of_the_former(self):
        scene = short()
        for k in range(300):
            scene.set("control.lambda", 20.0 + k).set("reference.center", [0.0, 0.17]).set("reference.center.2", 0.17 + 1e-6 * k)
        sets = scene.__reduce_ex__(2)[2][2]
        self.assertEqual(sets, ["simulation.duration=0.2", "control.lambda=319.0", "reference.center=[0.0, 0.17]", "reference.center.2=0.170299"])

    def test_sets_mean_what_they_mean_one_after_the_other(self):
        draw, seen = np.random.default_rng(2), 0
        values = {"control": [{"lambda": 30.0}, {"gain": 90.0, "lambda": 33.0}], "control.lambda": [40.0, 41.0, [20.0] * 18], "control.lambda.2": [50.0], "control.law": ["esmc", "ctc"],
                  "mechanism.leg.m1": [0.1, 0.11], "mechanism.legs.1.m1": [0.12, 0.13], "reference.type": ["hold", "circle"], "reference.radius": [0.05, 0.06],
                  "initial.at": ["reference"], "initial.joints": [[0.9, 1.1], [0.95, 1.1]], "simulation.step": [5e-4, 1e-3], "simulation.accuracy": [1e-3],
                  "effects": [[], [{"type": "noise", "sigma": 1e-4}]], "effects.1.sigma": [2e-4, 3e-4], "effects.1": [{"type": "noise", "sigma": 1e-5}]}
        for _ in range(150):
            scene, taken = esmc.Scene.load(CIRCLE), []
            for key in draw.choice(list(values), 12):
                value = values[key][draw.integers(len(values[key]))]
                text = f"{key}={json.dumps(value)}".replace('": ', '" = ')
                try:
                    scene.set(key, value)
                except esmc.InputError:
                    continue
                taken.append(text)
            state = esmc.Scene.load(CIRCLE).__reduce_ex__(2)[2]
            plain = esmc.Scene.__new__(esmc.Scene)
            plain.__setstate__((state[0], state[1], taken))
            self.assertEqual(scene.toml, plain.toml, taken)
            seen += len(taken)
        self.assertGreater(seen, 600)

    def test_an_edited_file_changes_nothing(self):
        with tempfile.TemporaryDirectory() as d:
            file = pathlib.Path(d, "scene.toml")
            file.write_text(short().toml, encoding="utf-8")
            scene = esmc.Scene.load(file)
            toml, digest, margins = scene.toml, esmc.run(scene).digest, esmc.margins(scene)
            old = scene_value(scene, "control", "lambda")
            rollout = esmc.rollout(scene, {"control.gain": [90.0, 95.0]})["rms_m"]
            for change in (lambda: file.write_text(short().set("control.lambda", 11.0).toml, encoding="utf-8"), file.unlink):
                change()
                for s in (scene, scene.copy(), pickle.loads(pickle.dumps(scene)), scene.copy().set("control.lambda", 41.0).set("control.lambda", old)):
                    self.assertEqual(esmc.run(s).digest, digest)
                    self.assertEqual(esmc.run(s, mode="hil").summary["ticks"], 200)
                    np.testing.assert_array_equal(esmc.rollout(s, {"control.gain": [90.0, 95.0]})["rms_m"], rollout)
                    self.assertEqual(esmc.check(s)["verdict"], esmc.check(short())["verdict"])
                    self.assertEqual(esmc.margins(s), margins)
                self.assertEqual(scene.toml, toml)

    def test_names_that_are_not_utf_8(self):
        with tempfile.TemporaryDirectory() as d:
            missing = os.fsencode(d) + b"/\xff.toml"
            with self.assertRaisesRegex(esmc.InputError, r"/\\xff\.toml: no such scene file"):
                esmc.Scene.load(missing)
            with open(missing, "w", encoding="utf-8") as f:
                f.write(short().toml)
            scene = esmc.Scene.load(missing)
            self.assertIn(r"\xff", repr(scene))
            self.assertEqual(esmc.run(pickle.loads(pickle.dumps(scene))).digest, esmc.run(short()).digest)
            with self.assertRaisesRegex(esmc.InputError, r"\\xff"):
                esmc.compare(missing, missing)


class Loop(unittest.TestCase):
    def test_encoders_sit_on_rotors(self):
        rotor = {"type": "joint_flexibility", "stiffness": 50.0, "damping": 0.02, "rotor_inertia": 1e-3}
        for path in (CIRCLE, ARM):
            for effects in ([rotor], [{"type": "backlash", "gap": 0.01, "stiffness": 50.0}], [rotor, {"type": "backlash", "gap": 0.01}]):
                scene = short(path).set("effects", effects)
                run, plant, controller = esmc.run(scene), esmc.Plant(scene), esmc.Controller(scene)
                apart = 0.0
                for _ in run.log["t"]:
                    apart = max(apart, np.abs(plant.shaft_angle - plant.angle).max())
                    plant.step(controller.tick(plant.shaft_angle, plant.shaft_rate).torque)
                self.assertEqual((list(plant.q), list(plant.qd)), (run.summary["final_state"]["q"], run.summary["final_state"]["qd"]), (path, effects))
                self.assertGreater(apart, 1e-5)
        plant = esmc.Plant(short())
        self.assertEqual((list(plant.shaft_angle), list(plant.shaft_rate)), (list(plant.angle), list(plant.rate)))

    def test_a_controller_can_be_enabled_again(self):
        scene = short()
        for before in ("stop", "reset"):
            plant, controller = esmc.Plant(scene), esmc.Controller(scene)
            states = []
            for command in ("none", "none", before, "none", "none", "none", "enable", "none", "none"):
                tick = controller.tick(plant.angle, plant.rate, command)
                states.append(tick.state)
                plant.step(tick.torque)
            self.assertEqual((states[0], states[-1]), ("running", "running"))
            self.assertIn("disabled" if before == "stop" else "running", states)

    def test_what_is_no_array_of_real_numbers(self):
        scene = short()
        plant, controller = esmc.Plant(scene), esmc.Controller(scene)
        before = plant.q
        bad = (["0.1", "0.2"], np.array(["0.1", "0.2"], object), [b"1", b"2"], np.array([1, 2], "M8[s]"), np.array([1, 2], "m8[s]"), [datetime.date(2020, 1, 1)] * 2, [1j, 0],
               np.array([1j, 0]), np.array([1j, 0], object), np.ma.array([0.1, 0.2], mask=[1, 0]), np.zeros(2, [("a", float)]), [None, 0.0], {"a": 1}, "01", [[0.1], [0.1, 0.2]], object())
        for value in bad:
            for what, case in (("torque", lambda v=value: plant.step(v)), ("angle", lambda v=value: controller.tick(v, [0.0] * 4)), ("rate", lambda v=value: controller.tick([1.0] * 4, v)),
                               ("torques", lambda v=value: esmc.rollout(scene, {}, torques=v[None, None] if isinstance(v, np.ndarray) else [[v] * 3]))):
                with self.assertRaisesRegex(esmc.InputError, "^" + what + ": ", msg=repr(value)):
                    case()
        np.testing.assert_array_equal(plant.q, before)
        for value in ([0, 1], (0.0, 1), np.array([0, 1], np.uint8), np.array([0, 1], object), np.array([[0, 1], [5, 6]])[0], np.array([0, 1], ">f4"), memoryview(np.array([0.0, 1.0]))):
            esmc.Plant(scene).step(value)

    def test_objects_without_a_value(self):
        for kind, use in ((esmc.Plant, lambda o: o.step([0, 0])), (esmc.Controller, lambda o: o.tick([0] * 4, [0] * 4)), (esmc.Run, lambda o: o.log), (esmc.Run, lambda o: o.summary),
                          (esmc.Run, repr), (esmc.Plan, lambda o: o.path), (esmc.Tick, lambda o: o.torque), (esmc.Scene, lambda o: o.toml), (esmc.Scene, esmc.run), (esmc.Scene, esmc.Plant),
                          (esmc.Scene, pickle.dumps), (esmc.Scene, repr)):
            with self.assertRaisesRegex(TypeError, "__new__ alone|incompatible"):
                use(kind.__new__(kind))


class Studies(unittest.TestCase):
    def test_model_at_a_pose_of_the_other_assembly_mode(self):
        scene = short()
        with self.assertRaisesRegex(esmc.InputError, "other assembly mode"):
            esmc.model(scene, {"x": 0.0, "y": 0.0})
        good = esmc.model(scene, {"theta": [0.9, 1.1]})["state"]
        again = esmc.model(scene, {"x": float(good["x"]), "y": float(good["y"])})["state"]
        np.testing.assert_allclose([again["x"], again["y"]], [good["x"], good["y"]], atol=1e-12)

    def test_states_that_would_not_be_used(self):
        five_bar, arm = short(), short(ARM)
        for scene, state in ((five_bar, {"theta": [0.9, 1.1], "xd": 1.0}), (five_bar, {"x": 0.0, "y": 0.2, "thetad": [0.1, 0.2]}), (five_bar, {"thetad": [0.1, 0.2]}),
                             (five_bar, {"y": 0.2}), (five_bar, {"x": 0.0, "theta": [0.9, 1.1]}), (arm, {"theta": [0.1, 0.2], "x": 1.0}), (five_bar, {"theta": [10**400, 1]}),
                             (arm, {"theta": [10**400, 1]}), (arm, {}), (five_bar, {})):
            with self.assertRaises(esmc.InputError, msg=str(state)) as caught:
                esmc.model(scene, state)
            self.assertNotIn("json", str(caught.exception))

    def test_mappings_and_sequences(self):
        scene = short()
        given = types.MappingProxyType({"control.gain": range(90, 94)})
        np.testing.assert_array_equal(esmc.rollout(scene, given)["rms_m"], esmc.rollout(scene, {"control.gain": [90, 91, 92, 93]})["rms_m"])
        quantised = short().set("effects", [{"type": "encoder", "bits": 12}])
        np.testing.assert_array_equal(esmc.rollout(quantised, {"effects.encoder.bits": list(np.arange(12, 14))})["rms_m"],
                                      esmc.rollout(quantised, {"effects.encoder.bits": [12, 13]})["rms_m"])
        state = types.MappingProxyType({"theta": (0.9, 1.1)})
        np.testing.assert_array_equal(esmc.model(scene, state)["model"]["H"], esmc.model(scene, dict(state))["model"]["H"])
        for text in ("ab", b"ab"):
            with self.assertRaisesRegex(esmc.InputError, "control.gain"):
                esmc.rollout(scene, {"control.gain": text})

    def test_tolerances_that_are_none(self):
        with tempfile.TemporaryDirectory() as d:
            for name in "ab":
                subprocess.run([ESMC, "sim", CIRCLE, "--set", "simulation.duration=0.02", "--out", f"{d}/{name}"], check=True, capture_output=True)
            for tolerance in (-1.0, float("nan"), float("inf")):
                with self.assertRaisesRegex(esmc.InputError, "tolerance"):
                    esmc.compare(d + "/a", d + "/b", tolerance)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=1)
