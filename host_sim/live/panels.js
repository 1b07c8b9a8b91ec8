// Forms of the bench: control, effects, faults, keys. `say` sends a message to the loop.
"use strict";

const effectTemplates = {
  payload: 'mass = 0.2', viscous_friction: 'coefficient = [0.02, 0.02]', coulomb_friction: 'torque = [0.02, 0.02], regularised = 0.05',
  joint_flexibility: 'stiffness = 200.0, damping = 0.2, rotor_inertia = 1e-4', backlash: 'gap = 0.01',
  external_force: 'kind = "pulse", force = [1.0, 0.0]', torque_lag: 'time_constant = 0.002', torque_saturation: 'limit = 0.5',
  torque_ripple: 'amplitude = 0.05, per_turn = 21.0', thermal_limit: 'continuous = 0.3, time_constant = 5.0', encoder: 'bits = 12',
  noise: 'sigma = 1e-3', bias: 'angle = [0.01, 0.01]', delay: 'ticks = 2', jitter: 'sigma = 2e-4', compute_delay: 'time = 1e-3',
};

/** Law, reaching law, gains: what has been changed is set, together. */
class ControlPanel {
  constructor(form, say) {
    Object.assign(this, { form, known: {} });
    on(form, "submit", (event) => {
      event.preventDefault();
      const changed = this.fields().filter(({ name, value }) => value.trim() !== this.known[name] && value.trim() !== "");
      if (changed.length) say({ set: changed.map(({ name, value }) => `control.${name}=${value.trim()}`) });
    });
    on(form.elements.law, "change", () => this.suit());
  }
  /** The choices of a bench, from the program's own tables of names. */
  offer({ laws, reaching_laws: reachings }) {
    const { law, reaching } = this.form.elements;
    for (const [select, names] of [[law, laws], [reaching, reachings]])
      if (!select.length) select.append(...names.map((name) => el("option", {}, name)));
  }
  fields() { return [...this.form.elements].filter(({ name }) => name); }
  /** Greys the fields that the law does not use. */
  suit() {
    const { law, reaching, lambda, gain, layer, kp, kd } = this.form.elements, sliding = /smc/.test(law.value);
    for (const field of [reaching, gain, layer]) field.disabled = !sliding;
    lambda.disabled = law.value === "pd";
    for (const field of [kp, kd]) field.disabled = sliding;
  }
  show(scene) {
    for (const field of this.fields()) {
      if (field.value === (this.known[field.name] ?? "") || this.known[field.name] !== scene[field.name]) field.value = scene[field.name];
      this.known[field.name] = scene[field.name];
    }
    this.suit();
  }
}

/** A line per effect: on or off, its parameters. */
class EffectsPanel {
  constructor(list, add, say) {
    Object.assign(this, { list, say, rows: [] });
    add.append(el("option", { value: "" }, "choose …"), ...Object.keys(effectTemplates).map((type) => el("option", {}, type)));
    on(add, "change", () => {
      const type = add.value;
      add.value = "";
      if (!type || this.rows.some((row) => row.type === type)) return;
      this.rows.push({ type, text: effectTemplates[type], on: true });
      this.render();
      this.tell();
    });
  }
  tell() { this.say({ effects: this.rows.filter((row) => row.on).map(({ type, text }) => `type = "${type}"${text ? `, ${text}` : ""}`) }); }
  show({ effects }) {
    for (const row of this.rows) row.on = false;
    for (const { type, parameters: text } of effects) {
      const row = this.rows.find((r) => r.type === type && !r.on) ?? this.rows[this.rows.push({ type }) - 1];
      Object.assign(row, { text, on: true });
    }
    this.render();
  }
  render() {
    this.list.replaceChildren(...this.rows.map((row, k) => {
      const id = `effect-${k}`, box = el("input", { type: "checkbox", id }), field = el("input", { value: row.text, "aria-label": `parameters of ${row.type}`, spellcheck: "false" });
      const gone = el("button", { type: "button", "aria-label": `remove ${row.type}`, title: "remove" }, "×");
      box.checked = row.on;
      on(box, "change", () => { row.on = box.checked; this.tell(); });
      on(field, "change", () => { row.text = field.value.trim(); if (row.on) this.tell(); });
      on(gone, "click", () => { const was = row.on; this.rows.splice(k, 1); this.render(); if (was) this.tell(); });
      return el("li", {}, box, el("label", { for: id }, row.type), field, gone);
    }));
    if (!this.rows.length) this.list.append(el("li", { class: "note" }, "", "none"));
  }
}

class FaultsPanel {
  constructor(form, end, say) {
    this.form = form;
    const { fault, ms } = form.elements;
    on(fault, "change", () => { ms.value = this.usual.get(fault.value) ?? ""; });
    on(form, "submit", (event) => {
      event.preventDefault();
      say({ inject: { fault: fault.value, drive: Number(form.elements.drive.value), ms: ms.value === "" ? null : Number(ms.value) } });
    });
    on(end, "click", () => say({ inject: null }));
  }
  show({ faults, motors }) {
    const { fault, drive, ms } = this.form.elements;
    this.usual = new Map(faults.map(({ name, ms: usual }) => [name, usual]));
    fault.replaceChildren(...faults.map(({ name }) => el("option", { value: name }, name.replaceAll("_", " "))));
    drive.replaceChildren(...Array.from({ length: motors }, (_, i) => el("option", {}, String(i + 1))));
    fault.value = faults.some(({ name }) => name === "drive_error") ? "drive_error" : faults[0].name;
    ms.value = this.usual.get(fault.value) ?? "";
  }
}

class KeysPanel {
  constructor(form, given, list, say) {
    this.list = list;
    on(form, "submit", (event) => {
      event.preventDefault();
      const text = form.elements.set.value.trim();
      if (text) say({ set: [text] });
    });
    on(given, "click", () => say({ set: [] }));
  }
  show({ sets }) { this.list.textContent = sets.map((s) => `--set ${s}`).join("\n"); }
}
