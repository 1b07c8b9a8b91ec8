// The live bench as a person uses it: in a browser, with mouse and keyboard; and as a foreign page would.
// usage: live_test.js ESMC SCENES [--shot FILE]   with --shot: only the screenshot of docs/live.md
"use strict";

const assert = require("node:assert/strict");
const { spawn } = require("node:child_process");
const fs = require("node:fs");
const path = require("node:path");
const readline = require("node:readline");
const { test, before, after } = require("node:test");
const { launch, esmc, folder, open, frames, drawn, crowded, text, until, state, event, sound, nameless, refusesStrangers } = require("./browser");

const [program, scenes, , shot] = process.argv.slice(2);
const five = path.join(scenes, "five_bar_circle.toml"), rr = path.join(scenes, "rr_line.toml");
let browser;
const running = new Set();  // benches: one that a failed test leaves would keep this program waiting

/** A bench: its address, and how to end it. */
async function bench(scene, ...options) {
  const child = spawn(program, ["live", scene, ...options], { stdio: ["ignore", "pipe", "inherit"] });
  running.add(child);
  const lines = readline.createInterface({ input: child.stdout })[Symbol.asyncIterator](), { value: url } = await lines.next();
  const ended = new Promise((done) => child.on("exit", (code) => { running.delete(child); done(code); }));
  return { url, async end() { child.kill("SIGINT"); assert.equal(await ended, 0); } };
}
/** Running again after what these words announce; the state that is shown may be that of before. */
const again = (page, announced) => until(page, (words) => {
  const all = [...document.querySelectorAll("#events li")].map((line) => [line.dataset.kind, line.lastChild.textContent]);
  const at = all.findLastIndex(([, text]) => text.includes(words));
  return at >= 0 && all.slice(at).some(([kind, text]) => kind === "state" && text === "running");
}, announced);
const forceOver = (page, least) => until(page, (n) => parseFloat(document.getElementById("force").textContent) > n, least);
const noForce = (page) => until(page, () => parseFloat(document.getElementById("force").textContent) === 0);
const time = async (page) => parseFloat(await text(page, "time"));
async function pull(page, x, y) {
  const box = await page.locator("#mechanism").boundingBox();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await page.mouse.down();
  await page.mouse.move(box.x + x * box.width, box.y + y * box.height, { steps: 4 });
}
before(async () => { browser = await launch(); });
after(async () => {
  for (const child of running) child.kill("SIGKILL");
  await browser.close();
});

