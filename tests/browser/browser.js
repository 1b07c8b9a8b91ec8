// Debian's chromium, headless, on pages of esmc: what every test of such a page needs.
//
//   const { launch, esmc, open, drawn } = require("./browser");
//
// Exit status 77 (a skipped test) where playwright-core, chromium or a program given is missing.
"use strict";

const assert = require("node:assert/strict");
const { execFileSync } = require("node:child_process");
const fs = require("node:fs");
const http = require("node:http");
const os = require("node:os");
const path = require("node:path");

function skip(why) {
  console.log(`skipped: ${why}; host_sim/setup tests provides it`);
  process.exit(77);
}

const playwright = (() => { try { return require("playwright-core"); } catch { return skip("playwright-core is missing"); } })();
const executable = process.env.CHROMIUM ?? "/usr/bin/chromium";
if (!fs.existsSync(executable)) skip(`${executable} is missing`);

/** One browser for all pages of a test. Without a sandbox of its own, which root and containers do not have: it opens our pages only. */
const launch = () => playwright.chromium.launch({ executablePath: executable, args: ["--no-sandbox", "--force-color-profile=srgb"] });

/** Runs esmc; the exit status must be `status`. Returns what it printed. */
function esmc(program, args, status = 0) {
  try {
    const out = execFileSync(program, args, { encoding: "utf8", stdio: ["ignore", "pipe", "pipe"] });
    if (status !== 0) throw new Error(`esmc ${args.join(" ")}: exit status 0 instead of ${status}`);
    return out;
  } catch (error) {
    if (error.status === status && status !== 0) return error.stdout;
    throw new Error(`esmc ${args.join(" ")}: ${error.stderr || error.message}`);
  }
}

/** A folder of its own that goes with the process. */
function folder() {
  const made = fs.mkdtempSync(path.join(os.tmpdir(), "esmc-browser-"));
  process.on("exit", () => fs.rmSync(made, { recursive: true, force: true }));
  return made;
}

/** Opens a file or an address. `page.troubles`: messages of errors and warnings on the console, uncaught exceptions;
    `page.asked`: addresses that were requested besides the page's own. */
async function open(browser, where, { colorScheme = "light", width = 1440, height = 900, hasTouch = false } = {}) {
  const context = await browser.newContext({ colorScheme, hasTouch, viewport: { width, height } });
  const page = await context.newPage(), address = /^\w+:\/\//.test(where) ? where : `file://${path.resolve(where)}`;
  page.troubles = [];
  page.asked = [];
  page.on("console", (message) => { if (["error", "warning"].includes(message.type())) page.troubles.push(message.text()); });
  page.on("pageerror", (error) => page.troubles.push(String(error.stack ?? error)));
  page.on("request", (request) => { if (request.url() !== address) page.asked.push(request.url()); });
  await page.goto(address);
  await frames(page);
  return page;
}

/** Waits until the page has been painted twice. */
const frames = (page) => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done()))));

/** Of every canvas that matches: its pixels, how many of them have a colour (axes, grids and letters are nearly grey), and
    a number that changes with the picture. */
function drawn(page, selector) {
  return page.$$eval(selector, (list) => list.map((canvas) => {
    const { width, height } = canvas, copy = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
    copy.drawImage(canvas, 0, 0);
    const words = new Uint32Array(copy.getImageData(0, 0, width, height).data.buffer);
    let coloured = 0, hash = 0;
    for (let k = 0; k < words.length; ++k) {
      const word = words[k];
      if (word === 0) continue;
      const r = word & 255, g = (word >> 8) & 255, b = (word >> 16) & 255;
      if (Math.max(r, g, b) - Math.min(r, g, b) > 40) ++coloured;
      hash = (Math.imul(hash, 31) + word + k) | 0;
    }
    return { pixels: words.length, coloured, hash };
  }));
}

