// Plots that share one time axis: one cursor, one window.
"use strict";

/** The last row at or before t of ascending times. */
function rowAt(times, t) {
  let [lo, hi] = [0, times.length];
  while (hi - lo > 1) { const mid = (lo + hi) >> 1; if (times[mid] <= t) lo = mid; else hi = mid; }
  return lo;
}

/** Time for everything on the page: the window that is shown, and the cursor. */
class TimeAxis {
  /** Times of the rows, ascending, s. */
  constructor(time) {
    this.listeners = { view: [], now: [] };
    this.time = time;
    [this.start, this.end] = time.length ? [time[0], time[time.length - 1]] : [0, 1];
    if (!(this.end > this.start)) this.end = this.start + 1e-3;  // one row
    this.now = this.end;
    this.view = [this.start, this.end];
    this.busy = false;  // playing: the pointer leaves the cursor alone
  }
  /** "view" or "now": called with the axis whenever it has changed. */
  on(what, listener) { this.listeners[what].push(listener); }
  tell(what) { this.listeners[what].forEach((listener) => listener(this)); }
  row(t = this.now) { return rowAt(this.time, t); }
  setNow(t) { this.now = clamp(t, this.start, this.end); this.tell("now"); }
  /** Shows [lo, hi], moved inside the log and never narrower than a few rows. */
  setView(lo, hi) {
    const whole = this.end - this.start, width = clamp(hi - lo, Math.min(whole, 4 * whole / Math.max(1, this.time.length)), whole);
    const from = clamp((lo + hi - width) / 2, this.start, this.end - width);
    this.view = [from, from + width];
    this.tell("view");
  }
  reset() { this.setView(this.start, this.end); }
  /** Zooms around the cursor. */
  zoom(factor) {
    const [lo, hi] = this.view, about = clamp(this.now, lo, hi);
    this.setView(about - (about - lo) * factor, about + (hi - about) * factor);
  }
  /** Moves the cursor by rows, and the window after it. */
  step(rows) {
    if (!this.time.length) return;
    const [lo, hi] = this.view;
    this.setNow(this.time[clamp(this.row() + rows, 0, this.time.length - 1)]);
    if (this.now < lo || this.now > hi) this.setView(this.now - (hi - lo) / 2, this.now + (hi - lo) / 2);
  }
}

/** A plot in a figure with a legend of buttons.
    options: title, unit; time: seconds per row (default: of the axis); height, px;
    series: [{label, values, colour, style: "line" | "through" (shows what is behind) | "ref" | "under", hidden}], values may hold NaN: a gap;
    limits: [{value, label, colour}], lines at +-value, N m where they have a label; marks: [{t, label, colour}], instants;
    zero: the axis shows it; log: logarithmic, what is not positive falls out below; until: rows that scale the axis end there (s);
    bands: a name per row, drawn as named stretches instead of lines. */
