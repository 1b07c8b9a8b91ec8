// The last ten seconds of a few signals, drawn by uPlot; without it a note stands in their place.
"use strict";

const stripSeconds = 10, stripBin = 0.01;

/** Samples thinned to the smallest and the largest of each bin, in the order in which they came: what chatters stays a band. */
class Thinned {
  constructor(names) {
    this.names = names;
    this.clear();
  }
  clear() {
    this.columns = Object.fromEntries(["t", ...this.names].map((name) => [name, []]));
    this.bin = null;
  }
  /** Columns of equal length, t among them. */
  add(samples) {
    const { t } = samples;
    for (let i = 0; i < t.length; ++i) {
      const number = Math.floor(t[i] / stripBin);
      if (this.bin && (number !== this.bin.number)) this.flush();
      this.bin ??= { number, rows: Object.fromEntries(this.names.map((name) => [name, [Infinity, -Infinity, null, null]])) };
      for (const name of this.names) {
        const v = samples[name]?.[i], row = this.bin.rows[name];
        if (v === null || v === undefined) continue;
        if (v < row[0]) row[0] = v;
        if (v > row[1]) row[1] = v;
        row[2] ??= v;
        row[3] = v;
      }
    }
    this.drop((t[t.length - 1] ?? 0) - stripSeconds);
  }
  flush() {
    const { number, rows } = this.bin;
    this.bin = null;
    this.columns.t.push(number * stripBin, (number + 0.5) * stripBin);
    for (const name of this.names) {
      const [low, high, first, last] = rows[name], rising = last >= first;
      this.columns[name].push(...(first === null ? [null, null] : rising ? [low, high] : [high, low]));
    }
  }
  drop(before) {
    const { t } = this.columns;
    let n = 0;
    while (n < t.length && t[n] < before) ++n;
    if (n > 100) for (const column of Object.values(this.columns)) column.splice(0, n);
  }
}

/** options: title, unit, scale (of the values), series: [{name, label, colour}], zero: the range begins there. */
class Strip {
  constructor(host, kept, options) {
    Object.assign(this, { scale: 1, zero: false, height: 136 }, options, { kept });
    this.host = el("div", { role: "img", "aria-label": `${this.title} of the last ten seconds` });
    const legend = el("div", { class: "legend" });
    for (const s of this.series) {
      const swatch = el("i", {});
      swatch.style.borderColor = `var(--${s.colour})`;
      legend.append(swatch, s.label, (s.output = el("output", {})));
    }
    host.append(el("figure", { class: "strip" }, el("figcaption", {}, el("h2", {}, this.title), el("span", { class: "note" }, this.unit), legend), this.host));
    if (typeof uPlot === "undefined") {
      this.host.append(el("p", { class: "note" }, "No plots: this esmc was built without uPlot."));
      return;
    }
    this.plot = new uPlot(this.settings(), this.data(), this.host);
    new ResizeObserver(() => this.plot.setSize({ width: this.width(), height: this.height })).observe(this.host);
  }
  width() { return Math.max(160, this.host.clientWidth); }
  data() {
    const { columns } = this.kept;
    return [columns.t, ...this.series.map(({ name }) => columns[name].map((v) => (v === null ? null : v * this.scale)))];
  }
  settings() {
    const axis = { font: `11px ${getComputedStyle(document.body).fontFamily}`, stroke: () => colour("muted"),
      grid: { stroke: () => colour("rule"), width: 1 }, ticks: { show: false } };
    const marks = (wanted, unit = "") => ({
      splits: (u, i, lo, hi) => ticks(lo, hi, wanted).map(({ value }) => value),
      values: (u, splits, i) => { const { min, max } = u.scales[i === 0 ? "x" : "y"]; return ticks(min, max, wanted).map(({ text }) => text + unit); },
    });
    return {
      width: this.width(), height: this.height, legend: { show: false }, cursor: { show: false }, padding: [6, 12, 0, 0], pxAlign: 0,
      scales: { x: { time: false, range: (u, lo, hi) => [hi - stripSeconds, hi] }, y: { range: (u, lo, hi) => this.range(lo, hi) } },
      series: [{}, ...this.series.map((s) => ({ stroke: () => colour(s.colour), width: 1.5, points: { show: false } }))],
      axes: [
        { ...axis, size: 22, gap: 4, ...marks(6, " s") },
        { ...axis, size: 56, ...marks(4) }],
    };
  }
  /** Room around the values; not so narrow that rounding fills it. */
  range(lo, hi) {
    if (!Number.isFinite(lo) || !Number.isFinite(hi)) return [0, 1];
    const least = this.least ?? 1e-6;
    if (this.zero) return [0, Math.max(1.1 * hi, least)];
    const half = Math.max(0.55 * (hi - lo), least), middle = (lo + hi) / 2;
    return [middle - half, middle + half];
  }
  show() {
    for (const { name, output } of this.series) {
      const column = this.kept.columns[name], v = column[column.length - 1];
      output.value = Number.isFinite(v) ? sig(v * this.scale, 3) : "–";
    }
    this.plot?.setData(this.data());
  }
  /** In the colours of now. */
  redraw() { this.plot?.redraw(true, true); }
}