/** Neighbours that cover each other, and texts that are cut off or smaller than 10 px on the screen. */
const crowded = (page) => page.evaluate(() => {
  const found = [], box = (e) => e.getBoundingClientRect(), name = (e) => `${e.tagName} ${e.textContent.slice(0, 30)}`;
  const over = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1 && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1;
  for (const row of document.querySelectorAll("header, figcaption, .legend, .tiles, .bench, .panels, .facts, #planes, .figures, body")) {
    const list = [...row.children].filter((e) => box(e).width * box(e).height > 0 && getComputedStyle(e).position !== "sticky");
    list.forEach((a, k) => list.slice(k + 1).forEach((b) => { if (over(box(a), box(b))) found.push(`${name(a)} covers ${name(b)}`); }));
  }
  for (const e of document.querySelectorAll("h1, h2, .note, .legend button, .legend span, dd, figure svg text")) {
    const { left, right, width } = box(e), scale = e.ownerSVGElement ? box(e.ownerSVGElement).width / e.ownerSVGElement.viewBox.baseVal.width : 1;
    if (width && !e.closest(".wide, .figures figure, #histograms figure") && (left < 0 || right > innerWidth)) found.push(`${name(e)} is cut off`);
    if (width && parseFloat(getComputedStyle(e).fontSize) * scale < 10) found.push(`${name(e)} is too small`);
  }
  return found;
});

// ---- The live bench and the operator's page
const text = (page, id) => page.textContent(`#${id}`);
/** Waits for what a person would wait for; 60 s are for a machine with other things to do. A failure tells what the page showed. */
async function until(page, condition, argument) {
  try {
    return await page.waitForFunction(condition, argument, { timeout: 60000 });
  } catch (error) {
    const shown = await page.evaluate(() => ["state", "why", "detail", "answer", "effector", "source", "events"].map((id) =>
      `${id}: ${document.getElementById(id)?.textContent.slice(-400)}`).join("\n  ")).catch(() => "nothing");
    throw new Error(`waited in vain for ${JSON.stringify(argument) ?? condition}; the page shows\n  ${shown}`, { cause: error });
  }
}
const state = (page, wanted) => until(page, (word) => document.getElementById("state").textContent === word, wanted);
const event = (page, wanted) => until(page, (words) => document.getElementById("events").textContent.includes(words), wanted);
async function sound(page) {
  assert.deepEqual(page.troubles, []);
  const own = new URL(page.url()).origin;
  assert.deepEqual(page.asked.filter((url) => new URL(url).origin !== own && !url.startsWith("data:")), []);
  assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), "the page is wider than its window");
}
/** An attribute or a rule for everything that can be reached and has no name. */
const nameless = (page) => page.$$eval("input, select, button, canvas[tabindex]", (list) => list.filter((e) =>
  !e.closest("label") && !e.getAttribute("aria-label") && !e.textContent.trim() && !(e.id && document.querySelector(`label[for="${e.id}"]`))).map((e) => e.outerHTML));

/** Without its token, and from a page of another origin in the same browser, the page at `address` is out of reach. */
async function refusesStrangers(browser, address) {
  const url = new URL(address), token = url.searchParams.get("token");
  const page = await (await browser.newContext()).newPage();
  for (const wrong of ["", "0".repeat(32), token.slice(1)]) {
    url.searchParams.set("token", wrong);
    assert.equal((await page.goto(url.href)).status(), 403);
  }
  // A page of another origin, in the same browser, which even knows the token.
  const foreign = http.createServer((_, answer) => answer.setHeader("content-type", "text/html").end("<!doctype html><title>foreign</title>"));
  await new Promise((done) => foreign.listen(0, "127.0.0.1", done));
  await page.goto(`http://127.0.0.1:${foreign.address().port}/`);
  const opens = (where) => page.evaluate((to) => new Promise((done) => {
    const socket = new WebSocket(to);
    socket.onopen = () => done("open");
    socket.onclose = () => done("refused");
  }), where);
  assert.equal(await opens(`ws://${url.host}/bench?token=${token}`), "refused");
  assert.equal(await page.evaluate((to) => fetch(to).then(() => "read", () => "refused"), address), "refused");
  // The same from a page of its own is let in: it is the origin that was refused.
  await page.goto(address);
  assert.equal(await opens(`ws://${url.host}/bench?token=${token}`), "open");
  assert.equal(await opens(`ws://${url.host}/bench?token=${"0".repeat(32)}`), "refused");
  await new Promise((done) => foreign.close(done));
  await page.context().close();
}

module.exports = { launch, esmc, folder, open, frames, drawn, crowded, text, until, state, event, sound, nameless, refusesStrangers };