if (shot) {
  test("screenshot", async () => {
    const b = await bench(five), page = await open(browser, b.url, { width: 1440, height: 1160 });
    await state(page, "running");
    await page.selectOption("#add", "payload");
    await until(page, () => parseFloat(document.getElementById("time").textContent) > 8);
    await pull(page, 0.78, 0.2);
    await until(page, () => parseFloat(document.getElementById("time").textContent) > 10.5);
    await page.screenshot({ path: shot, fullPage: true });
    await b.end();
  });
} else {
  test("the loop is drawn, and goes on", async () => {
    const b = await bench(five), page = await open(browser, b.url);
    await state(page, "running");
    await until(page, () => parseFloat(document.getElementById("time").textContent) > 2);
    const [first] = await drawn(page, "#mechanism"), before = await time(page);
    assert.ok(first.coloured > 1000, `${first.coloured} coloured pixels of the mechanism`);
    const plots = await drawn(page, "#plots canvas");
    assert.equal(plots.length, 4);
    for (const [k, plot] of plots.entries()) assert.ok(plot.coloured > 50, `plot ${k}: ${plot.coloured} coloured pixels`);
    await until(page, (t) => parseFloat(document.getElementById("time").textContent) > t + 0.5, before);
    assert.notEqual((await drawn(page, "#mechanism"))[0].hash, first.hash);
    (await drawn(page, "#plots canvas")).forEach((plot, k) => { if (k < 3) assert.notEqual(plot.hash, plots[k].hash, `plot ${k}`); });
    assert.deepEqual(await nameless(page), []);
    await sound(page);
    await b.end();
    await state(page, "not connected");
  });

  test("the layout holds at 390, 1300 and 1920 px", async () => {
    const b = await bench(five);
    for (const width of [390, 1300, 1920]) {
      const page = await open(browser, b.url, { width });
      await state(page, "running");
      assert.deepEqual(await crowded(page), [], `${width} px`);
      await sound(page);
      await page.context().close();
    }
    await b.end();
  });

  test("pulled by the mouse, pushed by the keyboard", async () => {
    const b = await bench(five), page = await open(browser, b.url);
    await state(page, "running");
    assert.equal(parseFloat(await text(page, "force")), 0);
    await pull(page, 0.8, 0.3);
    await forceOver(page, 1);
    const [held] = await drawn(page, "#mechanism");
    assert.ok(held.coloured > 1000);
    await page.mouse.up();
    await noForce(page);
    await page.focus("#mechanism");
    await page.keyboard.down("ArrowRight");
    await forceOver(page, 1);
    const half = parseFloat(await text(page, "force"));
    await page.keyboard.down("Shift");
    await page.keyboard.down("ArrowRight");
    await forceOver(page, 1.5 * half);
    await page.keyboard.up("ArrowRight");
    await page.keyboard.up("Shift");
    await noForce(page);
    await page.keyboard.down("ArrowUp");
    await forceOver(page, 1);
    await page.evaluate(() => document.activeElement.blur());  // losing focus releases the pull
    await noForce(page);
    assert.equal(await text(page, "state"), "running");
    await sound(page);
    await b.end();
  });

  test("law, effects and keys change while it runs", async () => {
    const b = await bench(five), page = await open(browser, b.url, { colorScheme: "dark" });
    await state(page, "running");
    await page.selectOption("#control [name=law]", "smc");
    await page.fill("#control [name=gain]", "60.0");
    await page.click("#control [type=submit]");
    await event(page, "control.law=smc, control.gain=60.0: halt, new controller, start");
    await event(page, "halting");
    await until(page, () => document.getElementById("subtitle").textContent.includes("law smc"));
    await again(page, "control.law=smc, control.gain=60.0: halt, new controller, start");
    await state(page, "running");
    await page.selectOption("#add", "payload");
    await event(page, "from now on");
    assert.ok(await page.isChecked("#effects input[type=checkbox]"));
    // A click, not "uncheck" or "check": those look afterwards, find the line drawn anew by the answer, and click again.
    await page.click("#effects input[type=checkbox]");
    await event(page, "effects=[]: from now on");
    await page.fill("#effects li input:not([type=checkbox])", "mass = -1.0");
    await page.click("#effects input[type=checkbox]");
    await until(page, () => document.getElementById("answer").textContent.includes("mass"));
    assert.equal(await page.isChecked("#effects input[type=checkbox]"), false);  // refused: nothing has changed
    await page.fill("#set [name=set]", "control.lambda=-3");
    await page.click("#set [type=submit]");
    await until(page, () => /control\.lambda.*greater/s.test(document.getElementById("answer").textContent) || document.getElementById("answer").textContent.includes("control.lambda"));
    assert.equal(await text(page, "state"), "running");
    await page.fill("#set [name=set]", "reference.radius=0.04");
    await page.click("#set [type=submit]");
    await again(page, "reference.radius=0.04: halt");
    await state(page, "running");
    assert.match(await text(page, "sets"), /--set reference\.radius=0\.04/);
    // What it has recorded, and the scene with all of this.
    const saved = (name) => page.evaluate(async (file) => {
      const link = document.querySelector(`[data-save="${file}"]`), answer = await fetch(link.href);
      return [answer.status, link.download, [...new Uint8Array(await answer.arrayBuffer())].map((c) => String.fromCharCode(c)).join("")];
    }, name);
    const [status, name, log] = await saved("log.csv"), rows = log.trim().split("\n").map((line) => line.split(","));
    assert.deepEqual([status, name], [200, "log.csv"]);
    assert.deepEqual(rows[0].slice(0, 9), ["t", "x", "y", "theta11", "theta12", "theta21", "theta22", "tau11", "tau21"]);
    assert.ok(rows.length > 500 && rows.every((row) => row.length === rows[0].length) && rows.some((row) => row.at(-1) === "halting"));
    assert.ok((await saved("log.mcap"))[2].startsWith("\x89MCAP0\r\n") && (await saved("log.mcap"))[2].endsWith("\x89MCAP0\r\n"));
    const copy = path.join(folder(), "saved.toml");
    fs.writeFileSync(copy, (await saved("scene.toml"))[2]);
    const rerun = JSON.parse(esmc(program, ["sim", copy, "--set", "simulation.duration=0.1", "--json"]));
    assert.equal(rerun.law, "smc");
    assert.match(fs.readFileSync(copy, "utf8"), /radius = 0\.04/);
    await page.click("#given");
    await until(page, () => document.getElementById("subtitle").textContent.includes("law esmc"));
    await sound(page);
    await b.end();
  });

  test("faults are named, reset and gone", async () => {
    const b = await bench(rr), page = await open(browser, b.url, { width: 420, height: 800 });
    await state(page, "running");
    assert.ok(await page.isDisabled("[data-do=reset]"));
    await page.selectOption("#faults [name=fault]", "drive_error");
    await page.click("#faults [type=submit]");
    await state(page, "fault");
    assert.equal(await text(page, "why"), "drive error");
    await event(page, "drive_error: torque off");
    await page.click("[data-do=home]");
    await state(page, "running");
    await page.click("[data-do=halt]");
    await state(page, "off");
    await page.click("[data-do=start]");
    await state(page, "running");
    await sound(page);
    await b.end();
  });

  test("a wrong token and a foreign page are refused", async () => {
    const b = await bench(five);
    await refusesStrangers(browser, b.url);
    await b.end();
  });
}
