// Numbers as one prints them, elements of the page, colours of look.css for a canvas.
"use strict";

const byId = (id) => document.getElementById(id), query = (selector) => document.querySelector(selector);
const on = (target, type, action) => target.addEventListener(type, action);
const clamp = (v, lo, hi) => Math.min(Math.max(v, lo), hi);

/** theta12 as θ₁₂. */
function symbol(name) {
  return [["theta", "θ"], ["phi", "φ"], ["tau", "τ"], ["_", " "]].reduce((text, [word, sign]) => text.replace(word, sign), name)
    .replace(/\d/g, (digit) => "₀₁₂₃₄₅₆₇₈₉"[digit]);
}

const power = (n) => `10${String(n).replace(/./g, (c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c]))}`;
const plural = (n, word) => `${n} ${word}${n === 1 ? "" : "s"}`;
const sentence = (parts) => parts.join("; ").replace(/^./, (c) => c.toUpperCase());

/** A number with so many significant digits, as one would print it. Not a number: a dash. */
function sig(value, digits = 3) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value), [mantissa, exponent] = value.toExponential(digits - 1).split("e");
  const text = size > 0 && (size < 1e-3 || size >= 1e7) ? `${mantissa}×${power(Number(exponent))}`
    : size === 0 ? "0" : size >= 10 ** digits ? value.toFixed(0) : value.toPrecision(digits);
  return text.replace("-", "−");
}

const amount = (value, unit, scale = 1) => (Number.isFinite(value) ? `${sig(value * scale)} ${unit}` : "–");

/** A duration in the unit that suits it. */
function duration(seconds) {
  const [scale, unit] = [[1e9, "ns"], [1e6, "µs"], [1e3, "ms"]].find(([by]) => Math.abs(seconds) * by < 999.5) ?? [1, "s"];
  return amount(seconds, unit, scale);
}

const filled = (node, attributes, children) => {
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
};
/** An element with attributes and children; strings become text, never markup. The same of a drawing. */
const el = (tag, attributes, ...children) => filled(document.createElement(tag), attributes, children);
const svg = (tag, attributes, ...children) => filled(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);

/** The next of 1, 2, 5 times a power of ten. */
function roundStep(least) {
  const decade = 10 ** Math.floor(Math.log10(least));
  return decade * [1, 2, 5, 10].find((m) => m * decade >= 0.999 * least);
}

/** About `wanted` round numbers in [lo, hi] and how to print them. */
function ticks(lo, hi, wanted) {
  if (!(hi > lo)) return [];
  const step = roundStep((hi - lo) / Math.max(1, wanted)), digits = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9)), marks = [];
  const text = (v) => (v === 0 ? "0" : step > 1e-4 && step < 1e5 ? v.toFixed(digits).replace("-", "−") : sig(v, 2));
  for (let k = Math.ceil(lo / step - 1e-9); k <= hi / step + 1e-9; ++k) marks.push({ value: k * step, text: text(k * step) });
  return marks;
}

// ---- Canvas ---------------------------------------------------------------------------------------------------------
let knownColours = {};
/** A colour of look.css by its name ("c0", "ink", ...), as a canvas wants it: light or dark already decided. */
function colour(name) {
  const probe = document.body;
  if (!knownColours[name]) {
    probe.style.outlineColor = `var(--${name})`;
    knownColours[name] = getComputedStyle(probe).outlineColor;
    probe.style.outlineColor = "";
  }
  return knownColours[name];
}
const forgetColours = () => { knownColours = {}; };

/** The canvas cleared, at the resolution of the device; coordinates are CSS pixels. */
function prepare(canvas) {
  const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight, c = canvas.getContext("2d");
  [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
  c.scale(ratio, ratio);
  c.font = `11px ${getComputedStyle(document.body).fontFamily}`;
  return { c, width, height };
}

/** Text with fillStyle, textAlign, ... */
const write = (c, style, text, px, py) => Object.assign(c, style).fillText(text, px, py);

/** Calls `redraw` when the theme changes, and in light colours around printing. */
function onLook(redraw) {
  const fresh = () => { forgetColours(); redraw(); };
  on(matchMedia("(prefers-color-scheme: dark)"), "change", fresh);
  for (const type of ["beforeprint", "afterprint"]) {
    on(window, type, () => { document.documentElement.toggleAttribute("data-printing", type === "beforeprint"); fresh(); });
  }
}
