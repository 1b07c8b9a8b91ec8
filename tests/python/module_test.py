#!/usr/bin/python3
"""The Python module against the command. usage: module_test.py ESMC MODULE_FOLDER [study] [CLASS[.TEST] ...]
study: 1e6 runs for the memory, 1e5 arguments for the fuzzer"""
import collections
import concurrent.futures
import contextlib
import copy
import csv
import io
import json
import multiprocessing
import os
import pathlib
import pickle
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
import unittest

ESMC, FOLDER = sys.argv[1], sys.argv[2]
STUDY = "study" in sys.argv[3:]
sys.path.insert(0, FOLDER)
import numpy as np  # noqa: E402

import esmc  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCENES = ROOT / "host_sim/scenes"
CIRCLE = str(SCENES / "five_bar_circle.toml")
ARM = str(SCENES / "rr_line.toml")


def short(path, duration=0.2):
    return esmc.Scene.load(str(path)).set("simulation.duration", duration)


def command(*arguments):
    run = subprocess.run([ESMC, *arguments, "--json"], capture_output=True, text=True, check=False)
    return json.loads(run.stdout)


def digest_of(scene):
    return esmc.run(scene).digest


def variants():
    """50 runs: scenes, laws, modes, effects, both ways of running."""
    shared = [("control.law", "ctc"), ("control.law", "smc"), ("control.lambda", 31.5), ("control.reaching", "tanh"),
              ("effects", [{"type": "viscous_friction", "coefficient": [1e-3, 2e-3]}]),
              ("effects", [{"type": "encoder", "bits": 13}]), ("control.torque_limit", 1.5), ("control.rate_hz", 500)]
    for path in (CIRCLE, ARM):
        for key, value in shared:
            yield path, [(key, value)], "sim"
            yield path, [(key, value), ("initial.joints" if path == ARM else "reference.phase", [0.4, 1.2] if path == ARM else 0.3)], "sim"
            if key != "effects" or value[0]["type"] != "encoder":
                yield path, [(key, value)], "hil"
    for path in sorted(SCENES.glob("*.toml")):
        if path.name not in ("five_bar_circle.toml", "rr_line.toml"):
            yield str(path), [], "sim"


def batch_scenes():
    """Scenes for random batches, each with keys of its own. Of most a value moves more than the field that it sets: a plan, a belief, a rotor, a check."""
    circle, program = short(CIRCLE, 0.04), short(SCENES / "five_bar_pick_and_place.toml", 0.04)
    angle = esmc.Plant(circle).angle[[0, 2]]
    stops = [{"type": "end_stops", "lower": list(angle - 1.0), "upper": list(angle + 0.02)}]
    heavy = tomllib.loads(circle.toml)["mechanism"]
    heavy["leg"]["m1"] = 0.12
    legs = {"mechanism.legs.2.l1": (0.119, 0.121, 1e-3), "mechanism.legs.1.J2": (6e-4, 8e-4, -1.0)}
    return [
        (circle, {"reference.radius": (0.065, 0.072, 0.5), "reference.phase": (0.0, 1.0, 1e9), "reference.center.2": (0.168, 0.171, 9.0), **legs}),
        (program.copy().set("effects", []), {"uncertainty.m1": (0.02, 0.08, 2.0), "reference.moves.2.to.2": (0.17, 0.178, 9.0), "mechanism.half_base": (0.049, 0.051, 0.0)}),
        (circle.copy().set("control.predictor", True).set("control.delay_ticks", 1), {"control.predictor": [True, False]}),
        (circle.copy().set("control.model.mechanism", heavy), {"mechanism.half_base": (0.0498, 0.0502, 0.0), "control.model.mechanism.leg.m1": (0.09, 0.12, -1.0)}),
        (circle.copy().set("mechanism.rotor_inertia", [1e-4, 2e-4]), {"plant.rotor_inertia.1": (0.0, 1e-3, -1.0), "mechanism.rotor_inertia.2": (0.0, 1e-3, -1.0)}),
        (circle.copy().set("mechanism.rotor_inertia", [1e-4, 2e-4, 1e-4, 2e-4]), {"mechanism.rotor_inertia.2": (0.0, 1e-3, -1.0)}),
        (circle.copy().set("effects", stops), {"effects.end_stops.upper.1": (angle[0] + 1e-3, angle[0] + 0.03, angle[0] - 0.1), "reference.phase": (-0.02, 0.1, 2.0)}),
        (circle.copy().set("effects", [{"type": "noise", "sigma": 1e-5}]).set("initial", {"joints": list(angle)}), {"initial.joints.1": (angle[0] - 0.02, angle[0], 9.0), "effects.noise.sigma": (0.0, 1e-4, -1.0)}),
        (short(SCENES / "five_bar_super_twisting.toml", 0.04), {"effects.viscous_friction.coefficient.1": (0.0, 0.01, -1.0)}),
        (short(SCENES / "five_bar_robust.toml", 0.04).set("control.gain", 80.0), {"mechanism.effector_mass": (0.0, 0.1, -1.0), "uncertainty.m1": (0.02, 0.08, 2.0)}),
        (short(ARM, 0.04).set("mechanism.rotor_inertia", [0.02, 0.01]), {"mechanism.rotor_inertia.2": (0.0, 0.02, -1.0)}),
    ]


