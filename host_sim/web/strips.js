// The last ten seconds of a few signals.
"use strict";

const stripSeconds = 10, stripBin = 0.01;

/** Samples thinned to the smallest and the largest of each bin, in the order in which they came: what chatters stays a band. */
class Thinned {
  constructor(names) {
    Object.assign(this, { names, columns: Object.fromEntries(["t", ...names].map((name) => [name, []])), bin: null });
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

/** options: title, unit, scale (of the values), series: [{name, label, colour}], zero: the range begins there; least: of the range. */
class Strip extends Plot {
  constructor(host, kept, options) {
    const legend = options.series.flatMap((s) => {
      const swatch = el("i", {});
      swatch.style.borderColor = `var(--${s.colour})`;  // no attribute: the page's policy forbids inline styles
      return [swatch, s.label, (s.output = el("output", {}))];
    });
    super(host, { scale: 1, zero: false, height: 136, ...options, kept }, `${options.title} of the last ten seconds`, legend);
    const lines = this.series.map((s) => ({ stroke: () => colour(s.colour), width: 1.5, points: { show: false } }));
    if (!this.create(lines, { x: { range: (u, lo, hi) => [hi - stripSeconds, hi] }, y: { range: (u, lo, hi) => this.range(lo, hi) } },
      this.marksOf(() => 6, " s"), { size: 72, ...this.marksOf(() => 4) }, { cursor: { show: false } }))
      this.host.append(el("p", { class: "note" }, "No plots: this esmc was built without uPlot."));
  }
  data() {
    const { columns } = this.kept;
    return [columns.t, ...this.series.map(({ name }) => columns[name].map((v) => (v === null ? null : v * this.scale)))];
  }
  /** Room around the values; not so narrow that rounding fills it. */
  range(lo, hi) {
    if (!Number.isFinite(lo) || !Number.isFinite(hi)) return [0, 1];
    if (this.zero) return [0, Math.max(1.1 * hi, this.least)];
    const half = Math.max(0.55 * (hi - lo), this.least), middle = (lo + hi) / 2;
    return [middle - half, middle + half];
  }
  show() {
    for (const { name, output } of this.series) {
      const last = this.kept.columns[name].at(-1);
      output.value = Number.isFinite(last) ? sig(last * this.scale, 3) : "–";
    }
    this.plot?.setData(this.data());
  }
}
