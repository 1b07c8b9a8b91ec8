// The operator's page: what the console hears is shown; what is done here becomes its commands.
"use strict";

(() => {
  let send = () => {}, hello = null, now = null, has = false, stale = true, strips = [], kept = null, shownRecords = null, shownPoints = null;
  const drawing = new Drawing(byId("mechanism"), null), events = new EventsPanel(byId("events"));
  const order = (...words) => send({ do: words.map(String) });

  // Stops first: they work from everywhere, on every page, at any time. Of a second finger there is no click.
  for (const how of ["halt", "off"])
    for (const type of ["pointerdown", "click"]) on(byId(how), type, () => send({ stop: how }));
  on(document, "keydown", (event) => { if (event.key === "Escape") send({ stop: "halt" }); });
  on(byId("take"), "click", () => send({ take: true }));

  document.querySelectorAll("[data-do]").forEach((button) => on(button, "click", () => order(button.dataset.do)));
  const pad = new JogPad(byId("pad"), (way) => {
    if (!hello) return;
    send({ jog: way && [hello.axes[way[0]], String(way[1] * Math.abs(Number(byId("speed").value)))] });
  });
  let sent = "";
  const override = (value) => { if (value) order("override", sent = value); };
  on(byId("override"), "change", ({ target }) => override(target.value));
  on(byId("override"), "keydown", ({ key, target }) => { if (key === "Enter" && target.value === sent) override(sent); });  // once more
  on(byId("goto"), "submit", (event) => {
    event.preventDefault();
    const { a, b } = event.target.elements;
    if (a.value.trim() && b.value.trim()) order("goto", a.value.trim(), b.value.trim());
  });
  on(byId("teach"), "submit", (event) => {
    event.preventDefault();
    const { point } = event.target.elements;
    if (point.value.trim()) order("teach", point.value.trim());
  });
  document.querySelectorAll("[data-file]").forEach((form) => on(form, "submit", (event) => {
    event.preventDefault();
    const path = form.elements.path.value.trim();
    if (path) order(form.dataset.file, path);
  }));
  on(byId("gains"), "submit", (event) => {
    event.preventDefault();
    for (const { name, value, defaultValue } of event.target.querySelectorAll("input"))
      if (value.trim() && value !== defaultValue) order("set", `control.${name.replace("_", ".")}`, value.trim());
  });

  function greet(next) {
    hello = next;
    byId("name").textContent = hello.name || "esmc operate";
    document.title = `${hello.name || "esmc"} · operate`;
    byId("subtitle").textContent = `${hello.mechanism.type === "rr" ? "RR arm" : "5R five-bar"}; ${hello.rate_hz} Hz`;
    byId("line").textContent = `esmc ${hello.version}, ${hello.scene}`;
    byId("unit").textContent = hello.unit;
    query("[data-do=home]").hidden = !hello.homes;
    document.querySelectorAll(".axis").forEach((node, i) => { node.textContent = `${symbol(hello.axes[i])}, ${hello.unit}`; });
    byId("speed").value ||= Number((hello.speed / 4).toPrecision(2));
    byId("speed").max = hello.speed;
    pad.name(hello.axes);
    drawing.frame(hello.mechanism);
    kept = new Thinned(["a1", "a2", "tau1", "tau2", "error"]);
    byId("plots").replaceChildren();
    const pair = (name) => [0, 1].map((i) => ({ name: `${name}${i + 1}`, label: symbol(hello.joints[i]), colour: `c${i}` }));
    const strip = (options) => new Strip(byId("plots"), kept, options);
    strips = [strip({ title: "Joints", unit: "rad", least: 1e-3, series: pair("a") }), strip({ title: "Torque", unit: "N m", least: 1e-3, series: pair("tau") }),
      strip({ title: "Tracking error", unit: "mm", scale: 1e3, zero: true, least: 1e-3, series: [{ name: "error", label: "", colour: "c6" }] })];
  }

  /** With four motors the base joints are the first and the third. */
  const base = (joints) => (joints.length > 3 ? [joints[0], joints[2]] : joints.slice(0, 2));
  /** Coordinates of the drawing, from base joints and effector: the passive joints are not sent. */
  function coordinates({ effector, joints }) {
    if (hello.mechanism.type === "rr") return joints.map(({ angle }) => angle);
    if (!effector) return [];
    const inner = base(joints).map(({ angle }) => angle);
    return [...effector, ...Mechanism.legs(hello.mechanism).flatMap(({ side, base: from, l1 }, j) => {
      const [x, y] = [from + side * l1 * Math.cos(inner[j]), l1 * Math.sin(inner[j])];
      return [inner[j], Math.atan2(effector[1] - y, side * (effector[0] - x)) - inner[j]];
    })];
  }
  /** Rows of t, x, y, errors, and angle and torque of each motor. */
  function plot(rows) {
    const pick = (i) => rows.map((row) => row[i]), second = rows.at(-1)[11] === null ? 7 : 9;
    const samples = { t: pick(0), x: pick(1), y: pick(2), xd: rows.map((r) => r[1] + r[3]), yd: rows.map((r) => r[2] + r[4]),
      a1: pick(5), tau1: pick(6), a2: pick(second), tau2: pick(second + 1), error: rows.map((r) => (r[3] === null ? null : Math.hypot(r[3], r[4]))) };
    kept.add(samples);
    drawing.add(samples);
  }
  function hear(message) {
    send({ here: message.n });  // the sign of life: this page runs and has heard of now
    if (message.hello) greet(message.hello);
    for (const { t, kind, text } of message.events ?? []) {
      events.add(t, kind, text);
      if (kind === "refused") answer(text);
      if (kind === "order") byId("answer").hidden = true;
    }
    for (const text of message.answers ?? []) answer(text);
    if (message.rows) plot(message.rows);
    has = message.word;
    if (message.now) now = message.now;
    stale = true;
  }
  function answer(text) {
    byId("answer").textContent = text;
    byId("answer").hidden = false;
  }

  const meanings = {
    ...phases,
    disabled: ["warn", "‖", "off", "Arm enables; the mechanism then holds its pose."],
    testing: ["warn", "…", "testing", "Each motor in turn gets a little torque: the sign test, or homing."],
    fault: ["bad", "!", "fault", "Latched. Look at the mechanism first; Reset acknowledges, then Arm."],
  };
  function showRecords() {
    const texts = now.faults.map(({ name, axis, count, time_s: t, drive_error: error, measured, limit, where, unit }) => [name.replaceAll("_", " "),
      axis === null ? "" : `, axis ${axis}`, where ? `, ${symbol(where)}` : "", limit === undefined ? "" : `: ${sig(measured)} ${unit}, limit ${sig(limit)}`,
      error ? `, drive error 0x${error.toString(16)}` : "", `; ${plural(count, "time")}, last at ${t.toFixed(3)} s`].join(""));
    if (texts.join() === shownRecords) return;
    shownRecords = texts.join();
    byId("records").replaceChildren(...(texts.length ? texts : ["none"]).map((text) => el("li", { class: "mono" }, text)));
  }
  function showPoints() {
    const points = Object.entries(now.points ?? {}), texts = points.map(([name, at]) => `${name}: ${at.map((v) => sig(v, 4)).join(", ")} ${hello.unit}`);
    if (texts.join() !== shownPoints) {
      shownPoints = texts.join();
      byId("points").replaceChildren(...points.map(([name], i) => {
        const go = el("button", { type: "button", "aria-label": `go to ${name}` }, "Go");
        on(go, "click", () => order("goto", name));
        return el("li", {}, el("span", {}, texts[i]), go);
      }));
    }
  }
  function showGains() {
    const gains = Object.entries(now.parameters).slice(0, 4), fields = byId("gains").querySelector(".fields");
    if (!fields.children.length) fields.append(...gains.map(([name]) => el("label", {}, symbol(name), el("input", { name, inputmode: "decimal" }))));
    [...fields.querySelectorAll("input")].forEach((field, i) => {
      const value = String(Number(gains[i][1].value.toPrecision(7)));
      field.disabled = !gains[i][1].writable || now.state !== "disabled" || !has;
      if (field.defaultValue === value) return;
      field.defaultValue = value;
      field.value = value;
    });
  }
  function showState() {
    const detail = showVerdict(now, meanings), running = now.state === "running", able = has && now.silent_s === null;
    if (now.silent_s !== null) {
      byId("verdict").dataset.level = "bad";
      put(query(".symbol"), "!");
      put(byId("state"), "not heard");
      put(byId("detail"), `Nothing from the controller for ${now.silent_s.toFixed(0)} s: all that is shown is old. A stop is sent until it is heard.`);
    } else put(byId("detail"), now.busy && running ? `${now.busy} …` : now.zero_known ? detail : "The zero is not confirmed: Home, or Zero in the zero pose.");
    const fits = { arm: now.state === "disabled" && now.fault === "none", run: now.state === "disabled" && now.fault === "none", hold: running, resume: running && now.pace === "held",
      reset: now.fault !== "none", zero: now.state === "disabled", home: now.state === "disabled" && now.fault === "none", store: now.state === "disabled" && now.store !== "none" };
    for (const button of document.querySelectorAll("[data-do]")) {
      button.disabled = !able || !fits[button.dataset.do];
      button.classList.toggle("wanted", able && ((button.dataset.do === "reset" && now.fault !== "none") || (button.dataset.do === "arm" && fits.arm)));
    }
    if (!running) pad.release();  // a button disabled while pressed fires no release event
    byId("override").hidden = !has || now.source !== "reference";
    byId("watching").hidden = has;
    const joints = base(now.joints);
    put(byId("effector"), now.effector ? `${now.effector.map((v) => sig(v * 1e3, 4)).join(", ")} mm` : "–");
    put(byId("error"), now.error ? amount(Math.hypot(...now.error), "mm", 1e3) : "–");
    put(byId("torque"), joints.length ? `${joints.map(({ torque }) => sig(torque, 2)).join(", ")} N m` : "–");
    put(byId("source"), now.pace === "full" ? now.source : `${now.source}, ${now.pace}`);
    showRecords();
    showPoints();
    for (const button of document.querySelectorAll("#goto [type=submit], [data-file=run] button, #points button, #pad button")) button.disabled = !able || !running || now.source !== "stream";
    query("[data-file=capture] button").disabled = !able || (now.state !== "disabled" && now.state !== "fault");
    showGains();
  }
  let pictures = 0;
  function picture() {
    if (stale && now && hello) {
      stale = false;
      const wish = now.effector && now.error && now.state !== "disabled" ? now.effector.map((v, i) => v + now.error[i]) : [null, null];
      if (now.effector) drawing.draw({ q: coordinates(now), desired: wish, anchor: null, force: [0, 0], brake: false }, 1);
      if (++pictures % 2 === 0) strips.forEach((strip) => strip.show());
      showState();
    }
    requestAnimationFrame(picture);
  }
  onLook(() => { stale = true; strips.forEach((strip) => strip.draw()); });
  send = connectPage(hear, "esmc operate has ended, or it serves enough pages already.");
  requestAnimationFrame(picture);
})();
