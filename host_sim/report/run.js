// The page of one run: its data, verdict, plots, mechanism.
"use strict";

// ---- Data -----------------------------------------------------------------------------------------------------------
const data = (() => { try { return JSON.parse(byId("data").textContent) ?? {}; } catch { return {}; } })();
const { rows = [], columns = [], scene_toml: scene = "" } = data, summary = data.summary ?? {}, mechanism = data.mechanism ?? {};
const count = rows.length, perRow = (f) => Float64Array.from({ length: count }, (_, row) => f(row));
/** Values of a column as numbers, gaps as NaN; undefined when the log does not have it. */
function column(name) {
  const index = columns.indexOf(name);
  return index < 0 || count === 0 ? undefined : perRow((row) => rows[row][index] ?? NaN);
}
/** Smallest and largest of some columns over rows [from, to). */
function extent(lists, from = 0, to = count) {
  let lo = Infinity, hi = -Infinity;
  for (const values of lists)
    for (let row = from; row < to; ++row) { if (values[row] < lo) lo = values[row]; if (values[row] > hi) hi = values[row]; }
  return [lo, hi];
}
const time = column("t") ?? perRow((row) => row);
const [x, y, xRef, yRef] = ["x", "y", "x_ref", "y_ref"].map(column), hasReference = x && y && xRef && yRef;
const surfaces = data.surfaces ?? {}, torqueLimits = data.torque_limit ?? [], oneLimit = new Set(torqueLimits).size === 1;
const faultNames = (summary.supervisor?.faults ?? []).map((fault) => fault?.name ?? String(fault)).join(", ");
const faultLead = 0.2;  // s before a fault that the page shows first
const faultTime = summary.supervisor?.fault_t_s ?? Infinity;
/** The first row that the fault has spoilt: what comes later is a fall without torque. */
const faultRow = (() => { const row = time.findIndex((t) => t >= faultTime); return row < 0 ? count : row; })();
const fiveBar = mechanism.type === "five_bar", baseJoints = fiveBar ? ["theta11", "theta21"] : ["theta1", "theta2"];
const joints = (fiveBar ? ["theta11", "theta12", "theta21", "theta22"] : ["theta1", "theta2"]).map(column);
const motors = ["tau1", "tau11", "tau2", "tau21", "tau12", "tau22"].filter((name) => columns.includes(name));
const tintOf = (name) => ({ tau1: "c0", tau11: "c0", tau2: "c1", tau21: "c1", tau12: "c2" })[name] ?? "c3";
const drawable = x && y && joints.every((values) => values) && joints[0].some(Number.isFinite);
/** Where the mechanism is, row by row; the effector as logged. */
const poses = drawable ? Array.from({ length: count }, (_, row) => (
  { ...Mechanism.pose(mechanism, joints.map((values) => values[row])), effector: [x[row], y[row]] })) : [];
const reference = hasReference ? Array.from({ length: count }, (_, row) => [xRef[row], yRef[row]]) : [];
/** The path of the reference without its later laps, whose dashes would fill the gaps of the first. */
const firstLap = (() => {
  const visits = new Map(), box = Mechanism.box(reference), cell = Math.max(box.x[1] - box.x[0], box.y[1] - box.y[0], 1e-9) / 80;
  let length = 0, last;
  return reference.map((point) => {
    const [cx, cy] = point.map((v) => Math.round(v / cell));
    length += last ? Math.hypot(point[0] - last[0], point[1] - last[1]) || 0 : 0;
    last = point;
    let old = false;
    for (let i = cx - 1; i <= cx + 1; ++i) for (let j = cy - 1; j <= cy + 1; ++j) old ||= length - (visits.get(`${i},${j}`) ?? length) > 8 * cell;
    if (!visits.has(`${cx},${cy}`)) visits.set(`${cx},${cy}`, length);
    return old ? [NaN, NaN] : point;
  });
})();
const mode = (label, formula, values) => {
  const [lo, hi] = extent([values], 0, Math.max(faultRow, 1));
  return { label, formula, values, margin: lo < 0 && hi > 0 ? 0 : Math.min(Math.abs(lo), Math.abs(hi)) };
};
const modes = !drawable ? [] : (() => {
  const sines = Array.from({ length: count }, (_, row) => Mechanism.modes(mechanism, joints.map((values) => values[row])));
  const list = (fiveBar ? ["1", "2"] : [""]).map((name, j) => (
    mode(`Working mode${name && " "}${name}`, `sin ${symbol(`theta${name}2`)}`, sines.map(({ working }) => working[j]))));
  if (fiveBar) list.push(mode("Assembly mode", "sin(φ₁₂+φ₂₂)", sines.map(({ assembly }) => assembly)));
  return list;
})();