class TimePlot extends Plot {
  constructor(host, axis, options) {
    const { series = [] } = options, output = el("output", {}), buttons = series.length > 1 ? series.map(TimePlot.entry) : [];
    super(host, { series, limits: [], marks: [], log: false, height: 132, time: axis.time, unit: "", ...options, axis, output },
      `${options.title} against time`, buttons, output);
    buttons.forEach((button, k) => on(button, "click", () => this.toggle(button, k)));
    if (series.length === 1) series[0].output = output;
    if (!this.create(...this.settings())) return;
    this.cursor = el("i", { class: "now" });
    this.plot.over.append(this.cursor);
    const over = this.plot.over, follow = (event) => {
      if (!axis.busy || event.type === "pointerdown") axis.setNow(this.plot.posToVal(event.clientX - over.getBoundingClientRect().left, "x"));
    };
    on(over, "pointermove", follow);
    on(over, "pointerdown", follow);
    on(over, "dblclick", () => axis.reset());
    axis.on("view", () => this.show());
    axis.on("now", () => this.showNow());
    this.showNow();
  }
  /** A button of the legend. */
  static entry(s) {
    const swatch = el("i", { class: s.style ?? "line", style: `border-color: var(--${s.colour})` });
    return el("button", { type: "button", "aria-pressed": String(!s.hidden), title: "hide or show" }, swatch, s.label, (s.output = el("output", {})));
  }
  toggle(button, k) {
    const s = this.series[k];
    s.hidden = !s.hidden;
    button.setAttribute("aria-pressed", String(!s.hidden));
    this.plot?.setSeries(k + 1, { show: !s.hidden });
  }
  /** As uPlot wants them: null for a gap. */
  data() {
    const floor = (v) => (this.log && v < 1e-18 ? 1e-18 : v);
    const lists = this.bands ? [Array(this.time.length).fill(0.5)]
      : this.series.map(({ values }) => Array.from(values, (v) => (Number.isFinite(v) ? floor(v) : null)));
    return [Array.from(this.time), ...lists];
  }
  /** Arguments of create(). */
  settings() {
    const styles = { line: { width: 1.6 }, through: { width: 1.4, alpha: 0.65 }, ref: { width: 1.2, dash: [5, 4] }, under: { width: 6, alpha: 0.3 } }, left = { size: 64 };
    const lines = this.bands ? [{ show: false }] : this.series.map((s) => ({ stroke: () => colour(s.colour), show: !s.hidden, points: { show: this.time.length < 3 },
      ...styles[s.style ?? "line"] }));
    const y = this.bands ? { ...left, splits: () => [], values: () => [] }
      : this.log ? Plot.decades(left)
        : { ...left, ...this.marksOf(() => this.height / 32) };
    return [lines, { x: { range: () => this.axis.view }, y: { distr: this.log ? 3 : 1, range: (u, lo, hi) => this.range(lo, hi) } },
      this.marksOf((u) => u.width / 85, " s"), y,
      { cursor: { x: false, y: false, points: { show: false }, drag: { x: true, y: false, setScale: false }, bind: { dblclick: () => null } },
        hooks: { draw: [(u) => this.decorate(u)], setSelect: [(u) => this.selected(u)] } }];
  }
  selected(u) {
    const { left, width } = u.select;
    if (width > 4) this.axis.setView(u.posToVal(left, "x"), u.posToVal(left + width, "x"));
    u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
  }
  show() { this.plot?.setScale("x", { min: this.axis.view[0], max: this.axis.view[1] }); this.showNow(); }
  row() { return rowAt(this.time, this.axis.now); }
  showNow() {
    const row = this.row();
    for (const s of this.series) if (s.output) s.output.value = sig(s.values[row], 4);
    if (this.bands) this.output.value = this.bands[row] ?? "";
    const [lo, hi] = this.axis.view, { now } = this.axis;
    if (this.cursor) this.cursor.style.left = now < lo || now > hi ? "-9px" : `${(now - lo) / (hi - lo) * 100}%`;
  }
  /** Vertical range of what is visible. */
  range(lo, hi) {
    if (this.bands) return [0, 1];
    const shown = this.series.filter((s) => !s.hidden), [from, to] = this.axis.view.map((t) => this.axis.row(t));
    if (this.log) return this.logRange(shown, from, to);
    if (!(lo <= hi)) [lo, hi] = [0, 1];
    const largest = Math.max(-lo, hi);
    for (const { value } of this.limits) if (largest > 0.25 * value) [lo, hi] = [Math.min(lo, -value), Math.max(hi, value)];
    if (this.zero) [lo, hi] = [Math.min(lo, 0), Math.max(hi, 0)];
    const pad = hi - lo > 1e-9 * Math.abs(hi) ? 0.07 * (hi - lo) : 0.1 * Math.abs(hi) || 1;
    return [lo - pad, hi + pad];
  }
  /** Whole decades. Zero crossings reach down for ever: the axis ends a little below the usual value. */
  logRange(shown, from, to) {
    const until = this.until < Infinity ? this.time.findIndex((t) => t >= this.until) : -1;
    const last = until - from > 0.05 * (to - from) ? Math.min(to + 1, until) : to + 1;
    const lists = shown.map(({ values }) => Array.from(values).slice(from, last).filter((v) => v > 0).sort((a, b) => a - b)).filter((list) => list.length);
    if (!lists.length) return [1e-3, 1];
    const usual = Math.max(1e-12, ...lists.map((list) => list[list.length >> 1])), lo = Math.min(...lists.map((list) => list[0]));
    const decades = [Math.floor(Math.log10(Math.max(lo, usual / 20))), Math.ceil(Math.log10(Math.max(...lists.map((list) => list.at(-1)), usual * 2)))];
    return decades.map((k) => 10 ** k);
  }
  /** Limits, instants and named stretches, over the lines. Canvas pixels are device pixels here. */
  decorate(u) {
    const c = u.ctx, ratio = uPlot.pxRatio, { left, top, width, height } = u.bbox, right = left + width, bottom = top + height;
    c.save();
    c.beginPath(); c.rect(left, top, width, height); c.clip();
    c.font = `${11 * ratio}px ${getComputedStyle(document.body).fontFamily}`;
    if (this.bands) this.drawBands(u, c, ratio);
    const rule = (points, tint, dash) => {
      Object.assign(c, { strokeStyle: tint, lineWidth: ratio }).setLineDash(dash.map((d) => d * ratio));
      c.beginPath(); c.moveTo(...points[0]); c.lineTo(...points[1]); c.stroke(); c.setLineDash([]);
    };
    for (const [k, { value, label, colour: tint }] of this.limits.entries()) {
      for (const limit of [value, -value]) {
        const y = u.valToPos(limit, "y", true);
        rule([[left, y], [right, y]], colour(tint), [10, 3, 2, 3]);
        if (label) write(c, { fillStyle: colour(tint), textAlign: k % 2 ? "left" : "right", textBaseline: limit > 0 ? "top" : "bottom" },
          `${label} ${limit < 0 ? "−" : ""}${sig(value)} N m`, k % 2 ? left + 6 * ratio : right - 6 * ratio, y + 3 * ratio * Math.sign(limit));
      }
    }
    for (const { t, label, colour: tint } of this.marks) {
      const x = u.valToPos(t, "x", true), near = x > right - 90 * ratio;
      rule([[x, top], [x, bottom]], colour(tint), [4, 3]);
      if (this.bands || !label) continue;
      const wide = c.measureText(label).width, at = near ? x - wide - 9 * ratio : x + ratio;
      c.fillStyle = colour("panel");
      c.fillRect(at, top + ratio, wide + 8 * ratio, 15 * ratio);
      write(c, { fillStyle: colour(tint), textAlign: "left", textBaseline: "top" }, label, at + 4 * ratio, top + 3 * ratio);
    }
    c.restore();
  }
  drawBands(u, c, ratio) {
    const { top, height } = u.bbox, [from, to] = this.axis.view.map((t) => this.axis.row(t)), count = this.time.length;
    for (let first = from, row = from + 1; row <= Math.min(to + 1, count); ++row) {
      const name = this.bands[first];
      if (row <= to && row < count && this.bands[row] === name) continue;
      const a = u.valToPos(Math.max(this.time[first], this.axis.view[0]), "x", true);
      const b = u.valToPos(row < count ? this.time[row] : this.axis.end, "x", true);
      const tint = /fault|stop|error/i.test(name) ? "bad" : /^run/i.test(name) ? "ok" : `c${name.length % 8}`;
      c.fillStyle = colour(tint);
      c.fillRect(a, top, Math.max(b - a, ratio), height);
      if (c.measureText(name).width + 12 * ratio < b - a)
        write(c, { fillStyle: colour("panel"), textAlign: "left", textBaseline: "middle" }, name, a + 6 * ratio, top + height / 2);
      first = row;
    }
  }
}