def random_parameters(draw, scene, own, n):
    """1 to 4 keys with n values each, one in ten of them bad."""
    leg = tomllib.loads(scene.toml)["mechanism"]["leg"]
    keys = {"control.lambda": (20.0, 60.0, -1.0), "control.gain": (50.0, 150.0, -1.0), "control.layer": (0.01, 0.1, 0.0), "control.torque_limit": (1.2, 2.0, 0.0), "limits.joint_speed": (20.0, 90.0, 0.0),
            "control.law": ["esmc", "smc", "ctc", "esmc_projected", "lqr"], "control.delay_ticks": [0.0, 1.0, 2.0, 1.64, -1.0], "control.rate_hz": [1000.0, 500.0, 0.0], "simulation.step": [1e-3, 5e-4, 0.0],
            "mechanism.gravity": (9.0, 10.0, -1.0), "plant.gravity": (9.0, 10.0, -1.0), "control.model.m1": (0.9, 1.1, -1.0), "control.model.gravity": (0.9, 1.1, -1.0), "control.model.J2": (0.9, 1.1, 0.0)}
    for side in ("mechanism", "plant"):
        keys.update({f"{side}.leg.{name}": (0.98 * leg[name], 1.02 * leg[name], bad) for name, bad in (("m1", -1.0), ("m2", -1.0), ("J1", 0.0), ("J2", 0.0), ("l1", 1e-3))})
    out = {}
    for key in draw.sample(list(keys), draw.randrange(1, 4)) + draw.sample(list(own), draw.randrange(2)):
        if ".legs." in key and any(".leg." in k for k in out) or ".leg." in key and any(".legs." in k for k in out):
            continue  # they set the same, which is refused
        how = keys.get(key) or own[key]
        if isinstance(how, list):
            out[key] = [draw.choice(how) for _ in range(n)]
        else:
            out[key] = [how[2] if draw.random() < 0.1 else draw.uniform(*how[:2]) for _ in range(n)]
    return out


def settings_of(scene, case):
    """The scene with all settings of a case at once; None: it is refused. plant.: the controller believes the scene without it."""
    def with_sets(s, more):
        *where, sets = s.__getstate__()
        out = esmc.Scene.__new__(esmc.Scene)
        out.__setstate__((*where, sets + [f"{key}={json.dumps(v)}" for key, v in more.items()]))
        return out
    try:
        out = with_sets(scene, {key: v for key, v in case.items() if not key.startswith("plant.")})
        true = {"mechanism" + key[5:]: v for key, v in case.items() if key.startswith("plant.")}
        if true and "mechanism" not in tomllib.loads(out.toml)["control"].get("model", {}):
            out.set("control.model.mechanism", tomllib.loads(out.toml)["mechanism"])
        return with_sets(out, true)
    except esmc.InputError:
        return None


def single_run(scene, case, seed):
    """Outcome and objectives of a case by `run`."""
    alone = settings_of(scene, case)
    try:
        summary = esmc.run(alone, seed=seed).summary if alone else None
    except esmc.InputError:
        summary = None
    except esmc.RunError:
        return "diverged", {}
    if summary is None:
        return "impossible", {}
    faults = summary["supervisor"]["faults"]
    of = {"tracking": ["rms_m", "max_m", "settled_rms_m", "settled_max_m", "rms_rad", "max_rad", "settled_rms_rad", "settled_max_rad"], "torque": ["saturated_ticks"]}
    figures = {name: summary[part].get(name) for part, names in of.items() for name in names}
    figures.update(torque_max_nm=summary["torque"]["max_nm"], torque_activity_nm=summary["torque"]["mean_abs_delta_nm"])
    return faults[0]["name"] if faults else "ok", {name: np.nan if v is None else v for name, v in figures.items()}