// ---- Verdict and facts ----------------------------------------------------------------------------------------------
function showVerdict() {
  const { tracking, torque, bus, supervisor, verdict } = summary, faults = supervisor?.faults ?? [];
  const faultWhen = faultTime < Infinity ? ` at t = ${sig(faultTime)} s` : "", word = String(verdict?.word ?? "CHECK");
  const level = { OK: "ok", FAULT: "bad" }[word] ?? "warn", reasons = (verdict?.reasons ?? ["the summary is missing"]).map(String);
  const shown = level === "ok" ? reasons.length : 1;
  const put = (selector, ...content) => query(`#verdict ${selector}`).append(...content);
  byId("verdict").dataset.level = level;
  put(".symbol", { ok: "✓", warn: "!", bad: "✕" }[level]);
  put(".headline", el("b", {}, word), " ", faults.length ? reasons[0] : sentence(reasons.slice(0, shown)));
  put(".detail", sentence(reasons.slice(shown)));
  const error = (name, unit, suffix, scale) => [name, amount(tracking?.[`settled_rms_${suffix}`], unit, scale),
    !tracking ? "no reference" : tracking[`settled_max_${suffix}`] >= 0 ? `RMS settled, max ${amount(tracking[`settled_max_${suffix}`], unit, scale)}` : "not settled"];
  const tiles = [error("Effector error", "mm", "m", 1e3), error("Base joint error", "rad", "rad", 1),
    ["Faults", faults.length, faultNames ? faultNames + faultWhen : "none"],
    ["Real-time factor", `${sig(summary.real_time_factor)}×`, `${amount(summary.simulated_s, "s")} in ${amount(summary.wall_s, "s")}`],
    ["Largest torque", amount(torque?.max_nm, "N m"), torqueLimits.length
      ? oneLimit ? `limit ${amount(torqueLimits[0], "N m")}` : `limits ${torqueLimits.map((v) => sig(v)).join(", ")} N m` : "no limit set"],
    bus && ["Bus load", amount(bus.load, "%", 100), `${plural(bus.frames, "frame")}, ${bus.lost} lost`],
    ["Digest", el("span", { class: "mono", style: "font-size: 14px" }, summary.digest ?? "–"), `seed ${summary.seed ?? "–"}`]];
  for (const [name, value, note] of tiles.filter(Boolean))
    put(".tiles", el("div", {}, el("dt", { class: "note" }, name), el("dd", {}, value), el("dd", { class: "note" }, note)));
}
function showFacts() {
  const words = { five_bar: "planar 5R five-bar", rr: "two-link RR arm", sim: "simulated without a bus", hil: "through CAN frames" };
  const { law, ticks: logged } = summary, facts = [words[mechanism.type], law && `law ${law}`, words[data.kind], logged && plural(logged, "tick")];
  const texts = { subtitle: facts.filter(Boolean).join(" · "), scene, thinned: logged > count && `Drawn from ${count} of ${logged} ticks.`,
    version: data.version && `esmc ${data.version}`, command: data.command,
    versions: [summary.seed !== undefined && `seed ${summary.seed}`, data.version && `esmc ${data.version}`, data.compiler, summary.integrator && `integrator ${summary.integrator}`]
      .filter(Boolean).join("; ") };
  for (const [id, text] of Object.entries(texts)) byId(id).textContent = text || "";
  document.title = query("h1").textContent = summary.scene ?? "esmc report";
  const show = (name, value) => {
    if (Array.isArray(value) && value.length && value.every((one) => one?.constructor === Object)) {
      value.forEach((one, k) => byId("summary").append(el("tr", {}, el("th", {}, `${name}[${k}]`),
        el("td", {}, Object.entries(one).map(([key, inner]) => `${key} ${typeof inner === "number" ? sig(inner, 4) : inner}`).join(", ")))));
    } else if (value?.constructor === Object) for (const [key, inner] of Object.entries(value)) show(name ? `${name}.${key}` : key, inner);
    else byId("summary").append(el("tr", {}, el("th", {}, name), el("td", {}, typeof value === "string" ? value : JSON.stringify(value))));
  };
  show("", summary);
}

