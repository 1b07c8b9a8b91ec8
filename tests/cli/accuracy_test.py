#!/usr/bin/env python3
"""simulation.accuracy from outside: cases that went wrong once, what is refused, what the summary says.
usage: accuracy_test.py ESMC"""
import math

from command import CIRCLE, SCENES, Case, esmc, main, read_table, sets

ARM = ['control.law=none', 'reference={type="hold"}', "initial.joints=[0.3,0.7]", "simulation.duration=1"]
FRICTION = '{type="coulomb_friction",torque=[0.5,0.2]}'
SMOOTH = FRICTION.replace("}", ",regularised=1e-3}")


class Accuracy(Case):
    def run_sim(self, scene, *values, command="sim"):
        return self.document(command, SCENES / scene, *sets(*values))

    def fails(self, scene, *values, word, command="sim", code=1):
        self.refused(esmc(command, SCENES / scene, *sets(*values)), word, code=code)

    def off(self, run, truth):
        return max(abs(a - b) for a, b in zip(run["final_state"]["q"], truth, strict=True))

    def test_set_valued_friction_of_the_arm(self):
        truth = (-2.158441, -0.707371)  # by an event-driven solution of others, six digits
        for asked in (1e-3, 1e-4, 1e-6):
            run = self.run_sim("rr_line.toml", *ARM, f"effects=[{FRICTION}]", f"simulation.accuracy={asked}")
            self.assertLess(self.off(run, truth), asked + 1e-6)
            a = run["accuracy"]
            self.assertEqual((a["asked"], a["of"], a["method"]), (asked, "end", "event_driven"))
            self.assertLessEqual(a["estimated"], asked)
            self.assertGreater(a["events"]["total"], 5)

    def test_smooth_stiff_friction_is_reached(self):
        fine = self.run_sim("rr_line.toml", *ARM, f"effects=[{SMOOTH}]", "simulation.integrator=rk4", "simulation.step=1e-5")
        run = self.run_sim("rr_line.toml", *ARM, f"effects=[{SMOOTH}]", "simulation.accuracy=1e-6")
        self.assertLess(self.off(run, fine["final_state"]["q"]), 1e-6)

    def test_radau_of_fixed_steps_stays_finite(self):
        fine = self.run_sim("rr_line.toml", *ARM, f"effects=[{SMOOTH}]", "simulation.integrator=rk4", "simulation.step=1e-5")
        run = self.run_sim("rr_line.toml", *ARM, f"effects=[{SMOOTH}]", "simulation.integrator=radau5", "simulation.step=1e-3")
        self.assertLess(self.off(run, fine["final_state"]["q"]), 1e-2)

    def test_few_digits_do_not_cost_many(self):
        spring = '{type="joint_flexibility",stiffness=[100.0,100.0],damping=[0.1,0.1],rotor_inertia=[0.01,0.01]}'
        run = self.run_sim("rr_line.toml", *ARM, f"effects=[{spring}]", "simulation.accuracy=1e-2")
        self.assertEqual((run["integrator"], run["accuracy"]["events"]["total"]), (run["accuracy"]["method"], 0))
        self.assertNotEqual(run["integrator"], "radau5")
        self.assertGreater(run["accuracy"]["step"], 9e-4)  # one step per tick

    def test_two_passes_suffice_and_one_is_the_run_by_hand(self):
        circle = ("five_bar_circle.toml", "simulation.duration=0.3")
        hand = self.run_sim(*circle, "simulation.integrator=rk4", "simulation.step=1e-3")
        few, many = (self.run_sim(*circle, f"simulation.accuracy={asked}") for asked in ("1e-4", "1e-6"))
        self.assertEqual((few["accuracy"]["passes"], few["accuracy"]["evaluations"]), (2, 300 * (2 + 3)))  # midpoint, Heun
        self.assertLess(self.off(few, hand["final_state"]["q"]), 1e-4)
        self.assertEqual((many["digest"], many["integrator"]), (hand["digest"], "rk4"))
        self.assertEqual((many["accuracy"]["passes"], many["accuracy"]["evaluations"]), (2, 300 * (3 + 4)))  # Heun, RK4

    def test_radau_where_the_first_ticks_are_stiff(self):
        # More friction than weight: the arm creeps where friction is 5 kN m s/rad, which bounds explicit steps.
        held = (*ARM[:3], "simulation.duration=0.2", "effects=[%s]" % SMOOTH.replace("0.5,0.2", "5.0,2.0"))
        run = self.run_sim("rr_line.toml", *held, "simulation.accuracy=1e-6")
        self.assertEqual(run["integrator"], "radau5")
        fine = self.run_sim("rr_line.toml", *held, "simulation.integrator=rk4", "simulation.step=1e-6")
        self.assertLess(self.off(run, fine["final_state"]["q"]), 1e-6)

    def test_every_row_of_a_trajectory(self):
        stops = '{type="end_stops",lower=[-1.0,-0.5],upper=[1.0,2.0],restitution=0.4}'
        rows = {}
        for asked in ("1e-8", "1e-4"):
            out = self.tmp / asked
            run = self.document("sim", SCENES / "rr_line.toml", "--out", out, *sets(*ARM, f"effects=[{FRICTION},{stops}]", f"simulation.accuracy={asked}",
                                                                                   "simulation.accuracy_of=trajectory"))
            self.assertEqual(run["accuracy"]["of"], "trajectory")
            rows[asked] = [(float(row["theta1"]), float(row["theta2"])) for row in read_table(out / "log.csv")]
        self.assertEqual(len(rows["1e-8"]), 1000)
        self.assertLess(max(math.dist(a, b) for a, b in zip(rows["1e-8"], rows["1e-4"], strict=True)), 1e-4)

    def test_a_bounce_that_never_ends_ends(self):
        stops = '{type="end_stops",lower=[-1.0,-2.0],upper=[1.0,2.0],restitution=0.5}'
        run = self.run_sim("rr_line.toml", *ARM[:3], "simulation.duration=4", f"effects=[{stops},{FRICTION}]", "simulation.accuracy=1e-6")
        self.assertGreater(run["accuracy"]["events"]["accumulated"], 0)
        self.assertEqual(run["final_state"]["qd"], [0.0, 0.0])

    def test_what_the_scene_does_not_decide_is_refused(self):
        self.fails("five_bar_circle.toml", "control.law=none", "simulation.duration=5", "simulation.accuracy=1e-9", word="ill_posed")
        # A loop that rings against its limits: passes from the same start agree, one from a start beside it does not.
        self.fails("five_bar_circle.toml", 'reference={type="hold",position=[0.02,0.2]}', "initial.position=[0.02,0.2]", 'effects=[{type="delay",ticks=2}]',
                     "simulation.accuracy=1e-6", word="ill_posed")

    def test_a_start_that_is_off_is_less_than_what_is_asked(self):
        # A loop that forgets its start decides its trajectory, of which the start is a row.
        for asked in ("1e-9", "1e-11"):
            run = self.run_sim("rr_line.toml", "control.law=ctc", "control.rate_hz=100", "simulation.duration=0.1", "simulation.accuracy_of=trajectory",
                               f"simulation.accuracy={asked}")
            self.assertLessEqual(run["accuracy"]["estimated"], float(asked))

    def test_a_bus_carries_single_precision(self):
        run = self.run_sim("five_bar_circle.toml", "simulation.duration=0.2", "simulation.accuracy=1e-6", command="hil")
        self.assertLessEqual(run["accuracy"]["estimated"], 1e-6)
        fine = self.run_sim("five_bar_circle.toml", "simulation.duration=0.2", "simulation.step=1e-5", command="hil")
        self.assertLess(self.off(run, fine["final_state"]["q"]), 1e-6)
        npy = esmc("hil", CIRCLE, "--out", self.tmp / "npy", "--log", "npy", "--log-every", "7", *sets("simulation.duration=0.2", "simulation.accuracy=1e-4"))
        self.assertEqual((npy.returncode, (self.tmp / "npy" / "log.npy").exists()), (0, True), npy.stderr)
        self.fails("five_bar_circle.toml", "simulation.accuracy=1e-7", word="32-bit", command="hil")
        self.fails("five_bar_circle.toml", "simulation.accuracy_of=end", word="needs 'accuracy'", code=2)


if __name__ == "__main__":
    main()