class Runs(unittest.TestCase):
    def test_digests_are_those_of_the_command(self):
        seen = set()
        cases = list(variants())[:50]
        for path, changes, mode in cases:
            scene = short(path)
            for key, value in changes:
                scene.set(key, value)
            with tempfile.NamedTemporaryFile("w", suffix=".toml", dir=SCENES if "effects" not in str(changes) else None) as f:
                f.write(scene.toml)
                f.flush()
                try:
                    ours = esmc.run(scene, mode=mode, seed=3)
                except esmc.InputError as e:
                    told = subprocess.run([ESMC, mode, f.name, "--seed", "3"], capture_output=True, text=True, check=False)
                    self.assertEqual(told.returncode, 2, (path, changes, e))
                    continue
                theirs = command(mode, f.name, "--seed", "3")
            self.assertEqual(ours.digest, theirs["digest"], (path, changes, mode))
            for timed in ("wall_s", "real_time_factor", "run"):
                ours.summary.pop(timed, None), theirs.pop(timed, None)
            self.assertEqual(json.dumps(ours.summary), json.dumps(theirs))
            seen.add(ours.digest)
        self.assertEqual(len(cases), 50)
        self.assertGreater(len(seen), 40)

    def test_log_is_the_file_without_a_copy(self):
        with tempfile.TemporaryDirectory() as out:
            subprocess.run([ESMC, "sim", CIRCLE, "--set", "simulation.duration=0.2", "--out", out + "/x"], check=True, capture_output=True)
            with open(out + "/x/log.csv", newline="", encoding="ascii") as f:
                head, *rows = list(csv.reader(f))
        run = esmc.run(short(CIRCLE))
        log = run.log
        self.assertEqual(list(log), head)
        for i, name in enumerate(head[:-1]):
            np.testing.assert_array_equal(log[name], [float(r[i]) for r in rows])
        self.assertEqual(list(log["state"]), [r[-1] for r in rows])
        self.assertTrue(np.shares_memory(log["x"], run.log["x"]))
        x = log["x"]
        kept = x.copy()
        del run, log
        np.testing.assert_array_equal(x, kept)  # the view keeps the run alive

    def test_controller_and_plant_make_the_run(self):
        for path in (CIRCLE, ARM):
            scene = short(path)
            log, plant, controller = esmc.run(scene).log, esmc.Plant(scene), esmc.Controller(scene)
            angles = []
            for _ in log["t"]:
                angles.append(plant.angle)
                tick = controller.tick(plant.angle, plant.rate)
                plant.step(tick.torque)
            for i, name in enumerate(scene.joints):
                np.testing.assert_array_equal(log[name], np.array(angles)[:, i])
            np.testing.assert_array_equal(plant.q, esmc.run(scene).summary["final_state"]["q"])

    def test_a_fault_is_a_result(self):
        run = esmc.run(short(CIRCLE).set("limits.joint_speed", 5.0))
        self.assertEqual(run.summary["supervisor"]["faults"][0]["name"], "joint_speed")
        controller = esmc.Controller(short(CIRCLE))
        bad = controller.tick([np.nan] * 4, [0] * 4)
        self.assertEqual((bad.fault, list(bad.torque)), ("feedback_not_finite", [0.0, 0.0]))

    def test_the_lock_is_free_during_a_run(self):
        count, stop = [0], threading.Event()

        def counting():
            while not stop.is_set():
                count[0] += 1

        thread = threading.Thread(target=counting)
        thread.start()
        before = count[0]
        esmc.run(short(CIRCLE, 20.0))
        counted = count[0] - before
        stop.set()
        thread.join()
        self.assertGreater(counted, 1000)

    def test_ctrl_c(self):
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        with self.assertRaises(KeyboardInterrupt):
            esmc.run(short(CIRCLE, 1e5).set("reference.join", 0.1))
        esmc.run(short(CIRCLE))  # and goes on


class Habits(unittest.TestCase):
    """What a user of numpy writes without thinking."""

    def test_paths_and_another_working_directory(self):
        path = pathlib.Path(CIRCLE)
        wanted, here = esmc.run(short(CIRCLE)).digest, os.getcwd()
        try:
            os.chdir(path.parent)
            scene = esmc.Scene.load(pathlib.Path(path.name)).set("simulation.duration", 0.2)
            os.chdir("/")
            for s in (scene, scene.copy(), copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))):
                self.assertEqual(esmc.run(s).digest, wanted)
        finally:
            os.chdir(here)
        with self.assertRaisesRegex(esmc.InputError, "no_such"):
            esmc.sweep(path.with_name("no_such.toml"))
        with self.assertRaisesRegex(esmc.InputError, "no_such"):
            esmc.compare(path.with_name("no_such"), path)

    def test_arrays_of_any_kind(self):
        scene = short(CIRCLE)
        wide = np.arange(8.0).reshape(2, 4) / 16
        for given in ([0, 0.25], (0, 0.25), wide[:, 0], np.array([0, 0.25], np.float32), np.array([0, 0.25], object)):
            plants = [esmc.Plant(scene), esmc.Plant(scene)]
            plants[0].step(given)
            plants[1].step(np.array([0.0, 0.25]))
            np.testing.assert_array_equal(plants[0].q, plants[1].q)
        values = np.linspace(20, 40, 8)
        some = [esmc.rollout(scene, {"control.lambda": v}) for v in (values[::2], list(values[::2]), list(values)[::2], values.astype(np.float64, order="F")[::2])]
        for other in some[1:]:
            np.testing.assert_array_equal(some[0]["rms_m"], other["rms_m"])

    def test_values_that_are_not_finite_are_bad_input(self):
        scene, n = short(CIRCLE), float("nan")
        plant = esmc.Plant(scene)
        before = plant.q
        for what, case in (("control.lambda", lambda: scene.set("control.lambda", n)), ("reference.center", lambda: scene.set("reference.center", [0.0, n])),
                           ("control.lambda", lambda: esmc.rollout(scene, {"control.lambda": [20.0, n]})), ("control.lambda", lambda: esmc.rollout(scene, {"control.lambda": (n, 3.0)})),
                           ("torque", lambda: plant.step([n, 0.0])), ("torques", lambda: esmc.rollout(scene, {}, torques=np.full((1, 2, 2), n))),
                           ("state", lambda: esmc.model(scene, {"theta": [n, 1.0]}))):
            with self.assertRaisesRegex(esmc.InputError, what):
                case()
        np.testing.assert_array_equal(plant.q, before)

    def test_wrong_shapes_and_words_are_named(self):
        scene = short(CIRCLE)
        for what, case in (("control.lambda", lambda: esmc.rollout(scene, {"control.lambda": np.ones((2, 2))})), ("torque", lambda: esmc.Plant(scene).step(np.zeros((2, 1)))),
                           ("angle", lambda: esmc.Controller(scene).tick(1.0, [0.0] * 4)), ("thetadot", lambda: esmc.model(scene, {"theta": [0.9, 1.1], "thetadot": [0, 0]})),
                           (r'as in \["\+", "\+"\]$', lambda: scene.set("mechanism.working_mode", "+"))):
            with self.assertRaisesRegex(esmc.InputError, what):
                case()

    def test_examples_of_the_page_run_in_their_order(self):
        blocks, names = re.findall(r"```python\n(.*?)```", (ROOT / "docs/python.md").read_text(encoding="utf-8"), re.S), {}
        self.assertGreaterEqual(len(blocks), 4)
        with contextlib.chdir(ROOT), contextlib.redirect_stdout(io.StringIO()) as said:
            for block in blocks:
                exec(block, names)  # pylint: disable=exec-used
        self.assertIn(names["run"].digest, said.getvalue())
        np.testing.assert_array_equal(names["yours"].q, names["run"].summary["final_state"]["q"])

    def test_threads_and_processes(self):
        scene = short(CIRCLE)
        wanted = esmc.run(scene).digest
        with concurrent.futures.ThreadPoolExecutor(4) as pool:
            self.assertEqual({run.digest for run in pool.map(esmc.run, [scene.copy() for _ in range(12)])}, {wanted})
        with multiprocessing.get_context("fork").Pool(2) as pool:
            self.assertEqual(set(pool.map(digest_of, [scene] * 4)), {wanted})

    def test_texts_in_a_prompt(self):
        scene = short(CIRCLE)
        run, plant = esmc.run(scene), esmc.Plant(scene)
        self.assertIn(run.digest, repr(run))
        self.assertIn("running", repr(esmc.Controller(scene).tick(plant.angle, plant.rate)))