// ---- Plots ----------------------------------------------------------------------------------------------------------
const plots = [], planes = [];
function buildPlots(axis) {
  const host = byId("plots"), states = columns.includes("state") ? rows.map((row) => String(row[columns.indexOf("state")])) : undefined;
  const marks = faultTime < Infinity ? [{ t: faultTime, label: `fault: ${faultNames || "latched"}`, colour: "bad" }] : [];
  const unnamed = marks.map(({ t, colour: tint }) => ({ t, label: "", colour: tint }));
  const trace = (name, tint, style = "line", values = column(name), label = symbol(name)) => ({ label, values, colour: tint, style });
  const add = (title, unit, series, options) => {
    const known = series.filter((s) => s.values?.some(options?.log ? (v) => v > 0 : Number.isFinite));
    if (known.length) plots.push(new TimePlot(host, axis, { title, unit, series: known, marks: plots.length ? unnamed : marks, until: faultTime, ...options }));
  };
  const angleError = (a, b) => a && b && perRow((row) => Math.abs(Math.atan2(Math.sin(a[row] - b[row]), Math.cos(a[row] - b[row]))));
  const distance = hasReference && perRow((row) => 1e3 * Math.hypot(xRef[row] - x[row], yRef[row] - y[row]));
  add("Effector error", "mm from the reference", [trace("|e|", "c6", "line", distance)], { log: true });
  add("Base joints", "rad", baseJoints.flatMap((name, k) => [
    trace(`${name}_meas`, `c${k}`, "under"), trace(name, `c${k}`), trace(`${name}_ref`, "ink", "ref")]));
  add("Base joint error", "rad", baseJoints.map((name, k) => (
    trace(`|e| ${name}`, `c${k}`, "line", angleError(column(`${name}_ref`), column(name))))), { log: true });
  const limits = oneLimit ? [{ value: torqueLimits[0], label: "limit", colour: "bad" }]
    : torqueLimits.map((value, k) => ({ value, label: `limit ${symbol(motors[k] ?? "")}`, colour: tintOf(motors[k]) }));
  add("Torque", "N m", motors.flatMap((name) => [trace(`${name}_cmd`, tintOf(name), "under"), trace(name, tintOf(name), "through")]), { limits });
  for (const [unit, angular] of [["m/s", false], ["rad/s", true]]) {
    const names = columns.filter((name) => name.startsWith("s_") && /phi|theta|^s_\d/.test(name) === angular)
      .filter((name) => column(name).some((v) => v !== 0));  // a law leaves channels that it does not use at zero
    const layer = surfaces[names[0]]?.layer;
    add("Sliding variables s", `${unit}; ${layer ? `layer ±${sig(layer)} ${unit}; ` : ""}click a name to show it`, names
      .map((name, k) => ({ ...trace(name, `c${k % 8}`, k < 8 ? "through" : "ref", column(name), symbol(name.slice(2))), hidden: k > 1 })),
      { zero: true, limits: layer ? [{ value: layer, colour: "muted" }] : [] });
  }
  add("Chatter", "N m, mean change of torque from tick to tick", [trace("|Δτ|", "c3", "line", column("chatter"))], { log: true });
  add("Modes", fiveBar ? "the sign of each: working modes of the legs, assembly mode" : "sin θ₂, whose sign is the working mode",
    modes.map(({ formula, values }, k) => ({ label: formula, values, colour: `c${k % 2 ? 1 : k ? 6 : 0}` })), { zero: true });
  const { start_s: first, bin_s: bin, load = [] } = data.bus_load ?? {};
  if (load.some((share) => share > 0)) {
    const values = load.map((share) => 100 * (share ?? NaN)), times = load.map((_, k) => first + k * bin);
    plots.push(new TimePlot(host, axis, { title: "Bus load", unit: `% of the bus time, over ${duration(bin)}`, time: times, marks: unnamed, zero: true,
      series: [{ label: "load", values, colour: "c5" }] }));
  }
  if (states) plots.push(new TimePlot(host, axis, { title: "Supervisor", height: 52, bands: states, marks }));
}

