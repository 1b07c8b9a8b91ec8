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
