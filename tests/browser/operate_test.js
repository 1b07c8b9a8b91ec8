// The operator's page as a person uses it: in a browser, against `esmc controller` and `esmc plant` over slcan.
// usage: operate_test.js ESMC SCENE [--shot FILE]   with --shot: only the screenshot of docs/operate.md
"use strict";

const assert = require("node:assert/strict");
const { spawn } = require("node:child_process");
const fs = require("node:fs");
const net = require("node:net");
const path = require("node:path");
const readline = require("node:readline");
const { test, before, after, afterEach } = require("node:test");
const { launch, folder, open, drawn, crowded, text, until, state, event, sound, nameless, refusesStrangers } = require("./browser");

const [program, scene, , shot] = process.argv.slice(2);
const sets = ["control.law=esmc", "control.reaching=implicit", "control.lambda=5.0", "control.gain=20.0", "command.lambda=[1.0, 40.0]", "command.gain=[5.0, 100.0]",
  "command.speed=0.2", "command.acceleration=1.0", "limits.workspace={ x = [-0.15, 0.15], y = [0.05, 0.26] }", "command.timeout=6.0", "reference.speed=1.0",
  "simulation.duration=900", "control.rate_hz=100"].flatMap((s) => ["--set", s]);
const states = ["disabled", "enabling", "testing", "running", "halting", "holding", "lowering", "stopping", "fault"];
let browser;
const running = new Set(), hubs = new Set();  // what a failed test leaves would keep this program waiting

/** Adapters that speak slcan: every frame goes to all others. Keeps the Status frames. */
async function bus() {
  const clients = new Set(), statuses = [];
  const pass = (line, source) => {
    for (const other of clients) if (other !== source) other.write(`${line}\r`);
    const status = /^t7908(..)(.)(.)(..)(..)/.exec(line);
    if (status) statuses.push({ state: parseInt(status[2], 16), fault: parseInt(status[4], 16) });
  };
  const server = net.createServer((client) => {
    let rest = "";
    client.setNoDelay().on("error", () => {}).on("close", () => clients.delete(client));
    client.on("data", (part) => {
      const lines = (rest + part).split("\r");
      rest = lines.pop();
      lines.filter((line) => /^[tTrR]/.test(line)).forEach((line) => pass(line, client));
    });
    clients.add(client);
  });
  await new Promise((done) => server.listen(0, "127.0.0.1", done));
  hubs.add(server);
  return { name: `slcan:tcp:127.0.0.1:${server.address().port}`, statuses, send: (line) => pass(line, null),
    close() { server.close(); for (const client of clients) client.destroy(); } };
}
function start(...args) {
  const child = spawn(program, args, { stdio: ["ignore", "pipe", "inherit"] });
  running.add(child);
  child.ended = new Promise((done) => child.on("exit", (code) => { running.delete(child); done(code); }));
  return child;
}
/** Drives, controller, and a console that serves its page. */
async function bench(...more) {
  const all = [...sets, ...more.flatMap((s) => ["--set", s])];
  const can = await bus(), halves = ["plant", "controller"].map((half) => start(half, scene, "--bus", can.name, "--realtime", ...all));
  halves.forEach((half) => half.stdout.resume());
  const page = start("operate", can.name, scene, ...all, "--page", "--points", path.join(folder(), "points.toml"));
  const { value: url } = await readline.createInterface({ input: page.stdout })[Symbol.asyncIterator]().next();
  return { url, can, page, halves, async end() {
    page.kill("SIGINT");
    assert.equal(await page.ended, 0);
    halves.forEach((half) => half.kill("SIGKILL"));
    await Promise.all(halves.map((half) => half.ended));
    can.close();
  } };
}
const x = async (page) => parseFloat((await text(page, "effector")).replaceAll("−", "-"));  // mm
const beyond = (page, least) => until(page, (n) => parseFloat(document.getElementById("effector").textContent.replaceAll("−", "-")) > n, least);
const holdsNear = (page, count) => until(page, (n) => document.getElementById("events").textContent.split("holds near").length > n, count);
const refused = (page, words) => until(page, (w) => document.getElementById("answer").textContent.includes(w), words);
async function armed(b, options) {
  const page = await open(browser, b.url, options);
  await state(page, "off");
  await page.click("[data-do=arm]");
  await state(page, "running");
  return page;
}
async function press(page, way) {
  const button = page.locator(`#pad [data-way="${way}"]`);
  await button.scrollIntoViewIfNeeded();
  const box = await button.boundingBox();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await page.mouse.down();
}
const goTo = async (page, a, b) => {
  await page.fill("#goto [name=a]", String(a));
  await page.fill("#goto [name=b]", String(b));
  await page.click("#goto [type=submit]");
};
/** The page neither answers nor releases for this time. Returns where it has seen the effector last, mm. */
const hang = (page, ms) => page.evaluate((t) => {
  const at = document.getElementById("effector").textContent, end = Date.now() + t;
  while (Date.now() < end);
  return parseFloat(at.replaceAll("−", "-"));
}, ms);

