// Figures of a run that are not against time: the phase plane of its sliding variables, the spectrum of its torques.
"use strict";

/** Error against its rate, the line s = 0 and the layer around it; the dot is now. What is drawn is what the plots show.
    channels: [{label, colour, e, s, lambda, layer}], values per row, all in one unit; layer 0: none. */
class PhasePlane {
  constructor(host, axis, channels, unit) {
    Object.assign(this, { axis, channels, unit, canvas: el("canvas", { class: "plane", role: "img", "aria-label": "Error against its rate, sliding line, layer" }) });
    for (const one of channels) one.rate = one.s.map((s, row) => s - one.lambda * one.e[row]);
    const [{ lambda, layer }] = channels, key = (style, text) => el("span", { class: "key" }, el("i", { style }), text);
    host.append(el("figure", {}, el("figcaption", {}, el("h2", {}, "Phase plane"), el("span", { class: "note" },
      `e to the right, ${unit}; e′ upward, ${unit}/s; s = e′ + ${sig(lambda)} e${layer ? `, layer ±${sig(layer)} ${unit}/s` : ""}`),
    el("div", { class: "legend" }, ...channels.map(({ label, colour: tint }) => key(`border-top: 2px solid var(--${tint})`, label)),
      key("border-top: 2px solid var(--ink)", "s = 0"), ...(layer ? [key("border-top: 2px dashed var(--muted)", "layer")] : []))), this.canvas));
    for (const what of ["now", "view"]) axis.on(what, () => this.draw());
  }
  draw() {
    const { c, width, height } = prepare(this.canvas), { axis, channels } = this, [from, to] = axis.view.map((t) => axis.row(t));
    const [left, right, top, bottom] = [64, 12, 8, 22], largest = (of) => Math.max(1e-12, ...channels.map((one) => {
      let most = 0;
      for (let row = from; row <= to; ++row) if (Math.abs(one[of][row]) > most) most = Math.abs(one[of][row]);
      return most;
    }));
    const [{ lambda, layer }] = channels, ex = 1.08 * largest("e"), most = largest("rate"), ey = 1.08 * (layer < 4 * most ? Math.max(most, layer) : most);
    const px = (e) => left + (e + ex) / (2 * ex) * (width - left - right), py = (r) => height - bottom - (r + ey) / (2 * ey) * (height - top - bottom);
    const text = { fillStyle: colour("muted"), textBaseline: "middle", textAlign: "right" }, grid = { strokeStyle: colour("rule"), lineWidth: 1 };
    for (const { value, text: mark } of ticks(-ey, ey, height / 50)) {
      Mechanism.path(c, [[left, py(value)], [width - right, py(value)]], grid);
      write(c, text, mark, left - 6, py(value));
    }
    for (const { value, text: mark } of ticks(-ex, ex, width / 130)) {
      Mechanism.path(c, [[px(value), top], [px(value), height - bottom]], grid);
      write(c, { ...text, textAlign: "center" }, mark, px(value), height - bottom / 2);
    }
    c.save();
    c.beginPath(); c.rect(left, top, width - left - right, height - top - bottom); c.clip();
    for (const { e, rate, colour: tint } of channels) {
      const points = Array.from({ length: to - from + 1 }, (_, k) => [px(e[from + k]), py(rate[from + k])]);
      Mechanism.path(c, points, { strokeStyle: colour(tint), lineWidth: 1.2, globalAlpha: 0.8 });
    }
    for (const s of layer ? [0, layer, -layer] : [0])
      Mechanism.path(c, [-ex, ex].map((e) => [px(e), py(s - lambda * e)]), { strokeStyle: colour(s ? "muted" : "ink"), lineWidth: 1.2 }, s ? [5, 4] : []);
    const now = axis.row();
    for (const { e, rate, colour: tint } of channels)
      if (Number.isFinite(e[now] + rate[now])) Mechanism.dot(c, [px(e[now]), py(rate[now])], 4, colour(tint), colour("ink"));
    c.restore();
  }
}

/** Amplitude of torque over frequency. series: [{label, colour, values}], values[k] N m at k step Hz. Beside each name: the line that
    changes the torque most from tick to tick, which is where a loop rings; under the pointer: the amplitude there. */
class SpectrumPlot extends Plot {
  constructor(host, step, series) {
    const lines = series[0].values.length - 1, strongest = ({ values }) => {
      const change = values.map((v, k) => (v ?? 0) * Math.sin(Math.PI * k / (2 * lines)));
      return change.indexOf(Math.max(...change));
    };
    const legend = series.flatMap((s) => [el("i", { style: `border-color: var(--${s.colour})` }), s.label, (s.output = el("output", {}))]);
    super(host, { title: "Spectrum of torque", unit: "N m, amplitude; changes most from tick to tick at", height: 240, series, step }, "Amplitude of torque against frequency", legend);
    const show = (at) => series.forEach((s) => { const k = at ?? strongest(s); s.output.value = `${sig(k * step)} Hz${at === undefined ? "" : `: ${sig(s.values[k] ?? NaN)}`}`; });
    const most = Math.max(...series.flatMap(({ values }) => values.map((v) => v ?? 0))), range = [10 ** Math.floor(Math.log10(most) - 5), 10 ** Math.ceil(Math.log10(most))];
    show();
    if (!this.create(series.map((s) => ({ stroke: () => colour(s.colour), width: 1.4, alpha: 0.8, points: { show: false } })),
      { x: { range: [0, 1.03 * lines * step] }, y: { distr: 3, range } }, this.marksOf((u) => u.width / 85, " Hz"),
      Plot.decades({ size: 64 }), { cursor: { x: false, y: false, points: { show: false }, drag: { x: false, y: false } } })) return;
    const { over } = this.plot;
    on(over, "pointermove", (event) => show(clamp(Math.round(this.plot.posToVal(event.offsetX, "x") / step), 0, lines)));
    on(over, "pointerleave", () => show());
  }
  data() { return [this.series[0].values.map((_, k) => k * this.step), ...this.series.map(({ values }) => values.map((v) => (v > 0 ? v : null)))]; }
}