class Studies(unittest.TestCase):
    def test_check_margins_compare(self):
        scene = esmc.Scene.load(CIRCLE)
        self.assertEqual(esmc.check(scene), command("check", CIRCLE))
        self.assertEqual(esmc.margins(scene), command("margins", CIRCLE))
        unfit = esmc.check(scene.copy().set("control.torque_limit", 0.25))
        self.assertEqual(unfit["verdict"], "unfit")
        with tempfile.TemporaryDirectory() as out:
            for name, law in (("a", "esmc"), ("b", "ctc")):
                subprocess.run([ESMC, "sim", CIRCLE, "--set", f"control.law={law}", "--out", f"{out}/{name}"], check=True, capture_output=True)
            self.assertEqual(esmc.compare(f"{out}/a", f"{out}/b"), command("compare", f"{out}/a", f"{out}/b"))

    def test_model_by_other_means(self):
        scene = esmc.Scene.load(CIRCLE)
        base, rate = np.array([0.9, 1.1]), np.array([0.7, -0.4])
        m = esmc.model(scene, {"theta": base, "thetad": rate})["model"]
        np.testing.assert_allclose(m["A"] @ m["C"], 0, atol=1e-12)
        np.testing.assert_allclose(m["C"].T @ np.diag(m["M_diag"]) @ m["C"], m["H"], rtol=1e-12)
        self.assertTrue(np.all(np.linalg.eigvalsh(m["H"]) > 0))
        # The velocity of the effector, from two poses.
        def at(q):
            s = esmc.model(scene, {"theta": q})["state"]
            return np.array([float(s["x"]), float(s["y"])])
        step = 1e-6
        moved = (at(base + step * rate) - at(base - step * rate)) / (2 * step)
        state = esmc.model(scene, {"x": at(base)[0], "y": at(base)[1], "xd": moved[0], "yd": moved[1]})["state"]
        np.testing.assert_allclose(np.asarray(state["thetad"])[[0, 2]], rate, atol=1e-7)
        arm = esmc.model(esmc.Scene.load(ARM), {"theta": [0.4, 1.2]})["model"]
        np.testing.assert_allclose(arm["A"] @ arm["C"], 0, atol=1e-12)

    def test_model_is_the_plant(self):
        """A step of the plant from a moving state, and H v' = C^T F - h of the model: rotors at elbows, gravity, friction of the effects."""
        step = 1e-6
        for path, joints, rates, rotors in ((CIRCLE, [0.9, 1.1], [0.7, -0.4], [1e-4, 5e-4, 2e-4, 3e-4]), (ARM, [0.4, 1.2], [0.3, -1.0], [0.02, 0.01])):
            scene = short(path).set("mechanism.rotor_inertia", rotors).set("initial", {"joints": joints, "joint_rates": rates})
            scene.set("effects", [{"type": "viscous_friction", "coefficient": [0.03, 0.02]}, {"type": "coulomb_friction", "torque": [0.02, 0.01], "regularised": 1e-6}])
            scene.set("control.rate_hz", 10000.0).set("simulation.step", step)
            torque, m = np.array([0.05, -0.02]), esmc.model(scene, {"theta": joints, "thetad": rates})["model"]
            self.assertGreater(np.abs(m["f"]).max(), 1e-3)
            plant = esmc.Plant(scene)
            plant.step(torque)
            moved = (np.array(plant.qd) - np.array(esmc.Plant(scene).qd)) / 1e-4
            if path == ARM:
                np.testing.assert_allclose(moved, np.linalg.solve(m["H"], torque - m["h"]), rtol=2e-2, atol=0.05)
                continue
            # The five-bar's independent coordinates are the effector's: the plant's base rates by two poses
            def at(q):
                s = esmc.model(scene, {"theta": q, "thetad": [0.0, 0.0]})["state"]
                return np.array([float(s["x"]), float(s["y"])])
            jacobian = np.array([(at(np.array(joints) + step * e) - at(np.array(joints) - step * e)) / (2 * step) for e in np.eye(2)]).T
            force = np.linalg.solve(jacobian.T, torque)
            acceleration = np.linalg.solve(m["H"], force - m["h"])
            speed = lambda q, w: np.array([(at(np.array(q) + step * np.array(w)) - at(np.array(q) - step * np.array(w))) / (2 * step)]).ravel()
            got = (speed(np.array(plant.angle)[[0, 2]], np.array(plant.rate)[[0, 2]]) - speed(joints, rates)) / 1e-4
            np.testing.assert_allclose(got, acceleration, rtol=3e-2, atol=0.1)

    def test_log_of_a_run_to_an_accuracy(self):
        """Of the pass that counts, however many were made."""
        for path, of, asked in ((CIRCLE, "trajectory", 1e-3), (CIRCLE, "end", 1e-3), (CIRCLE, "end", 1e-9), (ARM, "end", 1e-4)):
            scene = short(path).set("simulation.accuracy", asked).set("simulation.accuracy_of", of)
            run = esmc.run(scene)
            self.assertEqual(len(run.log["x"]), run.summary["ticks"])
            np.testing.assert_allclose(run.log["x"], esmc.run(short(path)).log["x"], atol=2e-3)

    def test_rollouts_are_single_runs_on_any_number_of_threads(self):
        scene = short(CIRCLE)
        values = np.linspace(20.0, 60.0, 13)
        ranges = {"control.lambda": values, "control.gain": (100.0, 200.0), "plant.leg.m1": (0.09, 0.11)}
        results = [esmc.rollout(scene, ranges, seed=7, threads=t) for t in (1, 2, 5)]
        for other in results[1:]:
            for name, column in results[0].items():
                np.testing.assert_array_equal(column, other[name])
        np.testing.assert_array_equal(results[0]["control.lambda"], values)
        self.assertEqual(set(results[0]["outcome"]), {"ok"})
        laws = esmc.rollout(scene, {"control.law": ["esmc", "ctc", "smc"]}, objectives=["max_m"])
        self.assertEqual(sorted(laws), ["control.law", "max_m", "outcome", "seed"])
        some = esmc.rollout(scene, {"mechanism.leg.l1": [0.12, 1e-3]})
        self.assertEqual([some["outcome"][0], np.isnan(some["rms_m"][1])], ["ok", True])

    def test_random_batches_are_single_runs(self):
        """Scene, keys, values, good and bad, size and threads are drawn; every case is the run of a scene with its settings."""
        draw, seen = random.Random(7), collections.Counter()
        scenes = batch_scenes()
        for k in range(1000 if STUDY else 60):
            scene, own = scenes[k % len(scenes)]
            parameters = random_parameters(draw, scene, own, draw.choice([1, 2, 3, 5, 9, 10]))
            n, seed, what = max(map(len, parameters.values())), draw.randrange(100), (k, scene.name, parameters)
            tried = {key: [settings_of(scene, {key: v}) is None for v in values] for key, values in parameters.items()}
            if any(map(all, tried.values())):
                with self.assertRaises(esmc.InputError, msg=what):
                    esmc.rollout(scene, parameters, seed=seed)
                seen["refused"] += 1
                continue
            result = esmc.rollout(scene, parameters, seed=seed, threads=1)
            other = esmc.rollout(scene, parameters, seed=seed, threads=draw.randrange(2, 6))
            for name, column in result.items():
                np.testing.assert_array_equal(column, other[name], err_msg=str(what))
            for i in range(n):
                outcome, figures = single_run(scene, {key: values[i] for key, values in parameters.items()}, int(result["seed"][i]))
                self.assertEqual(result["outcome"][i], outcome, (what, i))
                np.testing.assert_array_equal([result[name][i] for name in figures], list(figures.values()), err_msg=str((what, i)))
                seen[outcome] += 1
        self.assertGreater(seen["ok"], 100, seen)
        self.assertGreater(seen["impossible"], 20, seen)
        self.assertGreater(seen["refused"], 0, seen)

    def test_where_a_bad_value_stands_does_not_matter(self):
        s = short(CIRCLE, 0.01)
        late = s.copy().set("control.predictor", True).set("control.delay_ticks", 1)
        light = s.copy().set("mechanism.leg.m2", 0.0)
        rotor = light.copy().set("mechanism.leg.m1", 0.0).set("mechanism.rotor_inertia", [1e-3, 1e-3])
        elbow = short(ARM, 0.01).set("mechanism.rotor_inertia", [0.02, 0.01])
        for scene, key, good, bad in ((s, "control.lambda", 30.0, -1.0), (s, "control.law", "smc", "lqr"), (late, "control.delay_ticks", 1.0, 1.64), (late, "control.delay_ticks", 1.0, 0.0),
                                      (light, "mechanism.leg.J2", 7e-4, 0.0), (light, "control.model.J2", 1.0, 0.0), (rotor, "mechanism.leg.J1", 2e-4, 0.0), (elbow, "mechanism.leg.J2", 0.1, 0.0), (elbow, "control.model.J2", 1.0, 0.0), (s, "mechanism.leg.l1", 0.12, 1e-3)):
            for values in ([good, bad], [bad, good]):
                self.assertEqual(list(esmc.rollout(scene, {key: values})["outcome"]), ["ok" if v == good else "impossible" for v in values], (key, values))
            with self.assertRaisesRegex(esmc.InputError, key, msg=key):
                esmc.rollout(scene, {key: [bad, bad]})

    def test_plant_and_belief_are_apart(self):
        s = short(CIRCLE, 0.05).set("mechanism.rotor_inertia", [1e-4, 1e-4])
        rotor = {"plant.rotor_inertia.1": [5e-3]}
        np.testing.assert_array_equal(esmc.rollout(s, {**rotor, "mechanism.leg.J1": [2e-4]})["rms_m"], esmc.rollout(s, rotor)["rms_m"])  # J1 of the scene
        told = s.copy().set("control.model.mechanism", tomllib.loads(s.toml)["mechanism"])
        np.testing.assert_array_equal(esmc.rollout(told, {"mechanism.leg.m1": [0.1, 0.12]})["rms_m"], esmc.rollout(s, {"plant.leg.m1": [0.1, 0.12]})["rms_m"])

    def test_keys_of_batches_are_keys_of_set(self):
        s = short(SCENES / "five_bar_friction.toml", 0.05)
        s.set("reference", {"type": "polyline", "points": [[0.03, 0.17], [-0.03, 0.19], [0.0, 0.16]], "speed": 0.2})
        for key, value in (("effects.viscous_friction.coefficient.1", 0.011), ("reference.points.2.1", -0.02), ("mechanism.legs.1.m1", 0.11)):
            alone, batch = s.copy().set(key, value), esmc.rollout(s, {key: [value]})
            self.assertNotEqual(esmc.run(alone).digest, esmc.run(s).digest)
            self.assertEqual(batch["rms_m"][0], esmc.run(alone, seed=int(batch["seed"][0])).summary["tracking"]["rms_m"])
        for key in ("effects.delay.ticks", "effects.9.coefficient", "reference.points.4.1", "reference.points.1.3"):
            with self.assertRaisesRegex(esmc.InputError, key.split(".")[0]):
                s.set(key, 12)

    def test_given_torques_are_single_plants(self):
        draw = np.random.default_rng(4)
        key = "mechanism.leg.m1"
        lag = [{"type": "torque_lag", "time_constant": 2e-3}]
        jitter = [{"type": "jitter", "sigma": 1e-4}]
        for path, changed, value in ((CIRCLE, "simulation.step", 1e-3), (ARM, "control.rate_hz", 1000), (CIRCLE, "control.rate_hz", 500), (CIRCLE, "effects", lag), (CIRCLE, "effects", jitter)):
            scene = esmc.Scene.load(path).set(changed, value)
            torque, mass = draw.normal(scale=0.3, size=(11, 40, 2)), np.linspace(0.09, 0.11, 11)
            ends = [esmc.rollout(scene, {key: mass}, torques=torque, threads=t) for t in (1, 3)]
            rows = esmc.rollout(scene, {key: mass}, torques=torque, every=15)
            np.testing.assert_array_equal(ends[0]["q"], ends[1]["q"])
            np.testing.assert_array_equal(rows["q"][:, -1], ends[0]["q"])
            np.testing.assert_array_equal(rows["qd"][:, -1], ends[0]["qd"])
            self.assertEqual((set(rows["outcome"]), rows["q"].shape[1]), ({"ok"}, 4))
            for i in range(11):
                plant = esmc.Plant(scene.copy().set(key, mass[i]), seed=int(ends[0]["seed"][i]))
                for k in range(40):
                    if k % 15 == 0:
                        np.testing.assert_array_equal(plant.q, rows["q"][i, k // 15])
                    plant.step(torque[i, k])
                np.testing.assert_array_equal(plant.q, ends[0]["q"][i])
                np.testing.assert_array_equal(plant.qd, ends[0]["qd"][i])
        for motors in (["all", "base"], ["base", "all"]):
            four = esmc.Scene.load(CIRCLE).set("control.motors", motors[0])
            with self.assertRaisesRegex(esmc.InputError, "index 1"):
                esmc.rollout(four, {"control.motors": motors}, torques=np.zeros((2, 4, len(four.motors))))
        wild = esmc.rollout(short(CIRCLE), {}, torques=np.array([np.full((300, 2), 1e9), np.zeros((300, 2))]))
        self.assertEqual((list(wild["outcome"]), np.isnan(wild["q"][0]).all()), (["diverged", "ok"], True))

    def test_plan_is_the_command(self):
        scene = str(SCENES / "five_bar_pick_and_place.toml")
        plan = esmc.plan(esmc.Scene.load(scene))
        with tempfile.TemporaryDirectory() as out:
            self.assertEqual(plan.summary, command("plan", scene, "--out", out + "/p"))
            with open(out + "/p/path.csv", newline="", encoding="ascii") as f:
                head, *rows = list(csv.reader(f))
        self.assertEqual(list(plan.path), head)
        np.testing.assert_array_equal(np.column_stack(list(plan.path.values())), np.array(rows, float))

    def test_sweeps_go_on_where_the_command_stopped(self):
        with tempfile.TemporaryDirectory() as d:
            spec = pathlib.Path(d) / "spec.toml"
            spec.write_text(f"""scene = "{CIRCLE}"
set = ["simulation.duration=2.0", "effects=[{{type='noise', sigma=1e-5}}]"]
[sample]
method = "latin_hypercube"
count = 200
[[vary]]
key = "control.gain"
from = 20.0
to = 200.0
""")
            whole = esmc.sweep(str(spec), out=d + "/whole", threads=2)
            self.assertEqual(whole, json.loads((pathlib.Path(d) / "whole/summary.json").read_text()))
            self.assertEqual(whole, esmc.sweep(str(spec)))
            python = lambda out: [sys.executable, "-c", f"import sys; sys.path.insert(0, {FOLDER!r}); import esmc; "
                                  f"print(esmc.sweep({str(spec)!r}, out={d + '/' + out!r}, threads=1) is None)"]
            folders = ["by_command", "by_python"]
            for folder, begin in zip(folders, ([ESMC, "sweep", spec, "--out", d + "/by_command", "--jobs", "1"], python("by_python"))):
                running = subprocess.Popen(begin, stdout=subprocess.DEVNULL)
                journal = pathlib.Path(d) / folder / "sweep.journal"
                while running.poll() is None and not (journal.exists() and journal.stat().st_size > 1000):
                    time.sleep(0.01)
                running.kill()
                running.wait()
                self.assertTrue(journal.exists())
            self.assertEqual(esmc.sweep(str(spec), out=d + "/by_command"), whole)
            self.assertEqual(command("sweep", spec, "--out", d + "/by_python"), whole)
            if shutil.which("mpirun") and pathlib.Path(FOLDER).with_name("esmc_mpi.so").exists():
                said = subprocess.run(["mpirun", "--allow-run-as-root", "--oversubscribe", "-n", "3", *python("ranks")], capture_output=True, text=True, check=True).stdout
                self.assertEqual((said.count("False"), said.count("True")), (1, 2))
                folders.append("ranks")
            for folder in folders:
                for name in ("cases.csv", "summary.json"):
                    self.assertEqual((pathlib.Path(d) / folder / name).read_bytes(), (pathlib.Path(d) / "whole" / name).read_bytes())


class Memory(unittest.TestCase):
    def test_memory_stays(self):
        def resident():
            return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

        scene, n = short(CIRCLE, 0.002), 1_000_000 if STUDY else 3000
        for k in range(n + 500):
            if k == 500:
                before = resident()
            esmc.run(scene).log["x"].sum()
            if k % 100 == 0:
                esmc.rollout(scene, {"control.lambda": (20.0, 40.0)}, n=8)
                esmc.Controller(scene).tick([1.0] * 4, [0.0] * 4)
        grown = resident() - before
        print(f"{n} runs: {grown} bytes more")
        self.assertLess(grown, 4e6)


class Misuse(unittest.TestCase):
    def test_every_one_ends_in_a_clear_exception(self):
        s, n = short(CIRCLE), float("nan")
        plant, controller = esmc.Plant(s), esmc.Controller(s)
        cases = [
            lambda: esmc.Scene.load("no_such_file.toml"), lambda: esmc.Scene.load(""), lambda: esmc.Scene.load("-"),
            lambda: esmc.Scene.load(str(ROOT)), lambda: esmc.Scene.load(3), lambda: esmc.Scene.load(ESMC), lambda: esmc.Scene(),
            lambda: s.set("control.lamda", 3), lambda: s.set("control.lambda", -1), lambda: s.set("control.lambda", "x"),
            lambda: s.set("control.lambda", n), lambda: s.set("control.lambda", None), lambda: s.set("control.lambda", object()),
            lambda: s.set("control.lambda", np.zeros((2, 2))), lambda: s.set("", 1), lambda: s.set("control", 1),
            lambda: s.set("control.law", "no\nlaw\"]"), lambda: s.set("control.law", "\x00"), lambda: s.set(1, 2),
            lambda: s.set("reference.center", [0.0]), lambda: s.set("reference.center", [0.0, 10.0]), lambda: s.set("control.rate_hz", 10**30),
            lambda: esmc.run(s, mode="real"), lambda: esmc.run(s, seed=-1), lambda: esmc.run("scene"), lambda: esmc.run(s, 1, 2, 3),
            lambda: esmc.run(s.copy().set("simulation.accuracy", 1e-8), mode="hil"),
            lambda: esmc.Controller(s.copy().set("control", {"law": "none"})), lambda: controller.tick([1.0], [0.0]), lambda: controller.tick([[1.0] * 4], [0.0] * 4),
            lambda: controller.tick(["a"] * 4, [0.0] * 4), lambda: controller.tick([0.0] * 4, [0.0] * 4, "jump"),
            lambda: plant.step([1.0]), lambda: plant.step("x"), lambda: [plant.step([n, n]) for _ in range(3)], lambda: esmc.Plant(None), lambda: esmc.Plant(s.copy().set("simulation.accuracy", 1e-4)),
            lambda: esmc.rollout(s, {"control.lambda": (3.0,)}), lambda: esmc.rollout(s, {"control.lambda": (5.0, 3.0)}),
            lambda: esmc.rollout(s, {"control.lambda": (1.0, n)}), lambda: esmc.rollout(s, {"no.key": (1.0, 2.0)}),
            lambda: esmc.rollout(s, {"control.lambda": [1.0, 2.0]}, n=3), lambda: esmc.rollout(s, {}, n=0), lambda: esmc.rollout(s, {}, n=10**9),
            lambda: esmc.rollout(s, {"control.lambda": [[1.0]]}), lambda: esmc.rollout(s, {"control.lambda": 3.0}), lambda: esmc.rollout(s, [], n=2),
            lambda: esmc.rollout(s, {}, threads=-1), lambda: esmc.rollout(s, {}, objectives=["speed"]),
            lambda: esmc.model(s, {}), lambda: esmc.model(s, {"theta": [1.0]}), lambda: esmc.model(s, {"theta": [n, n]}), lambda: esmc.model(s, []),
            lambda: esmc.model(s, {"x": 5.0, "y": 5.0}), lambda: esmc.model(s, {"theta": "north"}), lambda: esmc.compare("a", "b"),
            lambda: pickle.loads(pickle.dumps(s)).set("a", 1), lambda: esmc.plan(s), lambda: esmc.sweep("no_such.toml"), lambda: esmc.sweep(CIRCLE),
            lambda: esmc.sweep("x", threads=-1), lambda: esmc.rollout(s, {}, torques=[[1.0]]), lambda: esmc.rollout(s, {}, torques=np.zeros((2, 3, 1))),
            lambda: esmc.rollout(s, {}, torques=np.full((1, 2, 2), n)), lambda: esmc.rollout(s, {}, n=3, torques=np.zeros((2, 3, 2))),
            lambda: esmc.rollout(s, {}, torques=np.zeros((0, 3, 2))), lambda: esmc.rollout(s, {}, n=2, every=1), lambda: esmc.rollout(s, {}, torques=object()),
            lambda: esmc.rollout(s, {}, torques=np.zeros((2, 3, 2)), objectives=["rms_m"]), lambda: esmc.rollout(s, {}, torques=np.zeros((1, 1, 2)), every=-1),
        ]
        self.assertGreaterEqual(len(cases), 40)
        for k, case in enumerate(cases):
            with self.assertRaises((ValueError, TypeError, RuntimeError), msg=str(k)) as caught:
                case()
            text = str(caught.exception)
            self.assertGreater(len(text), 10, k)
            self.assertNotIn("json.exception", text)
            self.assertNotIn("std::", text, k)
        with self.assertRaisesRegex(esmc.InputError, r"control\.lambda"):
            s.set("control.lambda", -1)
        self.assertEqual(esmc.run(s).digest, esmc.run(short(CIRCLE)).digest)  # none of them has changed it

    def test_random_arguments(self):
        draw = random.Random(5)
        s = short(CIRCLE, 0.01)
        circle, deep = {}, []
        circle["control.lambda"] = circle
        for _ in range(5000):
            deep = [deep]

        class Odd:
            """Raises, or answers with something else, wherever it is asked."""
            def raises(self, *_):
                raise draw.choice([ValueError, TypeError, KeyError])("odd")
            tolist = __len__ = __iter__ = __str__ = __repr__ = __float__ = __index__ = __getitem__ = raises
            __array__ = raises

        def torques(x=None, *_, **named):
            return esmc.rollout(s, {}, torques=x, **named)

        values = [None, True, 0, -1, 2**70, 0.5, float("inf"), "", "x", "control.lambda", b"y", [], [1.0], [1.0] * 4, (1.0, 2.0), {}, {"control.lambda": (20.0, 30.0)},
                  {"theta": [1.0, 1.2]}, np.ones(4), np.ones((2, 2)), np.array(["a"]), np.array([1], dtype=object), s, object(), [[1], 2],
                  np.full(4, np.nan), np.full((2, 3, 2), np.inf), np.ones((4, 8))[::2, ::3], np.ones((4, 6, 4))[::2, 1:, ::2], np.ones(4, np.float16),
                  np.ones(4, complex), np.broadcast_to(1.0, (1, 1000, 2)), "a\x00b", "\ud800", "x" * 100000, 1e308, -0.0, 10**400, -(2**63), circle, deep, Odd(), [Odd()],
                  {"control.lambda": Odd()}, {Odd(): 1.0}, {"theta": Odd()}, {"plant.leg.m1": [0.1, None]}, memoryview(b"1234"), np.datetime64("2020-01-01"), np.ma.masked,
                  range(3), {1, 2}, iter([1.0]), type, esmc.Scene, NotImplemented]
        things = [esmc.run, esmc.rollout, esmc.check, esmc.margins, esmc.model, esmc.compare, esmc.Scene.load, s.copy().set, esmc.Controller, esmc.Plant,
                  esmc.Controller(s).tick, esmc.Plant(s).step, esmc.plan, esmc.sweep, s.copy().__setstate__, torques]
        raised = 0
        for _ in range(100_000 if STUDY else 4000):
            thing = draw.choice(things)
            arguments = [draw.choice([s.copy(), *values]) for _ in range(draw.randrange(4))]
            named = {draw.choice(["n", "seed", "threads", "mode", "objectives", "tolerance", "torques", "every", "out"]): draw.choice(values) for _ in range(draw.randrange(2))}
            try:
                thing(*arguments, **named)
            except (ValueError, TypeError, RuntimeError, KeyError, AttributeError, OverflowError, RecursionError, MemoryError) as e:
                raised += 1
                self.assertNotIn("std::", str(e))
        self.assertGreater(raised, 2000)

    def test_copies_are_apart(self):
        s = short(CIRCLE)
        t = pickle.loads(pickle.dumps(s))
        self.assertEqual(s.toml, t.toml)
        s.copy().set("control.lambda", 10.0)
        self.assertEqual(s.toml, t.toml)


class Stubs(unittest.TestCase):
    def test_name_everything(self):
        stub = (pathlib.Path(FOLDER) / "esmc.pyi").read_text(encoding="utf-8")
        told = set(re.findall(r"^(?:class|def) (\w+)", stub, flags=re.M))
        self.assertEqual(told, {n for n in dir(esmc) if not n.startswith("_")})
        for block in re.split(r"^class ", stub, flags=re.M)[1:]:
            name = re.match(r"\w+", block)[0]
            members = set(re.findall(r"^    def (\w+)", block, flags=re.M)) - {"__init__"}
            if members:
                self.assertEqual(members, {n for n in dir(getattr(esmc, name)) if not n.startswith("_")}, name)
        for item in [getattr(esmc, n) for n in told]:
            self.assertTrue(item.__doc__)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *(a for a in sys.argv[3:] if a != "study")], verbosity=1)