/** The phase plane of the two first sliding variables whose error the log has, and the spectrum of the torques. */
function buildPlanes(axis) {
  const host = byId("planes"), spectrum = data.spectrum ?? {};
  const error = (name, angular) => {
    const [wanted, is] = [column(`${name}_ref`), column(name)];
    return wanted && is && perRow((row) => (row >= faultRow ? NaN : angular ? Math.atan2(Math.sin(wanted[row] - is[row]), Math.cos(wanted[row] - is[row])) : wanted[row] - is[row]));
  };
  const channels = (names, angular) => names.map((name, k) => ({ label: symbol(name), colour: angular ? `c${k}` : `c${[6, 3][k]}`, e: error(name, angular),
    s: column(`s_${name}`), ...surfaces[`s_${name}`] })).filter(({ e, s, lambda }) => e?.some(Number.isFinite) && s?.some((v) => v !== 0) && lambda > 0);
  const [pair, unit] = [[channels(["x", "y"], false), "m"], [channels(baseJoints, true), "rad"]].find(([list]) => list.length) ?? [[]];
  if (pair.length) planes.push(new PhasePlane(host, axis, pair, unit));
  const torques = (spectrum.amplitudes ?? []).map((values, k) => ({ label: symbol(motors[k] ?? ""), colour: tintOf(motors[k]), values }));
  if (spectrum.step_hz > 0 && torques.some(({ values }) => values.some((v) => v > 0))) planes.push(new SpectrumPlot(host, spectrum.step_hz, torques));
  if (!host.children.length) host.remove();
}

// ---- Mechanism ------------------------------------------------------------------------------------------------------
class MechanismView {
  constructor(axis) {
    this.axis = axis;
    this.box = Mechanism.box([...poses.flatMap(({ bases, elbows, effector }) => [...bases, ...elbows, effector]), ...reference]);
    const size = Math.max(...[this.box.x, this.box.y].map(([lo, hi]) => hi - lo)), worst = summary.tracking?.settled_max_m;
    this.factor = hasReference && worst > 0 ? Math.max(1, 10 ** Math.floor(Math.log10(0.1 * size / worst))) : 1;
    byId("magnify").parentNode.hidden = this.factor === 1;
    byId("magnify").after(` deviation from the reference drawn ${this.factor}× larger`);
    on(byId("magnify"), "change", () => this.draw());
    axis.on("now", () => this.show());
    this.show();
  }
  show() {
    const row = this.axis.row();
    byId("modes").replaceChildren(...modes.map(({ label, formula, values, margin }) => el("tr", {}, el("th", {}, label),
      ...[values[row] > 0 ? "+" : "−", `${formula} = ${sig(values[row])}`, margin ? `margin ${sig(margin, 2)}` : "changes sign"]
        .map((text) => el("td", {}, text)))));
    this.draw();
  }
  draw() {
    const { c, width, height } = prepare(byId("mechanism")), row = this.axis.row(), thin = Math.ceil(count / 2000);
    const view = Mechanism.fit(this.box, width, height - 34, 26), step = Mechanism.drawGrid(c, view, colour);
    const more = byId("magnify").checked ? this.factor - 1 : 0, from = more ? this.axis.row(time[0] + 0.25) : 0;
    const trail = [];
    for (let k = from; k <= row; k += k + thin > row ? 1 : thin) {
      const [px, py] = poses[k].effector, [rx, ry] = reference[k] ?? [px, py];
      trail.push(more ? [px + more * (px - rx), py + more * (py - ry)] : [px, py]);
    }
    Mechanism.drawPath(c, view, trail, { strokeStyle: colour("c6"), lineWidth: 1.8 });
    if (hasReference) Mechanism.drawPath(c, view, firstLap, { strokeStyle: colour("ink"), lineWidth: 1.2 }, [5, 4]);
    Mechanism.drawPose(c, view, poses[row], colour);
    write(c, { fillStyle: colour("muted"), textBaseline: "bottom", textAlign: "right" },
      `${hasReference ? "dashed: reference; " : ""}grid ${sig(1e3 * step)} mm`, width, height);
    const readout = `t = ${time[row].toFixed(4)} s    x = ${(1e3 * poses[row].effector[0]).toFixed(2)} mm    y = ${(1e3 * poses[row].effector[1]).toFixed(2)} mm`;
    write(c, { fillStyle: colour("ink"), textAlign: "left" }, readout.replaceAll("-", "−"), 0, height - 16);
  }
}

