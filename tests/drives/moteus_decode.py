#!/usr/bin/env python3
"""Decodes what a moteus hears and says: a second reading of the vendor's tables "CAN protocol" and "Register reference", which shares
nothing with the program. usage: moteus_decode.py FRAMES.LOG prints every frame of a `candump -L` log as registers."""
import re
import struct
import sys

TYPES = {0: ("b", 1), 1: ("<h", 2), 2: ("<i", 4), 3: ("<f", 4)}
# Quantity of a register, and of a quantity the unit as an integer of 8, 16 and 32 bits.
QUANTITY = {0x001: "turns", 0x002: "speed", 0x003: "torque", 0x020: "turns", 0x021: "speed", 0x022: "torque", 0x023: "scale",
            0x024: "scale", 0x025: "torque", 0x026: "turns", 0x027: "time", 0x028: "speed"}
UNITS = {"turns": (0.01, 0.0001, 0.00001), "speed": (0.1, 0.00025, 0.00001), "torque": (0.5, 0.01, 0.001),
         "time": (0.01, 0.001, 0.000001), "scale": (1 / 127, 1 / 32767, 1 / 2147483647)}


def number(data, at):
    """Seven bits per byte, the low ones first."""
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at


def value(register, kind, raw):
    if kind == 3:
        return raw
    if raw == -(1 << (8 * TYPES[kind][1] - 1)):
        return float("nan")
    quantity = QUANTITY.get(register)
    return raw * UNITS[quantity][kind] if quantity else raw


def subframes(data):
    """Lists ("write" | "read" | "reply", {register: value}) and ("write error" | "read error", {register: number})."""
    out, at = [], 0
    while at < len(data):
        code, at = data[at], at + 1
        if code == 0x50:
            continue
        if code in (0x30, 0x31):
            register, at = number(data, at)
            error, at = number(data, at)
            out.append((("write error", "read error")[code & 1], {register: error}))
            continue
        if code > 0x2F:
            raise ValueError(f"subframe {code:02x}")
        count, kind = code & 3, code >> 2 & 3
        if count == 0:
            count, at = number(data, at)
        first, at = number(data, at)
        values = {}
        for register in range(first, first + count):
            values[register] = None
            if code < 0x10 or code >= 0x20:
                form, size = TYPES[kind]
                values[register] = value(register, kind, struct.unpack(form, data[at:at + size])[0])
                at += size
        out.append((("write", "read", "reply")[code >> 4], values))
    return out


def merged(data, which):
    """All registers of the subframes of one kind."""
    out = {}
    for kind, values in subframes(data):
        if kind == which:
            out |= values
    return out


def log(path):
    """(s, source, destination, reply wanted, data) of every CAN FD frame with a switch of the bit rate; another one is an error."""
    with open(path, encoding="ascii") as f:
        lines = f.readlines()
    for line in lines:
        t, identifier, flags, data = re.fullmatch(r"\((\d+\.\d+)\) \S+ ([0-9A-F]+)##([0-9A-F])([0-9A-F]*)\n?", line).groups()
        if int(flags, 16) & 1 == 0:
            raise ValueError(line)
        n = int(identifier, 16)
        if (len(identifier) == 8) != (n > 0x7FF):
            raise ValueError(f"{line}: 29 bits are for what 11 cannot hold")
        yield float(t), n >> 8 & 0x7F, n & 0xFF, bool(n & 0x8000), bytes.fromhex(data)


if __name__ == "__main__":
    for t, source, destination, reply, data in log(sys.argv[1]):
        print(f"{t:.6f} {source} -> {destination}{' ?' if reply else ''}", *(f"{k} {v}" for k, v in subframes(data)))
