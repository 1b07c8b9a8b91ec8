#!/usr/bin/env python3
"""Runs `esmc eval` on the golden static cases and holds every computed block against them.

The golden numbers have 25 digits and are compared as decimals, not through doubles. Accepted, as the reference
allows: a relative error (2-norm) of 30 x max(double_ref, 1e-15), where double_ref is what a plain double
implementation reaches; near type 1 forward.pdot and inverse.tau4_* must be better: 1e-12.
usage: static_cases.py ESMC FILE...
"""
import json
import subprocess
import sys
from decimal import Decimal, getcontext

getcontext().prec = 40

# Which double_ref speaks for which block entry; entries without one get the plain 1e-15 floor.
DOUBLE_REF = {
    "model.Chat": "Chat", "model.C": "C", "model.H": "H", "model.h": "h",
    "model.bias": "h", "model.A": None, "model.b": None, "model.M_diag": None, "model.g": None, "model.f": None,
    "state.theta": "ik", "state.x": "fk", "state.y": "fk",
    "forward.xdd": "forward_xdd", "forward.pdot": "forward_xdd", "forward.xdd_from_tau2": "forward_xdd",
    "inverse.F": "inverse_F", "inverse.tau2": "inverse_tau2", "inverse.pdot": "inverse_F",
    "inverse.tau4_minnorm": "inverse_tau4", "inverse.tau4_weighted": "inverse_tau4",
    "esmc.F": "esmc_F", "esmc.tau2": "esmc_tau2", "esmc.tau4_minnorm": "esmc_tau4",
    "esmc.v_projected": "forward_xdd", "smc_xy.F": "esmc_F", "smc_xy.tau2": "esmc_tau2", "smc_xy.v": "esmc_F",
    "forward.thetadd": "forward", "inverse.tau": "inverse", "esmc.u": "esmc_u",
}
for entry in ("q", "q_d", "qd", "qd_d", "qdd_d", "e", "edot", "s", "vprime"):
    DOUBLE_REF["esmc." + entry] = "esmc_F"
BLOCKS = ("effector", "model", "forward", "inverse", "esmc", "smc_xy")
INPUTS = {"forward.tau", "forward.tau2", "forward.tau4", "inverse.xdd", "inverse.thetadd", "inverse.W_diag",
          "esmc.ref", "esmc.theta_d", "esmc.thetad_d", "esmc.thetadd_d", "esmc.switch", "esmc.uniform_gains",
          "esmc.lambda", "esmc.k", "esmc.eps"}


def flat(value):
    if isinstance(value, list):
        return [v for item in value for v in flat(item)]
    return [Decimal("NaN") if value is None else value]


def relative_error(got, want):
    got, want = flat(got), flat(want)
    if len(got) != len(want):
        return Decimal("Infinity")
    scale = sum(w * w for w in want).sqrt()
    error = sum((g - w) ** 2 for g, w in zip(got, want)).sqrt()
    if error.is_nan():
        return Decimal("Infinity")
    return error / scale if scale else error


def compare(case, got, near_type1):
    """Yields (name, error, allowed) for every entry of the golden case."""
    ref = case["double_ref"]
    pairs = [(f"{b}.{k}", v) for b in BLOCKS if b in case for k, v in case[b].items() if f"{b}.{k}" not in INPUTS]
    if "smc_xy" in case:  # 5R: positions from angles and angles from positions
        pairs += [("state.theta", case["state"]["theta"])]
        fk = relative_error([got["state"]["x"], got["state"]["y"]], [case["state"]["x"], case["state"]["y"]])
        yield "state.x, y", fk, 30 * max(ref["fk"], Decimal("1e-15"))
    for name, want in pairs:
        block, key = name.split(".")
        if key not in got.get(block, {}):
            yield name, Decimal("Infinity"), Decimal(0)
            continue
        keyed = DOUBLE_REF.get(name)
        allowed = 30 * max(ref.get(keyed, Decimal(0)), Decimal("1e-15"))
        if near_type1 and name in ("forward.pdot", "inverse.tau4_minnorm", "inverse.tau4_weighted"):
            allowed = Decimal("1e-12")
        yield name, relative_error(got[block][key], want), allowed


def main():
    esmc, files = sys.argv[1], sys.argv[2:]
    failed = checked = 0
    worst = Decimal(0)
    for path in files:
        with open(path, encoding="utf-8") as f:
            text = f.read()
        golden = json.loads(text, parse_float=Decimal, parse_int=Decimal)
        out = subprocess.run([esmc, "eval", path], capture_output=True, text=True, check=True).stdout
        answer = json.loads(out, parse_float=Decimal, parse_int=Decimal)
        if [c["id"] for c in answer["cases"]] != [c["id"] for c in golden["cases"]]:
            sys.exit(f"{path}: other cases came back than went in")
        for case, got in zip(golden["cases"], answer["cases"]):
            for name, error, allowed in compare(case, got, case.get("kind") == "type1"):
                checked += 1
                worst = max(worst, error / allowed if allowed else error)
                if error > allowed:
                    failed += 1
                    print(f"FAILED {case['id']} {name}: relative error {error:.2e}, allowed {allowed:.2e}")
    print(f"{checked} entries compared, {failed} outside; worst uses {worst:.2f} of what is allowed")
    sys.exit(1 if failed or not checked else 0)


if __name__ == "__main__":
    main()
