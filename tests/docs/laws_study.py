"""The study behind docs/laws.md: which runs are made, and what is kept of each. Used by laws_page.py.

Every control law gets the same number of settings: eight error poles lambda, times six values of what else it can be
tuned by. What is kept of a setting in a condition is the row of docs/laws.csv."""
import csv
import itertools
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "host_sim/scenes/five_bar_circle.toml"
SAMPLES = 32

LAMBDA = (10.0, 15.0, 24.0, 36.0, 55.0, 85.0, 130.0, 200.0)  # 1/s
GAIN = (2.0, 6.0, 20.0, 60.0, 200.0, 600.0)                  # m/s2 and rad/s2
RATE = (10.0, 50.0, 250.0, 1250.0, 6250.0, 31250.0)         # m/s3 and rad/s3: L of super_twisting
POLE = (30.0, 60.0, 120.0, 250.0, 500.0, 1000.0)             # 1/s: how fast s dies inside the layer
LAYERED_GAIN = 150.0                                         # of the laws with a layer: that of the scene
# pd has no model. What a motor turns, seen from its joint: proximal bar, and distal bar as a point at the elbow.
INERTIA = 2e-4 + 0.1 * 0.06**2 + 0.1 * 0.12**2               # kg m2

SECOND = {"gain": GAIN, "rate": RATE, "pole": POLE}
# name: law, reaching, what the second number is
LAWS = {
    "esmc implicit": ("esmc", "implicit", "gain"), "esmc saturation": ("esmc", "saturation", "pole"),
    "esmc tanh": ("esmc", "tanh", "pole"), "esmc sign": ("esmc", "sign", "gain"),
    "esmc implicit_coupled": ("esmc", "implicit_coupled", "gain"), "esmc super_twisting": ("esmc", "super_twisting", "rate"),
    "esmc_projected implicit": ("esmc_projected", "implicit", "gain"), "smc implicit": ("smc", "implicit", "gain"),
    "smc saturation": ("smc", "saturation", "pole"), "smc sign": ("smc", "sign", "gain"),
    "smc super_twisting": ("smc", "super_twisting", "rate"),
    "ctc": ("ctc", "", "pole"), "pd": ("pd", "", "pole")}

READ = '{type="encoder", bits=16}, {type="compute_delay", time=1e-3}'
RUB = '{type="viscous_friction", coefficient=[0.01, 0.002]}, {type="coulomb_friction", torque=[0.02, 0.005]}'
TOLD = ["control.delay_ticks=1", "control.sensor_lag_ticks=2"]  # the implicit laws need their sum, super_twisting bridges the first
# name: --set lines
WORLDS = {"ideal": [],
          "encoders": [f"effects=[{READ}]", *TOLD],
          "friction": [f"effects=[{READ}, {RUB}]", *TOLD]}
MASSES = [(k, 0.2) for k in ("m1", "m2", "J1", "J2")]
LENGTHS = [(k, 0.01) for k in ("l1", "l2", "lg1", "lg2")]
# name: what of each bar of each leg is not as believed, and by what share. "joined" is exact, with another start: the
# scene's own, at rest beside a reference that moves, shakes the torques of every law, the more the stiffer it is.
MECHANISMS = {"exact": [], "joined": [], "masses": MASSES, "lengths": MASSES + LENGTHS}
JOIN = "reference.join=0.25"
CONDITIONS = list(itertools.product(WORLDS, MECHANISMS))


def settings(law):
    return list(itertools.product(LAMBDA, SECOND[LAWS[law][2]]))


def keys(law, slope, second):
    """Values of [control] for one setting."""
    kind, reaching, meaning = LAWS[law]
    if kind == "ctc":
        return {"kp": slope * second, "kd": slope + second}
    if kind == "pd":
        return {"kp": INERTIA * slope * second, "kd": INERTIA * (slope + second)}
    if meaning == "pole":
        return {"lambda": slope, "gain": LAYERED_GAIN, "layer": LAYERED_GAIN / second}
    return {"lambda": slope, "gain": second}


def specification(law, world, mechanism, fixed, crossed):
    """A sweep: keys of [control] as the scene has them, and `crossed` ones with a list of values each."""
    kind, reaching, _ = LAWS[law]
    sets = [f"control.law={kind}"] + ([f"control.reaching={reaching}"] if reaching else []) + WORLDS[world]
    sets += [f"control.{k}={v!r}" for k, v in fixed.items()]
    sets += [JOIN] if mechanism == "joined" else []
    text = [f'scene = "{SCENE}"', "set = [" + ", ".join(f"'{s}'" for s in sets) + "]",
            'objectives = ["settled_rms_m", "torque_activity_nm"]', "[sample]"]
    wrong = MECHANISMS[mechanism]
    text += ['method = "latin_hypercube"', f"count = {SAMPLES}"] if wrong else ['method = "grid"']
    for leg, (name, share) in itertools.product((1, 2), wrong):
        text += ["[[vary]]", f'key = "plant.legs.{leg}.{name}"', f"factor = [{1 - share}, {1 + share}]"]
    for key, values in crossed.items():
        text += ["[[vary]]", f'key = "control.{key}"', f"values = {list(values)}", "cross = true" if wrong else ""]
    return "\n".join(text) + "\n"