/** Play, scrub and speed. controls: {play, scrub, speed} elements. */
class Player {
  constructor(axis, { play, scrub, speed }) {
    Object.assign(this, { axis, play, scrub, speed, frame: 0 });
    scrub.max = Math.max(0, axis.time.length - 1);
    on(scrub, "input", () => { this.set(false); axis.setNow(axis.time[scrub.value]); });
    on(play, "click", () => this.set(!this.playing));
    axis.on("now", () => { scrub.value = axis.row(); scrub.setAttribute("aria-valuetext", `${axis.now.toFixed(3)} s`); });
  }
  get playing() { return this.axis.busy; }
  set(wanted, last = performance.now()) {
    cancelAnimationFrame(this.frame);
    this.axis.busy = wanted;
    this.play.textContent = wanted ? "Pause" : "Play";
    if (!wanted) return;
    this.frame = requestAnimationFrame((stamp) => {
      const { axis } = this, next = axis.now + parseFloat(this.speed.value) * Math.max(stamp - last, 0) / 1000;
      axis.setNow(next >= axis.view[0] && next < axis.view[1] ? next : axis.view[0]);
      this.set(true, stamp);
    });
  }
  /** Keys of a page of plots; true when the key was one of them. */
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches?.("input, select, summary, pre")) return false;
    const { axis } = this, step = (rows) => { this.set(false); axis.step(rows * (event.shiftKey ? 20 : 1)); };
    const actions = { ArrowLeft: () => step(-1), ArrowRight: () => step(1), Home: () => step(-Infinity), End: () => step(Infinity),
      "+": () => axis.zoom(0.5), "=": () => axis.zoom(0.5), "-": () => axis.zoom(2), 0: () => axis.reset(),
      " ": event.target.matches?.("button") ? undefined : () => this.set(!this.playing) };
    if (!actions[event.key]) return false;
    event.preventDefault();
    actions[event.key]();
    return true;
  }
}
