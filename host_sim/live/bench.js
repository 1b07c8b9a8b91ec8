// The page: what comes from the loop goes to drawing, plots and panels; what is done here goes back.
"use strict";

(() => {
  const hand = {}, wanted = { hand: null };
  let send = () => {}, now = null, scene = null, stale = true, strips = [], kept = null, answerTimer = 0;

  const say = (message) => send(message);
  const drawing = new Drawing(byId("mechanism"), ({ at, push, strong }) => {
    wanted.hand = { at, push, strong };
    if (!at && !push) tellHand();  // at once: a hidden page draws no more pictures
  });
  const control = new ControlPanel(byId("control"), say), effects = new EffectsPanel(byId("effects"), byId("add"), say);
  const faults = new FaultsPanel(byId("faults"), byId("end"), say), keys = new KeysPanel(byId("set"), byId("given"), byId("sets"), say);
  const events = new EventsPanel(byId("events"));

  document.querySelectorAll("[data-do]").forEach((button) => on(button, "click", () => {
    say({ do: button.dataset.do });
    if (button.dataset.do === "home") drawing.frame();
  }));
  for (const name of ["stiffness", "damping", "most"]) {
    on(byId(name), "change", () => { const v = Number(byId(name).value); if (v >= 0) hand[name] = v; });
  }

  for (const link of document.querySelectorAll("[data-save]")) Object.assign(link, { href: link.dataset.save + location.search, download: link.dataset.save });

  function greet(hello) {
    Object.assign(hand, hello.hand);
    for (const name of ["stiffness", "damping", "most"]) byId(name).value = Number(hand[name].toPrecision(3));
    control.offer(hello);
    faults.show(hello);
    byId("line").textContent = `esmc ${hello.version}, ${hello.bus === "virtual" ? "virtual bus" : hello.bus}`;
    for (const node of document.querySelectorAll("#control, [data-do]:not([data-do=home])")) node.hidden = !hello.controller;
    const motors = Array.from({ length: hello.motors }, (_, i) => `tau${i + 1}`), tint = (i) => ["c0", "c1", "c3", "c4"][i];
    kept = new Thinned(["error", ...motors, "s1", "s2", "force"]);
    byId("plots").replaceChildren();
    const strip = (options) => new Strip(byId("plots"), kept, options);
    strips = [
      ...(!hello.controller ? [] : [strip({ title: "Tracking error", unit: "mm", scale: 1e3, zero: true, least: 1e-3, series: [{ name: "error", label: "", colour: "c6" }] })]),
      strip({ title: "Torque", unit: "N m", least: 1e-3, series: motors.map((name, i) => ({ name, label: `motor ${i + 1}`, colour: tint(i) })) }),
      ...(!hello.controller ? [] : [strip({ title: "Sliding variables", unit: hello.channels[0] === "x" ? "m/s" : "rad/s", least: 1e-9,
        series: ["s1", "s2"].map((name, i) => ({ name, label: symbol(hello.channels[i]), colour: tint(i) })) })]),
      strip({ title: "Force of the hand", unit: "N", zero: true, least: 0.1, series: [{ name: "force", label: "", colour: "c1" }] })];
  }
  function showScene(next) {
    scene = next;
    byId("name").textContent = scene.name || "esmc live";
    byId("subtitle").textContent = `${scene.mechanism.type === "rr" ? "RR arm" : "5R five-bar"}; law ${scene.law}${/smc/.test(scene.law) ? `, ${scene.reaching}` : ""}; ${scene.rate_hz} Hz`;
    document.title = `${scene.name || "esmc"} · live`;
    if (JSON.stringify(drawing.geometry) !== JSON.stringify(scene.mechanism)) drawing.frame(scene.mechanism);
    control.show(scene);
    effects.show(scene);
    keys.show(scene);
  }
  function answer(text) {
    const box = byId("answer");
    box.textContent = text;
    box.hidden = false;
    effects.show(scene);  // nothing has changed
    events.add(now?.t, "refused", text);
    clearTimeout(answerTimer);
    answerTimer = setTimeout(() => { box.hidden = true; }, 15000);
  }
  function hear(message) {
    if (message.hello) greet(message.hello);
    if (message.scene) showScene(message.scene);
    for (const { t, kind, text } of message.events ?? []) {
      events.add(t, kind, text);
      if (/order|scene/.test(kind)) byId("answer").hidden = true;  // a later order has succeeded
    }
    for (const text of message.answers ?? []) answer(text);
    if (!message.samples) return;
    kept.add(message.samples);
    drawing.add(message.samples);
    const { error, force } = message.samples, last = error.length - 1;
    now = { ...message.now, error: error[last], size: force[last], taus: Object.keys(message.samples).filter((k) => k.startsWith("tau")).map((k) => message.samples[k][last]) };
    stale = true;
  }

  /** What a state means for the user. */
  const meanings = {
    ...phases,
    disabled: ["warn", "‖", "off", "The brake is closed. Start arms the drives."],
    testing: ["warn", "…", "testing", "Each motor gets a little torque and must answer as the model says."],
    waiting: ["warn", "…", "waiting", "The brake is closed until a controller on the bus has armed every drive."],
    armed: ["ok", "▶", "armed", "The drives obey the controller on the bus."],
    disarmed: ["bad", "!", "disarmed", "A drive is off with an error. The controller clears it, or Home puts everything back."],
    fault: ["bad", "!", "fault", "Torque off, latched. Reset clears it and arms again from where the mechanism is; Home puts it back to the beginning."],
  };
  function showState() {
    const detail = showVerdict(now, meanings);
    put(byId("detail"), now.injecting ? `The fault ${now.injecting.replaceAll("_", " ")} acts${now.state === "enabling" ? ": the drives cannot be armed before it is over. End it" : ""}.` : detail || (now.saturated ? "A torque is at its limit." : ""));
    for (const button of document.querySelectorAll("[data-do]")) {
      const fits = { start: now.state === "disabled", halt: /running|enabling|testing/.test(now.state), stop: !/disabled|fault/.test(now.state), reset: now.state === "fault" }[button.dataset.do];
      button.disabled = fits === false;
      button.classList.toggle("wanted", (button.dataset.do === "reset" && now.state === "fault") || (button.dataset.do === "start" && now.state === "disabled"));
    }
    put(byId("time"), `${now.t.toFixed(1)} s`);
    put(byId("error"), now.error === null ? "–" : amount(now.error, "mm", 1e3));
    put(byId("force"), amount(now.size, "N"));
    put(byId("torque"), `${now.taus.map((v) => sig(v, 2)).join(", ")} N m`);
    put(byId("late"), String(now.late));
  }

  /** The hand as it is now, at most once per picture. */
  function tellHand() {
    if (!wanted.hand) return;
    const { at, push, strong } = wanted.hand, size = hand.most * (strong ? 1 : 0.5);
    wanted.hand = null;
    say({ hand: { ...hand, at: at ?? null, push: push ? push.map((v) => v * size) : [0, 0] } });
  }
  let pictures = 0;
  function picture() {
    tellHand();
    if (stale && now) {
      stale = false;
      drawing.draw(now, hand.most);
      if (++pictures % 2 === 0) strips.forEach((strip) => strip.show());
      showState();
    }
    requestAnimationFrame(picture);
  }

  onLook(() => { stale = true; strips.forEach((strip) => strip.draw()); });
  send = connectPage(hear, "The bench has ended, or it serves enough pages already.");
  requestAnimationFrame(picture);
})();
