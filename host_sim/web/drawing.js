// The mechanism as it stands now, the way it came, what it is to do, and the hand that pulls at it.
"use strict";

const trailSeconds = 2;

class Drawing {
  /** told(hand): what the hand does now, {at: [x, y] or null, push: [fx, fy]}; null: a picture without a hand. */
  constructor(canvas, told) {
    Object.assign(this, { canvas, told, trail: [], wish: [], held: null, keys: new Set(), strong: false });
    if (!told) return;
    const at = (event) => {
      const box = canvas.getBoundingClientRect();
      return this.view.toWorld([event.clientX - box.left, event.clientY - box.top]);
    };
    on(canvas, "pointerdown", (event) => {
      if (!this.view || event.button > 0) return;
      canvas.setPointerCapture(event.pointerId);
      this.hold(at(event));
    });
    on(canvas, "pointermove", (event) => { if (this.held) this.hold(at(event)); });
    for (const type of ["pointerup", "pointercancel", "lostpointercapture"]) on(canvas, type, () => this.hold(null));
    on(canvas, "keydown", (event) => this.key(event, true));
    on(canvas, "keyup", (event) => this.key(event, false));
    on(canvas, "blur", () => { this.keys.clear(); this.tell(); });
    const leave = () => { this.keys.clear(); this.hold(null); this.tell(); };
    for (const type of ["blur", "pagehide"]) on(window, type, leave);
    on(document, "visibilitychange", () => { if (document.hidden) leave(); });
  }
  key(event, down) {
    const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    this.strong = event.shiftKey;
    if (event.key === "Escape") { this.keys.clear(); this.hold(null); }
    if (ways[event.key]) {
      event.preventDefault();
      if (down) this.keys.add(event.key); else this.keys.delete(event.key);
    }
    const pushes = [...this.keys].map((k) => ways[k]), sum = [0, 1].map((i) => pushes.reduce((s, p) => s + p[i], 0));
    const length = Math.hypot(...sum) || 1;
    this.pushing = sum.map((v) => v / length);
    this.tell();
  }
  hold(point) {
    if (!point && !this.held) return;
    this.held = point;
    this.canvas.classList.toggle("holding", Boolean(point));
    this.tell();
  }
  tell() { this.told({ at: this.held, push: this.keys.size ? this.pushing : null, strong: this.strong }); }

  /** The view begins around the base; it grows when the mechanism leaves it. */
  frame(geometry = this.geometry) {
    const legs = Mechanism.legs(geometry);
    this.geometry = geometry;
    this.corners = legs.flatMap(({ base, l1, l2 }) => [[base - l1, -0.35 * l1], [base + l1, l1 + 0.8 * l2]]);
    this.trail = [];
    this.wish = [];
  }
  add({ t, x, y, xd, yd }) {
    t.forEach((time, i) => {
      if (i % 4) return;
      this.trail.push([time, x[i], y[i]]);
      this.wish.push([time, xd[i], yd[i]].map((v) => v ?? NaN));
    });
    const before = (t[t.length - 1] ?? 0) - trailSeconds;
    for (const list of [this.trail, this.wish]) while (list.length && list[0][0] < before) list.shift();
  }
  /** The joints among the coordinates: those of the 5R come after its effector. */
  angles({ q }) { return this.geometry.type === "five_bar" ? q.slice(2) : q; }
  draw(now, most) {
    const { canvas, geometry } = this;
    if (!geometry || !now) return;
    const { c, width, height } = prepare(canvas), pose = Mechanism.pose(geometry, this.angles(now)), tip = pose.effector;
    const seen = [tip, ...pose.elbows].filter((p) => p.every(Number.isFinite));
    const old = Mechanism.box(this.corners), all = Mechanism.box([...this.corners, ...seen]);
    if (!this.held && JSON.stringify(old) !== JSON.stringify(all)) this.corners = [[all.x[0], all.y[0]], [all.x[1], all.y[1]]];
    const view = this.view = Mechanism.fit(Mechanism.box(this.corners), width, height, 28);
    const mesh = Mechanism.drawGrid(c, view, colour);
    write(c, { fillStyle: colour("muted"), textAlign: "right", textBaseline: "alphabetic" }, `grid ${sig(mesh * 1e3, 3)} mm`, width - 8, height - 8);
    Mechanism.drawPath(c, view, this.wish.map(([, ...p]) => p), { strokeStyle: colour("c2"), lineWidth: 1.5 }, [5, 4]);
    Mechanism.drawPath(c, view, this.trail.map(([, ...p]) => p), { strokeStyle: colour("c6"), lineWidth: 2.5, globalAlpha: 0.7 });
    Mechanism.drawPose(c, view, pose, colour);
    if (now.desired.every((v) => v !== null)) this.cross(c, view.toScreen(now.desired));
    if (now.anchor) this.spring(c, view.toScreen(tip), view.toScreen(now.anchor));
    const force = Math.hypot(...now.force);
    if (force > 0) this.arrow(c, view.toScreen(tip), now.force, force, most);
    if (now.brake) write(c, { fillStyle: colour("warn"), textAlign: "left", font: "600 13px system-ui, sans-serif" }, "brake closed", 10, 20);
  }
  cross(c, [px, py]) {
    for (const dy of [8, -8]) Mechanism.path(c, [[px - 8, py - dy], [px + 8, py + dy]], { strokeStyle: colour("c2"), lineWidth: 2 });
  }
  spring(c, [x0, y0], [x1, y1]) {
    const length = Math.hypot(x1 - x0, y1 - y0), coils = 12, [ux, uy] = length > 1 ? [(x1 - x0) / length, (y1 - y0) / length] : [1, 0];
    const points = Array.from({ length: coils + 1 }, (_, k) => {
      const s = length * k / coils, off = k > 0 && k < coils ? (k % 2 ? 5 : -5) : 0;
      return [x0 + ux * s - uy * off, y0 + uy * s + ux * off];
    });
    Mechanism.path(c, points, { strokeStyle: colour("ink"), lineWidth: 1.5 });
    Mechanism.dot(c, [x1, y1], 4.25, colour("ink"));
  }
  /** As long as 90 pixels at the hand's full strength, and labelled. */
  arrow(c, [px, py], [fx, fy], force, most) {
    const length = 90 * force / Math.max(most, 1e-9), [ux, uy] = [fx / force, -fy / force], [ex, ey] = [px + ux * length, py + uy * length];
    Mechanism.path(c, [[px, py], [ex, ey]], { strokeStyle: colour("c1"), fillStyle: colour("c1"), lineWidth: 4 });
    c.beginPath();
    c.moveTo(ex + ux * 10, ey + uy * 10);
    for (const side of [1, -1]) c.lineTo(ex - uy * 6 * side, ey + ux * 6 * side);
    c.fill();
    write(c, { fillStyle: colour("ink"), font: "600 13px system-ui, sans-serif", textAlign: ux < 0 ? "right" : "left" }, amount(force, "N"), ex + ux * 16, ey + uy * 16 + 4);
  }
}
