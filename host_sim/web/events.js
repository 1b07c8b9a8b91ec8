// What happened, line by line; and the connection to the program that serves the page.
"use strict";

class EventsPanel {
  constructor(list) { this.list = list; }
  add(t, kind, text) {
    const end = this.list.scrollTop + this.list.clientHeight >= this.list.scrollHeight - 4;
    this.list.append(el("li", { "data-kind": kind }, el("time", {}, Number.isFinite(t) ? `${t.toFixed(3)} s` : ""), el("span", {}, kind), el("span", {}, text)));
    while (this.list.children.length > 200) this.list.firstChild.remove();
    if (end) this.list.scrollTop = this.list.scrollHeight;
  }
}

const put = (node, text) => { if (node.textContent !== text) node.textContent = text; };

/** What a state means for the user, where both pages say the same. */
const phases = {
  enabling: ["warn", "…", "arming", "The drives are being set up and armed."],
  running: ["ok", "▶", "running", ""],
  halting: ["warn", "‖", "halting", "To rest under control."],
  holding: ["warn", "‖", "holding", "At rest, held by the law."],
  lowering: ["warn", "‖", "lowering", "The weight is let down."],
  stopping: ["warn", "‖", "stopping", "Torque off, drives to idle."],
};
/** Shows state and fault. Returns the detail of the state's meaning. */
function showVerdict({ state, fault, injecting }, meanings) {
  const [level, sign, word, detail] = meanings[state] ?? ["warn", "?", state, ""];
  byId("verdict").dataset.level = injecting && level === "ok" ? "warn" : level;
  put(query(".symbol"), sign);
  put(byId("state"), word);
  put(byId("why"), fault === "none" ? "" : fault.replaceAll("_", " "));
  return detail;
}

/** Connects, and again 2 s after each loss, which the page shows. Returns what sends a message, where there is a connection. */
function connectPage(hear, why) {
  let socket = null;
  const token = new URLSearchParams(location.search).get("token") ?? "";
  const connect = () => {
    socket = new WebSocket(`ws://${location.host}/bench?token=${encodeURIComponent(token)}`);
    on(socket, "message", ({ data }) => hear(JSON.parse(data)));
    on(socket, "close", () => {
      byId("verdict").dataset.level = "bad";
      byId("state").textContent = "not connected";
      byId("why").textContent = "";
      byId("detail").textContent = why;
      query(".symbol").textContent = "!";
      setTimeout(connect, 2000);
    });
  };
  connect();
  return (message) => { if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); };
}
