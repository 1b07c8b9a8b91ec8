// Buttons and arrow keys that move while they are held: released in every way in which a hand can go.
"use strict";

class JogPad {
  /** told([axis, sense]): held in this way; told(null): released. */
  constructor(pad, told) {
    Object.assign(this, { pad, told, way: null });
    on(pad, "keydown", (event) => {
      const way = { ArrowLeft: "0-", ArrowRight: "0+", ArrowUp: "1+", ArrowDown: "1-" }[event.key];
      if (!way) return;
      event.preventDefault();
      if (!event.repeat) this.hold(way, event.key);
    });
    on(pad, "keyup", (event) => { if (event.key === this.by) this.release(); });
    on(pad, "focusout", () => this.release());
    on(pad, "contextmenu", (event) => event.preventDefault());  // of a long touch
    for (const type of ["blur", "pagehide"]) on(window, type, () => this.release());
    on(document, "visibilitychange", () => { if (document.hidden) this.release(); });
  }
  name(axes) {
    this.pad.replaceChildren(...["0-", "0+", "1-", "1+"].map((way) => {
      const button = el("button", { type: "button", "data-way": way }, `${symbol(axes[way[0]])} ${way[1].replace("-", "−")}`);
      on(button, "pointerdown", (event) => {
        if (event.button > 0) return;
        button.focus();
        button.setPointerCapture(event.pointerId);
        this.hold(way, event.pointerId);
      });
      for (const type of ["pointerup", "pointercancel", "lostpointercapture"])
        on(button, type, (event) => { if (event.pointerId === this.by) this.release(); });
      return button;
    }));
  }
  hold(way, by) {
    if (this.way) this.release();  // one way at a time
    Object.assign(this, { way, by });
    this.show();
    this.told([Number(way[0]), way[1] === "+" ? 1 : -1]);
  }
  release() {
    if (!this.way) return;
    this.way = this.by = null;
    this.show();
    this.told(null);
  }
  show() { for (const button of this.pad.children) button.classList.toggle("held", button.dataset.way === this.way); }
}