// ---- Workspace and durations ----------------------------------------------------------------------------------------
function buildMap(axis) {
  const map = data.workspace;
  if (!map?.force || !(map.columns > 1 && map.rows > 1)) return void byId("workspace").remove();
  const view = new WorkspaceMap.View(byId("map"), { map, geometry: mechanism, side: fiveBar ? data.assembly_mode ?? 0 : 0, reference: firstLap,
    pose: () => (axis && drawable ? poses[axis.row()] : undefined), legend: byId("map-legend"), output: byId("map-now") });
  byId("map-note").textContent = [map.force.length ? "Colour: force that the motors can exert in every direction, beside gravity"
    : "No torque limit: reach alone", `working mode ${(data.working_mode ?? []).slice(0, fiveBar ? 2 : 1).map((s) => (s > 0 ? "+" : "−")).join(" ")}`].join("; ");
  axis?.on("now", () => view.show());
  return view;
}
function buildHistograms() {
  const list = data.histograms ?? [];
  byId("histograms").append(...list.map(histogramFigure));
  if (!list.some(({ title }) => /latency/i.test(title))) byId("histograms").append(el("p", { class: "note" },
    data.kind === "sim" ? "No latency: torques were applied directly, without a bus."
      : data.kind === "plant" ? "No latency: the controller's report has it, where it runs in real time."
        : "No latency: in lockstep frames take no time, unless the scene names the effect bit_timing."));
}

// ---- Start ----------------------------------------------------------------------------------------------------------
showVerdict();
showFacts();
if (count > 0) {
  const axis = new TimeAxis(Array.from(time));
  if (typeof uPlot === "undefined") byId("plots").append(el("p", { class: "note" },
    "There are no plots: this esmc was built without uPlot. host_sim/setup demo fetches it; then build again."));
  const map = buildMap(axis), view = drawable ? new MechanismView(axis) : undefined;
  if (!drawable) byId("drawing").remove();
  const player = new Player(axis, { play: byId("play"), scrub: byId("scrub"), speed: byId("speed") });
  buildPlots(axis);
  buildPlanes(axis);
  on(query(".bench"), "keydown", (event) => player.key(event));
  const redraw = () => { [...plots, ...planes].forEach((plot) => plot.draw()); view?.draw(); map?.draw(); };
  onLook(redraw);
  if (view) new ResizeObserver(() => view.draw()).observe(byId("mechanism"));
  if (map) new ResizeObserver(() => map.draw()).observe(byId("map"));
  axis.setNow(Math.min(faultTime, axis.end));
  if (faultTime <= axis.end) {  // what led to it; all is a double click away
    axis.setView(faultTime - faultLead, faultTime + 0.25 * faultLead);
    byId("thinned").append(" Shown: what led to the fault.");
  }
} else {
  for (const one of [".mechanism", ".plots"]) query(one).remove();
  query(".bench").before(el("p", { class: "panel empty" }, "No tick was recorded: there is nothing to plot."));
  const map = buildMap();
  if (map) { onLook(() => map.draw()); new ResizeObserver(() => map.draw()).observe(byId("map")); }
}
buildHistograms();