before(async () => { browser = await launch(); });
// Neither programs nor pages of a failed test slow down the next.
afterEach(async () => {
  for (const child of running) child.kill("SIGKILL");
  for (const hub of hubs) hub.close();
  hubs.clear();
  await Promise.all(browser.contexts().map((context) => context.close()));
});
after(() => browser.close());

if (shot) {
  test("screenshot", async () => {
    const b = await bench(), page = await armed(b, { width: 1440, height: 1400 });
    await goTo(page, 0.03, 0.2);
    await event(page, "at 0.0");
    await press(page, "0-");
    await until(page, () => parseFloat(document.getElementById("effector").textContent.replaceAll("−", "-")) < -40);
    await page.screenshot({ path: shot, fullPage: true });
    await page.mouse.up();
    await b.end();
  });
} else {
  test("arm, jog, go, set, stop, fault, reset", async () => {
    const b = await bench(), page = await open(browser, b.url);
    await state(page, "off");
    assert.ok(await page.isDisabled("[data-do=hold]") && await page.isDisabled("#goto [type=submit]"));
    assert.deepEqual(await nameless(page), []);
    await page.fill("#gains [name=lambda_angle]", "7.5");
    await page.click("#gains [type=submit]");
    await event(page, "lambda_angle = 7.5");
    await page.fill("#gains [name=lambda_angle]", "41");
    await page.click("#gains [type=submit]");
    await refused(page, "out_of_bounds");
    await page.click("[data-do=arm]");
    await state(page, "running");
    assert.equal(await text(page, "answer") !== "" && await page.isVisible("#answer"), false);  // a later order has succeeded

    // By mouse and by keyboard: as long as held.
    await goTo(page, 0.0, 0.18);
    await event(page, "at ");
    await press(page, "0+");
    await beyond(page, 8);
    await page.mouse.up();
    await holdsNear(page, 1);
    await page.focus("#pad");
    await page.keyboard.down("ArrowRight");
    await beyond(page, await x(page) + 8);
    await page.keyboard.up("ArrowRight");
    await holdsNear(page, 2);
    await page.focus("#pad");
    await page.keyboard.down("ArrowRight");
    await beyond(page, await x(page) + 4);
    await page.evaluate(() => document.activeElement.blur());  // losing focus releases the pull
    await holdsNear(page, 3);
    await page.keyboard.up("ArrowRight");
    assert.equal(await text(page, "state"), "running");
    await goTo(page, 0.03, 0.27);
    await refused(page, "out_of_bounds");

    // Points.
    await page.fill("#teach [name=point]", "over there");
    await page.click("#teach [type=submit]");
    await refused(page, "no name of a point");
    await page.fill("#teach [name=point]", "there");
    await page.click("#teach [type=submit]");
    await until(page, () => /there: [\d.]+, 0\.18/.test(document.getElementById("points").textContent));
    await goTo(page, 0.0, 0.2);
    await until(page, () => /at -?0\.0000\d+ 0\.(2000|1999)/.test(document.getElementById("events").textContent));
    await page.click("#points [aria-label='go to there']");
    await event(page, "goto there");
    await until(page, () => document.getElementById("events").textContent.split("goto there")[1].includes("at "));
    // What is drawn.
    const [mechanism] = await drawn(page, "#mechanism");
    assert.ok(mechanism.coloured > 1000, `${mechanism.coloured} coloured pixels`);
    const plots = await drawn(page, "#plots canvas");
    assert.equal(plots.length, 3);
    plots.forEach((plot, k) => assert.ok(plot.coloured > 50, `plot ${k}`));

    // A stop in the middle of a motion, by key and by button; and the reference.
    await goTo(page, -0.06, 0.18);
    await event(page, "goto -0.06 0.18");
    await page.keyboard.press("Escape");
    await state(page, "off");
    await page.click("[data-do=run]");
    await state(page, "running");
    await until(page, () => document.getElementById("source").textContent === "reference");
    await page.click("[data-do=hold]");
    await until(page, () => document.getElementById("source").textContent === "reference, held");
    await page.click("[data-do=resume]");
    await until(page, () => document.getElementById("source").textContent === "reference");
    await page.fill("#override input", "50");
    await page.press("#override input", "Enter");
    await until(page, () => document.getElementById("source").textContent === "reference, reduced");
    assert.ok(await page.isDisabled("#goto [type=submit]"));
    await page.click("#off");
    await state(page, "off");

    // A fault, told and acknowledged.
    await page.click("[data-do=arm]");
    await state(page, "running");
    b.can.send("t79580000000000000000");  // a second controller
    await until(page, () => document.getElementById("why").textContent === "foreign controller");
    await until(page, () => /foreign controller.*1 time/.test(document.getElementById("records").textContent));
    await page.click("[data-do=reset]");
    await state(page, "off");
    await event(page, "acknowledges foreign_controller");
    await sound(page);
    await b.end();
    await state(page, "not connected");
  });

  test("a controller that is not heard", async () => {
    const b = await bench(), page = await armed(b);
    b.halves[1].kill("SIGKILL");
    await state(page, "not heard");
    assert.ok(await page.isDisabled("[data-do=hold]"));
    await until(page, () => /Nothing from the controller for ([6-9]|\d\d) s/.test(document.getElementById("detail").textContent));  // the program goes on
    await page.keyboard.press("Escape");
    await state(page, "not heard");
  });

  test("a page that is closed or hangs in a jog: rest", async () => {
    const b = await bench(), watcher = await open(browser, b.url, { width: 390 });
    await state(watcher, "off");
    assert.deepEqual(await crowded(watcher), []);
    const page = await open(browser, b.url);
    await until(page, () => !document.getElementById("watching").hidden);
    await page.click("#take");
    await until(page, () => document.getElementById("watching").hidden);
    await until(watcher, () => !document.getElementById("watching").hidden && document.querySelector("[data-do=arm]").disabled);
    await page.click("[data-do=arm]");
    await state(page, "running");
    await goTo(page, -0.05, 0.18);
    await event(page, "at ");
    await page.fill("#speed", "0.02");

    // It hangs, with the button held: its jog ends within the age of a stream (1 s), and after 3 s it has left.
    await press(page, "0+");
    await beyond(page, -45);
    const hung = b.can.statuses.length, over = hang(page, 10000);
    await state(watcher, "off");
    const ticks = b.can.statuses.slice(hung).findIndex(({ state: s }) => states[s] !== "running");
    assert.ok(ticks >= 0 && ticks < 900, `${ticks} ticks of 10 ms until it comes to rest`);
    assert.deepEqual(b.can.statuses.slice(hung).filter(({ fault }) => fault !== 0), []);
    const [end, begun] = [await x(watcher), await over];
    assert.ok(end - begun < 40, `${begun} to ${end} mm, at 20 mm/s`);
    await state(page, "off");
    await page.mouse.up();

    // It is closed.
    await page.click("[data-do=arm]");
    await state(page, "running");
    await press(page, "0+");
    const begin = await x(watcher);
    await beyond(watcher, begin + 4);
    const closed = b.can.statuses.length;
    await page.context().close();
    await state(watcher, "off");
    assert.ok(b.can.statuses.slice(closed).findIndex(({ state: s }) => states[s] !== "running") <= 100);
    assert.deepEqual(b.can.statuses.slice(closed).filter(({ fault }) => fault !== 0), []);
    // A watching page can then take control.
    await watcher.click("#take");
    await watcher.click("[data-do=arm]");
    await state(watcher, "running");

    // The program that serves it is killed: no sign of life, and the controller says so.
    b.page.kill("SIGKILL");
    await b.page.ended;
    const died = b.can.statuses.length;
    while (!b.can.statuses.slice(died).some(({ state: s }) => states[s] === "fault")) await new Promise((done) => setTimeout(done, 20));
    const again = start("operate", b.can.name, scene, ...sets, "status", "--json");
    let told = "";
    again.stdout.on("data", (part) => { told += part; });
    assert.equal(await again.ended, 0);
    assert.equal(JSON.parse(told).fault, "command_lost");
    b.page = start("operate", b.can.name, scene, ...sets, "--page");
    b.page.stdout.resume();
  });

  test("by touch: jog while the finger is down; a stop by another finger", async () => {
    const b = await bench(), page = await armed(b, { width: 800, height: 1400, hasTouch: true });
    const fingers = await page.context().newCDPSession(page), touch = (type, ...touchPoints) => fingers.send("Input.dispatchTouchEvent", { type, touchPoints });
    const at = async (selector, id) => {
      const box = await page.locator(selector).boundingBox();
      return { id, x: box.x + box.width / 2, y: box.y + box.height / 2 };
    };
    await page.locator("#pad").scrollIntoViewIfNeeded();
    await goTo(page, 0.0, 0.18);
    await event(page, "at ");
    await page.locator("#pad").scrollIntoViewIfNeeded();
    const right = await at('#pad [data-way="0+"]', 1);
    await touch("touchStart", right);
    await beyond(page, 8);
    await touch("touchEnd");
    await holdsNear(page, 1);
    await touch("touchStart", right);
    await beyond(page, await x(page) + 4);
    await touch("touchCancel");  // the system takes the finger: a call, a gesture
    await holdsNear(page, 2);
    assert.equal(await text(page, "state"), "running");
    // Slid off the button, it is still held; then STOP under a second finger.
    await touch("touchStart", right);
    await touch("touchMove", { ...right, y: right.y + 90 });
    await beyond(page, await x(page) + 4);
    const before = b.can.statuses.length;
    await touch("touchStart", { ...right, y: right.y + 90 }, await at("#halt", 2));
    await state(page, "off");
    assert.ok(b.can.statuses.slice(before).every(({ fault }) => fault === 0));
    await touch("touchEnd");
    await page.tap("[data-do=arm]");
    await state(page, "running");
    await page.tap("#off");
    await state(page, "off");
    await sound(page);
    await b.end();
  });

  test("a file is run, the last ticks are captured", async () => {
    const b = await bench(), page = await open(browser, b.url), own = folder(), line = path.join(own, "line.toml"), ticks = path.join(own, "ticks");
    await state(page, "off");
    assert.ok(await page.isHidden("[data-do=home]") && await page.isDisabled("[data-file=run] button"));
    fs.writeFileSync(line, fs.readFileSync(scene, "utf8").replace(/\[reference\][\s\S]*?\n\[initial\]/, '[reference]\ntype = "line"\nfrom = [0.05, 0.18]\nto = [-0.02, 0.2]\nduration = 2.0\n\n[initial]'));
    await page.click("[data-do=arm]");
    await state(page, "running");
    const run = async (file) => { await page.fill("[data-file=run] input", file); await page.click("[data-file=run] button"); };
    await run(path.join(own, "none.toml"));
    await refused(page, "none.toml");
    await run(line);
    await event(page, "end of the path: -0.0");
    assert.ok(await page.isDisabled("[data-file=capture] button"));
    await page.click("#halt");
    await state(page, "off");
    await page.fill("[data-file=capture] input", ticks);
    await page.click("[data-file=capture] button");
    await event(page, " ticks");
    assert.match(fs.readFileSync(path.join(ticks, "capture.csv"), "utf8"), /^t,tick,/);
    await sound(page);
    await b.end();
  });

  test("home, where the drives lose their zero", async () => {
    const b = await bench('effects=[{type="viscous_friction", coefficient=[0.02, 0.02]}, {type="end_stops", lower=[-9.0, 1.155262], upper=[0.631942, 9.0]}]', 'drives.zero="end_stop"',
      "drives.zero_pose=[0.631942, 1.155262]", "drives.homing_speed=[0.2, -0.2]", "drives.homing_torque=[0.1, 0.1]"), page = await open(browser, b.url);
    await until(page, () => document.getElementById("detail").textContent.includes("zero is not confirmed"));
    await page.click("[data-do=home]");
    await state(page, "testing");
    await page.keyboard.press("Escape");
    await state(page, "off");
    // Ticks that a busy machine loses end in a fault, and the owner begins anew.
    const homed = () => until(page, () => document.getElementById("state").textContent === "fault" || document.getElementById("events").textContent.includes("homed"));
    await page.click("[data-do=home]");
    await homed();
    for (let left = 4; left > 0 && await text(page, "state") === "fault"; --left) {
      assert.equal(await text(page, "why"), "feedback jump");
      await page.click("[data-do=reset]");
      await state(page, "off");
      await page.click("[data-do=home]");
      await homed();
    }
    await event(page, "homed");
    await page.click("[data-do=arm]");
    await state(page, "running");
    await sound(page);
    await b.end();
  });

  test("foreign origins and floods are refused, and the ticks go on", async () => {
    const b = await bench();
    await refusesStrangers(browser, b.url);
    const page = await armed(b), before = b.can.statuses.length;
    await page.evaluate(() => {
      const socket = new WebSocket(`ws://${location.host}/bench${location.search}`);
      const nonsense = ["", "{", "[]", '{"do":"arm"}', '{"do":["fly"]}', '{"jog":["x"]}', '{"here":1e9}', '{"do":["arm","arm"]}', '{"stop":1}', `{"do":["set","${"x".repeat(1000)}","1"]}`];
      socket.onopen = () => { for (let k = 0; k < 20000; ++k) socket.send(nonsense[k % nonsense.length]); window.flooded = true; };
    });
    await until(page, () => window.flooded && Number.isFinite(parseFloat(document.getElementById("effector").textContent)));
    await goTo(page, 0.0, 0.18);
    await event(page, "at ");
    assert.equal(await text(page, "state"), "running");
    assert.ok(b.can.statuses.length > before + 50);
    assert.deepEqual(b.can.statuses.slice(before).filter(({ state: s, fault }) => states[s] !== "running" || fault !== 0), []);
    // Floods of orders: most are refused, the stop among them is not.
    await page.evaluate(() => { for (let k = 0; k < 300; ++k) document.querySelector("#goto").requestSubmit(); document.getElementById("halt").click(); });
    await state(page, "off");
    await sound(page);
    await b.end();
  });
}
