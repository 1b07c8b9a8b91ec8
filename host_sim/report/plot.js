// A figure with title, legend and lines by uPlot: what plots of reports and of the live bench have in common.
"use strict";

class Plot {
  /** options: title, unit, height (px), series: [{label, colour, ...}]; about: the picture in words; legend: entries. */
  constructor(host, options, about, legend, ...more) {
    Object.assign(this, options);
    this.host = el("div", { role: "img", "aria-label": about });
    host.append(el("figure", {}, el("figcaption", {}, el("h2", {}, this.title), el("span", { class: "note" }, this.unit), ...more,
      el("div", { class: "legend" }, ...legend)), this.host));
  }
  width() { return Math.max(160, document.documentElement.hasAttribute("data-printing") ? 660 : this.host.clientWidth); }
  /** Draws lines with these scales and options of uPlot; x, y: of the axes. False without uPlot. */
  create(lines, scales, x, y, options) {
    if (typeof uPlot === "undefined") return false;
    const look = { font: `11px ${getComputedStyle(document.body).fontFamily}`, stroke: () => colour("muted"),
      grid: { stroke: () => colour("rule"), width: 1 }, ticks: { show: false } };
    this.plot = new uPlot({ width: this.width(), height: this.height, legend: { show: false }, padding: [6, 12, 0, 0], pxAlign: 0,
      scales: { x: { time: false, ...scales.x }, y: scales.y }, series: [{}, ...lines],
      axes: [{ ...look, size: 22, gap: 4, ...x }, { ...look, ...y }], ...options }, this.data(), this.host);
    new ResizeObserver(() => this.resize()).observe(this.host);
    return true;
  }
  /** About wanted(plot) round numbers along an axis, printed with the digits that tell them apart. */
  marksOf(wanted, unit = "") {
    let texts = [];
    return { values: () => texts, splits: (u, i, lo, hi) => {
      const list = ticks(lo, hi, wanted(u));
      texts = list.map(({ text }) => text + unit);
      return list.map(({ value }) => value);
    } };
  }
  /** The axis of powers of ten. */
  static decades(more) {
    return { ...more, filter: (u, splits) => splits, values: (u, splits) => splits.map((v) => power(Math.round(Math.log10(v)))),
      splits: (u, i, lo, hi) => {
        const first = Math.ceil(Math.log10(lo) - 1e-9), last = Math.floor(Math.log10(hi) + 1e-9), skip = Math.max(1, Math.ceil((last - first) / 5));
        return Array.from({ length: Math.max(0, Math.floor((last - first) / skip) + 1) }, (_, k) => 10 ** (first + k * skip));
      } };
  }
  resize() { if (this.plot && this.width() !== this.plot.width) this.plot.setSize({ width: this.width(), height: this.height }); }
  /** Again, in the colours of now. */
  draw() {
    this.resize();
    this.plot?.redraw(true, true);
  }
}