def sweep(esmc, text):
    """Rows of cases.csv."""
    with tempfile.TemporaryDirectory() as folder:
        spec = Path(folder, "sweep.toml")
        spec.write_text(text, encoding="utf-8")
        run = subprocess.run([esmc, "sweep", spec, "--jobs", "1", "--out", Path(folder, "out")], capture_output=True, text=True)
        if run.returncode != 0:
            raise SystemExit(f"laws_study.py: {run.stderr}{text}")
        with open(Path(folder, "out", "cases.csv"), newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))


def quantile(values, p):
    values = sorted(values)
    return values[int(p * (len(values) - 1) + 0.5)]


def score(rows):
    """Median and 95 % of the error, median of the torque activity, share of runs without a fault; a run that ended in a
    fault has an infinite error. Three digits: what the table keeps is what everything else is made of."""
    error = [float(r["settled_rms_m"]) if r["outcome"] == "ok" else float("inf") for r in rows]
    activity = [float(r["torque_activity_nm"]) if r["outcome"] == "ok" else float("inf") for r in rows]
    ok = sum(r["outcome"] == "ok" for r in rows) / len(rows)
    return tuple(float(f"{v:.3g}") for v in (quantile(error, 0.5), quantile(error, 0.95), quantile(activity, 0.5), ok))


def group(esmc, law, world, mechanism, slope, seconds):
    """Scores of the settings (slope, second) of a law in one condition."""
    made = [keys(law, slope, second) for second in seconds]
    moving = [k for k in made[0] if len(made) == 1 or made[0][k] != made[1][k]]
    if len(moving) > 1:  # numbers that move together are no grid: kp and kd, or a single setting
        return [score(sweep(esmc, specification(law, world, mechanism, m, {moving[0]: [m[moving[0]]]}))) for m in made]
    key = moving[0]
    rows = sweep(esmc, specification(law, world, mechanism, made[0], {key: [m[key] for m in made]}))
    column = f"control.{key}"
    return [score([r for r in rows if float(r[column]) == m[key]]) for m in made]


# What the disturbance observer adds to each law: masses and inertias of the model a sixth too large, one run per setting.
OBSERVERS = (0.0, 25.0, 50.0, 100.0, 200.0)  # 1/s
OBSERVED = ("esmc implicit", "esmc saturation", "esmc_projected implicit", "smc implicit", "smc saturation", "esmc super_twisting", "ctc")
BELIEF = "control.model={m1=1.2, m2=1.2, J1=1.2, J2=1.2}"


def observed(esmc, law, bandwidth):
    """(error, activity) of all settings of a law beside an observer, joined start; a fault is left out."""
    out = []
    for slope in LAMBDA:
        for made in [keys(law, slope, second) for second in SECOND[LAWS[law][2]]]:
            fixed = made | {"disturbance_observer": bandwidth}
            text = specification(law, "friction", "joined", fixed, {"rate_hz": [1000.0]})
            out.append(text.replace(f"'{JOIN}'", f"'{JOIN}', '{BELIEF}'"))
    with ThreadPoolExecutor(2) as pool:
        scores = [score(rows) for rows in pool.map(lambda text: sweep(esmc, text), out)]
    return [(s[1], s[2]) for s in scores if s[3] == 1.0]


def measure(esmc, wanted, say=lambda done, of: None):
    """wanted: (law, world, mechanism, lambda, seconds). Gives {(law, world, mechanism, lambda, second): score}."""
    with ThreadPoolExecutor(2) as pool:
        jobs = [(w, pool.submit(group, esmc, *w)) for w in wanted]
        out = {}
        for number, ((law, world, mechanism, slope, seconds), job) in enumerate(jobs):
            out |= {(law, world, mechanism, slope, s): v for s, v in zip(seconds, job.result())}
            say(number + 1, len(jobs))
        return out


def everything():
    return [(law, world, mechanism, slope, SECOND[LAWS[law][2]])
            for law in LAWS for slope in LAMBDA for world, mechanism in CONDITIONS]


HEAD = ["law", "lambda", "second"] + [f"{w} {m} {v}" for w, m in CONDITIONS for v in ("median_m", "p95_m", "activity_nm", "ok")]


def write(file, scores):
    with open(file, "w", newline="", encoding="utf-8") as out:
        table = csv.writer(out, lineterminator="\n")
        table.writerow(HEAD)
        for law in LAWS:
            for setting in settings(law):
                table.writerow([law, *(f"{v:g}" for v in setting)] +
                               [f"{v:.3g}" for c in CONDITIONS for v in scores[(law, *c, *setting)]])


def read(file):
    scores = {}
    with open(file, newline="", encoding="utf-8") as kept:
        for row in csv.DictReader(kept):
            for w, m in CONDITIONS:
                values = tuple(float(row[f"{w} {m} {v}"]) for v in ("median_m", "p95_m", "activity_nm", "ok"))
                scores[(row["law"], w, m, float(row["lambda"]), float(row["second"]))] = values
    return scores
