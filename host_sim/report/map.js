// The workspace on a canvas: where the effector can be, what the motors can do there, and where the mechanism is singular.
"use strict";

const WorkspaceMap = (() => {
  /** Value of a grid at a point, from those of its four nodes that have one. */
  function sample({ x: [x0, x1], y: [y0, y1], columns, rows }, values, [x, y]) {
    const u = clamp((x - x0) / (x1 - x0), 0, 1) * (columns - 1), v = clamp((y - y0) / (y1 - y0), 0, 1) * (rows - 1);
    const i = Math.min(columns - 2, Math.floor(u)), j = Math.min(rows - 2, Math.floor(v));
    let sum = 0, weights = 0;
    for (const [di, dj] of [[0, 0], [1, 0], [0, 1], [1, 1]]) {
      const value = values[(j + dj) * columns + i + di], weight = (di ? u - i : 1 - u + i) * (dj ? v - j : 1 - v + j) + 1e-9;
      if (value !== null && value !== undefined) { sum += weight * value; weights += weight; }
    }
    return weights > 0 ? sum / weights : NaN;
  }
  const reached = (legs, [x, y]) => legs.every(({ base, l1, l2 }) => {
    const r = Math.hypot(x - base, y);
    return r <= l1 + l2 && r >= Math.abs(l1 - l2);
  });
  const channels = (css) => css.match(/[\d.]+/g).slice(0, 3).map(Number);

  /** Steps of force that the picture tells apart: round, and such that the strongest tenth is one step. */
  function levels(map, side) {
    const shown = map.force.filter((f, k) => f > 0 && (!side || !map.type2_sine.length || map.type2_sine[k] * side > 0)).sort((a, b) => a - b);
    return shown.length ? ticks(0, shown[Math.floor(0.9 * (shown.length - 1))], 5) : [];
  }

  /** The field as a picture of width x height pixels; ratio: pixels of the device per CSS pixel. */
  function field(map, legs, view, side, steps, ratio) {
    const canvas = document.createElement("canvas"), [width, height] = [Math.round(view.width * ratio), Math.round(view.height * ratio)];
    [canvas.width, canvas.height] = [Math.max(1, width), Math.max(1, height)];
    const c = canvas.getContext("2d"), image = c.createImageData(canvas.width, canvas.height);
    const [ground, tint, other, bad] = ["panel", "c0", "muted", "bad"].map((name) => channels(colour(name)));
    const most = Math.max(1, steps.length);
    for (let row = 0; row < canvas.height; ++row) {
      for (let column = 0; column < canvas.width; ++column) {
        const at = view.toWorld([(column + 0.5) / ratio, (row + 0.5) / ratio]);
        if (!reached(legs, at)) continue;
        const force = map.force.length ? sample(map, map.force, at) : NaN;
        const ours = !side || !map.type2_sine.length || sample(map, map.type2_sine, at) * side > 0;
        const level = Number.isNaN(force) ? 0.5 : steps.filter(({ value }) => force >= value).length / most;
        const stripe = force < 0 && (column + row) % Math.round(7 * ratio) < 2 * ratio;
        const [ink, amount] = stripe ? [bad, 0.8] : ours ? [tint, 0.1 + 0.6 * level] : [other, 0.06 + 0.14 * level];
        const k = 4 * (row * canvas.width + column);
        for (let n = 0; n < 3; ++n) image.data[k + n] = ground[n] + (ink[n] - ground[n]) * amount;
        image.data[k + 3] = 255;
      }
    }
    c.putImageData(image, 0, 0);
    return canvas;
  }

  /** On a canvas: map (see run_page.hpp), geometry (mechanism.js), side: sign of sin(phi12 + phi22) of the run or 0,
      reference: points of the path, pose() now. */
  class View {
    constructor(canvas, { map, geometry, side, reference, pose, legend, output }) {
      Object.assign(this, { canvas, map, geometry, side, reference, pose, legendHost: legend, output });
      this.legs = Mechanism.legs(geometry);
      this.steps = levels(map, side);
      this.box = { x: [Math.min(map.x[0], ...this.legs.map(({ base }) => base)), Math.max(map.x[1], ...this.legs.map(({ base }) => base))], y: map.y };
      on(canvas, "pointermove", (event) => { this.pointer = [event.offsetX, event.offsetY]; this.tell(); });
      on(canvas, "pointerleave", () => { this.pointer = undefined; this.tell(); });
    }
    /** Values under the pointer; without one, at the effector. */
    tell() {
      const effector = this.pose()?.effector, at = this.pointer ? this.view?.toWorld(this.pointer) : effector;
      if (!at || !Number.isFinite(at[0] + at[1])) { this.output.value = ""; return; }
      const where = `${this.pointer ? "" : "effector at "}x ${Math.round(1e3 * at[0]) || 0}, y ${Math.round(1e3 * at[1]) || 0} mm: `.replaceAll("-", "−");
      const { map } = this, parts = [];
      if (map.force.length) parts.push(amount(sample(map, map.force, at), "N"));
      if (map.type2_sine.length) parts.push(`sin(φ₁₂+φ₂₂) = ${sig(sample(map, map.type2_sine, at), 2)}`);
      this.output.value = where + (reached(this.legs, at) ? parts.join(", ") : "out of reach");
    }
    legend() {
      const swatch = (style, text) => el("span", { class: "key" }, el("i", { style }), text);
      const mix = (name, level) => `color-mix(in srgb, var(--${name}) ${Math.round(100 * level)}%, var(--panel))`;
      const most = Math.max(1, this.steps.length), keys = [];
      this.steps.forEach(({ text }, k) => keys.push(swatch(`background: ${mix("c0", 0.1 + 0.6 * (k + 1) / most)}`, `≥ ${text} N`)));
      if (!this.steps.length) keys.push(swatch(`background: ${mix("c0", 0.4)}`, "reach"));
      if (this.map.force.some((f) => f !== null && f < 0)) keys.push(swatch(
        `background: repeating-linear-gradient(135deg, var(--bad) 0 2px, ${mix("c0", 0.1)} 2px 6px)`, "cannot hold its weight"));
      if (this.side && this.map.type2.length) keys.push(swatch(`background: ${mix("muted", 0.14)}`, "other assembly mode"));
      keys.push(swatch("height: 0; border-top: 2px solid var(--ink)", "type 1"));
      if (this.map.type2_sine.length) keys.push(swatch("height: 0; border-top: 2px dashed var(--c1)", "type 2"));
      if (this.reference.length) keys.push(swatch("height: 0; border-top: 2px solid var(--c6)", "reference"));
      this.legendHost.replaceChildren(...keys);
    }
    /** All of it, the field too: after a change of size or colours. */
    draw() {
      const { width, height } = prepare(this.canvas), ratio = Math.min(2, devicePixelRatio || 1);
      if (!(width > 0 && height > 0)) return;
      this.view = Mechanism.fit(this.box, width, height, 20);
      this.field = field(this.map, this.legs, this.view, this.side, this.steps, ratio);
      this.legend();
      this.show();
    }
    /** The field as it is, and the mechanism now. */
    show() {
      if (!this.view) return;
      const { c, width, height } = prepare(this.canvas), { view, map } = this;
      const step = Mechanism.drawGrid(c, view, colour);
      c.drawImage(this.field, 0, 0, width, height);
      for (const path of map.type1) Mechanism.drawPath(c, view, path, { strokeStyle: colour("ink"), lineWidth: 1.6 });
      for (const path of map.type2) {
        Mechanism.drawPath(c, view, path, { strokeStyle: colour("panel"), lineWidth: 4, globalAlpha: 0.7 });
        Mechanism.drawPath(c, view, path, { strokeStyle: colour("c1"), lineWidth: 2 }, [7, 3]);
      }
      Mechanism.drawPath(c, view, this.reference, { strokeStyle: colour("panel"), lineWidth: 4, globalAlpha: 0.7 });
      Mechanism.drawPath(c, view, this.reference, { strokeStyle: colour("c6"), lineWidth: 2 });
      this.tell();
      const pose = this.pose();
      if (pose) {
        pose.bases.forEach((base, j) => Mechanism.drawPath(c, view, [base, pose.elbows[j], pose.effector], { strokeStyle: colour("ink"), lineWidth: 1.5 }));
        for (const point of [...pose.bases, ...pose.elbows, pose.effector]) Mechanism.dot(c, view.toScreen(point), 2.25, colour("ink"));
      }
      write(c, { fillStyle: colour("muted"), textBaseline: "bottom", textAlign: "right" }, `grid ${sig(1e3 * step)} mm`, width - 4, height - 2);
    }
  }
  return { View, sample, reached };
})();
