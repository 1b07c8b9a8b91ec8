// The report of a run as a person uses it: in a browser, with mouse and keyboard, on paper, by night, in a narrow window.
// usage: report_test.js ESMC SCENES
"use strict";

const assert = require("node:assert/strict");
const fs = require("node:fs");
const path = require("node:path");
const { test, before, after } = require("node:test");
const { launch, esmc, folder, open, frames, drawn, crowded } = require("./browser");

const [program, scenes] = process.argv.slice(2), out = folder();
const five = path.join(scenes, "five_bar_circle.toml"), rr = path.join(scenes, "rr_line.toml");
const sets = (...values) => values.flatMap((value) => ["--set", value]);
let browser;

/** A run's report; `status` as esmc must leave. */
function report(name, args, status = 0) {
  const to = path.join(out, name);
  esmc(program, [...args, "--out", to], status);
  return path.join(to, "report.html");
}
const data = (page) => page.evaluate(() => data);
/** Another page with its data changed. */
function changed(file, name, change) {
  const page = fs.readFileSync(file, "utf8"), [, text] = /<script type="application\/json" id="data">(.*?)<\/script>/s.exec(page);
  const content = JSON.parse(text), to = path.join(out, name);
  change(content);
  fs.writeFileSync(to, page.replace(text, () => JSON.stringify(content).replaceAll("<", "\\u003c")));
  return to;
}
async function sound(page) {
  assert.deepEqual(page.troubles, []);
  assert.deepEqual(page.asked, []);
  assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), "the page is wider than its window");
}
/** Everything there is to draw has been drawn, and not merely an axis: so many pixels at least. */
async function allDrawn(page, least = 100) {
  for (const selector of ["#plots canvas", "#mechanism", "#map"]) {
    const list = await drawn(page, selector);
    assert.ok(list.length > 0, selector);
    for (const { pixels, coloured } of list) assert.ok(coloured > least, `${selector}: ${coloured} of ${pixels} pixels`);
  }
}
const view = (page) => page.evaluate(() => plots.map(({ plot }) => [plot.scales.x.min, plot.scales.x.max]));

before(async () => { browser = await launch(); });
after(() => browser.close());

for (const [name, scene] of [["five_bar", five], ["rr", rr]]) {
  for (const command of ["sim", "hil"]) {
    test(`${command} of ${name}: everything drawn, nothing said, nothing fetched, light and dark`, async () => {
      const file = report(`${command}_${name}`, [command, scene, ...sets("simulation.duration=0.5")]), shades = [];
      assert.ok(fs.statSync(file).size < 3e6);
      assert.match(fs.readFileSync(file, "utf8"), /Copyright \(c\) \d+ Leon Sorokin[^]*Permission is hereby granted/, "the licence of uPlot");
      for (const colorScheme of ["light", "dark"]) {
        const page = await open(browser, file, { colorScheme });
        await sound(page);
        await allDrawn(page);
        shades.push(await page.evaluate(() => getComputedStyle(document.documentElement).backgroundColor.match(/\d+/g).map(Number)[1]));
        const titles = await page.$$eval("#plots h2", (list) => list.map((h) => h.textContent));
        for (const title of ["Effector error", "Base joints", "Base joint error", "Torque", "Sliding variables s", "Chatter", "Modes", "Supervisor"])
          assert.ok(titles.includes(title), `${title}: ${titles}`);
        assert.equal(titles.includes("Bus load"), command === "hil");
        assert.match(await page.textContent("#verdict .headline"), /^OK After the first 0\.25 s, the effector stayed within .* of the reference; no fault$/);
        assert.ok(await page.locator("#histograms rect").count() > 0);
        assert.equal(await page.textContent("#command"), (await data(page)).command);
        await page.context().close();
      }
      assert.ok(shades[0] > 200 && shades[1] < 60, `page backgrounds ${shades}`);
    });
  }
}

test("play, pause and scrub move the cursor, the mechanism and the map", async () => {
  const page = await open(browser, report("play", ["sim", five]));
  const row = () => page.$eval("#scrub", (scrub) => Number(scrub.value));
  const pictures = async () => (await drawn(page, "#mechanism, #map")).map(({ hash }) => hash);
  const first = await pictures();
  await page.click("#play");
  assert.equal(await page.textContent("#play"), "Pause");
  await page.waitForFunction(() => Number(document.getElementById("scrub").value) > 20 && Number(document.getElementById("scrub").value) < 1900);
  await page.click("#play");
  assert.equal(await page.textContent("#play"), "Play");
  const stopped = await row(), second = await pictures();
  assert.ok(second.every((hash, k) => hash !== first[k]));
  await frames(page);
  assert.equal(await row(), stopped, "goes on after a pause");
  await page.$eval("#scrub", (scrub) => { scrub.value = 500; scrub.dispatchEvent(new Event("input")); });
  assert.match(await page.textContent("#modes"), /Working mode 1.*Assembly mode/s);
  assert.equal(await page.evaluate(() => plots[0].axis.now.toFixed(4)), (await page.evaluate(() => time[500])).toFixed(4));
  await sound(page);
});

test("keys: one row, twenty, zoom, all, play", async () => {
  const page = await open(browser, report("keys", ["sim", rr]));
  const row = () => page.$eval("#scrub", (scrub) => Number(scrub.value));
  // What can be reached by Tab alone.
  const reached = new Set();
  for (let k = 0; k < 40; ++k) {
    await page.keyboard.press("Tab");
    reached.add(await page.evaluate(() => document.activeElement.id || document.activeElement.className || document.activeElement.tagName));
  }
  for (const one of ["play", "scrub", "speed", "panel plots"]) assert.ok(reached.has(one), `${one} not in ${[...reached]}`);
  await page.focus(".plots");
  const end = await row();
  await page.keyboard.press("ArrowLeft");
  assert.equal(await row(), end - 1);
  await page.keyboard.press("Shift+ArrowLeft");
  assert.equal(await row(), end - 21);
  await page.keyboard.press("Home");
  assert.equal(await row(), 0);
  assert.ok(await page.evaluate(() => plots.every(({ cursor }) => cursor.style.left === "0%")), "cursors of the plots");
  assert.ok(await page.evaluate(() => plots[1].series.every(({ output, values }) => output.value === sig(values[0], 4))), "values of the legend");
  const whole = (await view(page))[0];
  await page.keyboard.press("+");
  const half = await view(page);
  for (const [lo, hi] of half) assert.ok(Math.abs(hi - lo - (whole[1] - whole[0]) / 2) < 1e-9);
  await page.keyboard.press("0");
  for (const shown of await view(page)) assert.deepEqual(shown, whole);
  await page.keyboard.press("Space");
  assert.equal(await page.textContent("#play"), "Pause");
  await page.keyboard.press("Space");
  assert.equal(await page.textContent("#play"), "Play");
  await sound(page);
});

test("dragging over one plot zooms them all, a double click shows all, a name of the legend hides its line", async () => {
  const page = await open(browser, report("zoom", ["hil", five]));
  const whole = await view(page), over = await page.locator("#plots .u-over").nth(3).boundingBox();
  const at = (share) => [over.x + share * over.width, over.y + over.height / 2];
  await page.mouse.move(...at(0.25));
  await page.mouse.down();
  await page.mouse.move(...at(0.4), { steps: 4 });
  await page.mouse.move(...at(0.5), { steps: 4 });
  await page.mouse.up();
  await frames(page);
  const [lo, hi] = whole[0];
  for (const [a, b] of await view(page)) {
    assert.ok(Math.abs(a - (lo + 0.25 * (hi - lo))) < 0.01 * (hi - lo), `from ${a}`);
    assert.ok(Math.abs(b - (lo + 0.5 * (hi - lo))) < 0.01 * (hi - lo), `to ${b}`);
  }
  await page.mouse.dblclick(...at(0.5));
  await frames(page);
  for (const shown of await view(page)) assert.deepEqual(shown, whole[0]);
  const hashes = async () => (await drawn(page, "#plots canvas")).map(({ hash }) => hash);
  const [former] = [await hashes()], entry = page.locator("#plots .legend button").first();
  await entry.click();
  assert.equal(await entry.getAttribute("aria-pressed"), "false");
  await frames(page);
  const later = await hashes();
  assert.equal(later.filter((hash, k) => hash !== former[k]).length, 1, "one plot changes");
  await sound(page);
});

test("the pointer reads values of the map", async () => {
  const page = await open(browser, report("map", ["sim", five, ...sets("simulation.duration=0.5")]));
  await page.locator("#map").scrollIntoViewIfNeeded();
  assert.match(await page.textContent("#map-now"), /^effector at x .* mm: [\d.]+ N, /);
  const box = await page.locator("#map").boundingBox();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 4);
  assert.match(await page.textContent("#map-now"), /^x −?\d+, y −?\d+ mm: [\d.]+ N, sin\(φ₁₂\+φ₂₂\) = −?[\d.]+$/);
  await page.mouse.move(box.x + 2, box.y + 2);
  assert.match(await page.textContent("#map-now"), /out of reach$/);
  await sound(page);
});

test("on paper: light colours, and the screen's again afterwards", async () => {
  const page = await open(browser, report("paper", ["hil", five]), { colorScheme: "dark" });
  const former = await drawn(page, "#plots canvas");
  const pdf = await page.pdf({ format: "A4", printBackground: true });
  assert.equal(pdf.subarray(0, 5).toString(), "%PDF-");
  assert.ok(pdf.length > 50e3, `${pdf.length} bytes`);
  await frames(page);
  assert.ok(await page.evaluate(() => !document.documentElement.hasAttribute("data-printing")));
  assert.deepEqual((await drawn(page, "#plots canvas")).map(({ hash }) => hash), former.map(({ hash }) => hash));
  await page.emulateMedia({ media: "print" });
  await page.evaluate(() => window.dispatchEvent(new Event("beforeprint")));
  assert.equal(await page.locator(".controls").first().isVisible(), false);
  assert.equal(await page.evaluate(() => getComputedStyle(document.body).color), "rgb(20, 32, 43)");
  await sound(page);
});

test("a narrow window", async () => {
  for (const width of [360, 768]) {
    const page = await open(browser, report(`narrow_${width}`, ["hil", five, ...sets("simulation.duration=0.5")]), { width, height: 740 });
    await sound(page);
    await allDrawn(page);
    await page.context().close();
  }
});

test("text and lines stand out from their ground (WCAG 2.1: 4.5 for text, 3 for lines), light and dark", async () => {
  const file = report("contrast", ["sim", rr, ...sets("simulation.duration=0.1")]);
  for (const colorScheme of ["light", "dark"]) {
    const page = await open(browser, file, { colorScheme });
    const rgb = await page.evaluate(() => Object.fromEntries(["page", "panel", "ink", "muted", "select", "ok", "warn", "bad", ...Array.from({ length: 8 }, (_, k) => `c${k}`)]
      .map((name) => [name, colour(name).match(/[\d.]+/g).slice(0, 3).map(Number)])));
    const luminance = (c) => [0.2126, 0.7152, 0.0722].reduce((sum, weight, k) => {
      const v = c[k] / 255;
      return sum + weight * (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    }, 0);
    const contrast = (a, b) => { const [hi, lo] = [luminance(a), luminance(b)].sort((p, q) => q - p); return (hi + 0.05) / (lo + 0.05); };
    for (const name of ["ink", "muted", "ok", "warn", "bad"]) {
      for (const ground of ["panel", "page"]) assert.ok(contrast(rgb[name], rgb[ground]) >= 4.5, `${colorScheme}: ${name} on ${ground}`);
    }
    for (let k = 0; k < 8; ++k) assert.ok(contrast(rgb[`c${k}`], rgb.panel) >= 3, `${colorScheme}: c${k}`);
    await page.context().close();
  }
});

test("runs that are not as usual: a fault, no reference, no controller, four motors, unequal legs, a timed bus", async () => {
  const legs = path.join(out, "legs.toml"), masses = "lg1 = 0.06, lg2 = 0.068, m1 = 0.1, m2 = 0.1, J1 = 2e-4, J2 = 7e-4";
  fs.writeFileSync(legs, fs.readFileSync(five, "utf8").replace(/^leg = .*$/m, `legs = [{ l1 = 0.12, l2 = 0.16, ${masses} }, { l1 = 0.13, l2 = 0.14, ${masses} }]`));
  const cases = {
    fault: [["hil", five, ...sets("limits.joint_speed=5")], 1, /^FAULT joint_speed at t = 0\.008 s: theta11, node 1, 5\.\d+ rad\/s, limit 5$/],
    open_loop: [["sim", rr, ...sets("control.law=none", "simulation.duration=0.3")], 0, /^(OK|CHECK) /],
    four: [["sim", five, ...sets("control.motors=all", "simulation.duration=0.3")], 0, /^OK /],
    unequal: [["sim", legs, ...sets("simulation.duration=0.3")], 0, /^OK /],
    timed: [["hil", five, ...sets("effects=[{type='bit_timing'}]", "simulation.duration=0.3")], 0, /^(OK|CHECK) /],
    one_tick: [["sim", five, ...sets("simulation.duration=0.001")], 0, /./],
  };
  for (const [name, [args, status, verdict]] of Object.entries(cases)) {
    const page = await open(browser, report(name, args, status));
    assert.match(await page.textContent("#verdict .headline"), verdict, name);
    await sound(page);
    if (name !== "one_tick") await allDrawn(page, name === "fault" ? 20 : 100);  // after a fault torques are zero
    if (name === "timed") assert.deepEqual(await page.$$eval("#histograms h2", (list) => list.map((h) => h.textContent)), ["Feedback latency", "Command latency", "Tick time"]);
    if (name === "four") assert.match(await page.textContent("#plots"), /τ₂₂/);
    await page.context().close();
  }
});

test("pages of studies: the same look, quiet, nothing fetched", async () => {
  const file = report("campaign", ["campaign", "--episodes", "40"]), shades = [];
  for (const [colorScheme, width] of [["light", 1440], ["dark", 390]]) {
    const page = await open(browser, file, { colorScheme, width });
    await sound(page);
    assert.match(await page.textContent("#verdict .headline, .verdict .headline"), /^OK 0 violations of an invariant in 40 episodes$/);
    assert.ok(await page.locator("svg rect").count() > 0 && await page.locator("table tr").count() > 10);
    shades.push(await page.evaluate(() => getComputedStyle(document.querySelector(".panel")).backgroundColor));
    await page.context().close();
  }
  assert.deepEqual(shades, ["rgb(255, 255, 255)", "rgb(20, 27, 34)"]);
});

test("a run with a fault opens at the fault", async () => {
  const page = await open(browser, report("late_fault", ["hil", five, ...sets("simulation.duration=1.5", "effects=[{type='drive_dropout', drive=2, from=0.7, to=0.9}]")], 1));
  const { at, now, views } = await page.evaluate(() => ({ at: faultTime, now: plots[0].axis.now, views: plots.map(({ axis }) => axis.view) }));
  assert.ok(at > 0.7 && at < 0.71 && now === at, `${now}, the fault is at ${at}`);
  for (const [lo, hi] of views) assert.ok(lo > at - 0.5 && lo < at && hi > at && hi < at + 0.3, `${lo} to ${hi}`);
  assert.ok(await page.evaluate(() => plots.every(({ cursor }) => !cursor || parseFloat(cursor.style.left) > 0)), "cursors out of sight");
  await sound(page);
});

test("the spectrum shows the frequency at which a loop rings, the phase plane and s their layer", async () => {
  const ringing = ["effects=[{type='delay', ticks=2}]", "control.reaching=saturation", "control.layer=0.05", "simulation.duration=1.5"];
  const file = report("ringing", ["sim", five, ...sets(...ringing)]), page = await open(browser, file);
  // The frequency again, from the rows of the log and by the definition of the transform.
  const log = fs.readFileSync(path.join(path.dirname(file), "log.csv"), "utf8").trim().split("\n").map((line) => line.split(","));
  const tau = log.slice(-1000).map((row) => Number(row[log[0].indexOf("tau11")])), mean = tau.reduce((a, b) => a + b) / tau.length;
  const change = (f) => Math.sin(Math.PI * f / 1000) * Math.hypot(...["cos", "sin"].map((part) => tau.reduce((sum, v, n) => sum + (v - mean) * Math[part](2 * Math.PI * f * n / 1000), 0)));
  const all = Array.from({ length: 500 }, (_, k) => k + 1), rings = all.reduce((best, f) => (change(f) > change(best) ? f : best));
  const shown = await page.locator("#planes output").first().textContent();
  assert.ok(Math.abs(parseFloat(shown) - rings) < 3, `${shown}, by the log ${rings} Hz`);
  assert.match(await page.textContent("#planes"), /layer ±0\.0500 m\/s/);
  assert.match(await page.textContent("#plots"), /Sliding variables s.*layer ±0\.0500 m\/s/);
  for (const { coloured } of await drawn(page, "#planes canvas")) assert.ok(coloured > 100);
  await sound(page);
});

test("layouts hold at 390, 1300 and 1920 px: run, fault, studies", async () => {
  const rough = path.join(out, "study.toml");
  fs.writeFileSync(rough, `scene = "${five}"\nset = ["simulation.duration=0.3"]\npareto = [["settled_rms_m", "torque_activity_nm"]]\nobjectives = ["settled_rms_m", "torque_activity_nm"]\nsample = { method = "grid" }\n`
    + '[[vary]]\nkey = "control.lambda"\nfrom = 20.0\nto = 60.0\nsteps = 6\n');
  const a = report("a", ["sim", five]), files = [a, report("b", ["sim", rr]), report("f", ["hil", five, ...sets("limits.joint_speed=5")], 1),
    report("check", ["check", five]), report("sweep", ["sweep", rough]), report("compare", ["compare", path.dirname(a), path.dirname(a)]),
    report("design", ["design", path.join(scenes, "five_bar_robust.toml")]), report("episodes", ["campaign", "--episodes", "40"])];
  for (const file of files) {
    for (const width of [390, 1300, 1920]) {
      const page = await open(browser, file, { width });
      await sound(page);
      assert.deepEqual(await crowded(page), [], `${path.basename(path.dirname(file))} at ${width} px`);
      await page.context().close();
    }
  }
});

test("hostile data: markup in every text, gaps, one row, no row, nothing at all", async () => {
  const bad = "</script><img src=x onerror=\"fetch('https://example.invalid')\"><script>throw 1</script>";
  const scene = path.join(out, "bad.toml");
  fs.writeFileSync(scene, fs.readFileSync(five, "utf8").replace(/^name = .*$/m, `name = '''${bad}'''`));
  const file = report("hostile", ["hil", scene, ...sets("simulation.duration=0.3")]);
  const pages = {
    markup: [changed(file, "markup.html", (d) => {
      Object.assign(d, { command: bad, version: bad, scene_toml: bad, kind: bad });
      d.summary.supervisor.faults = [bad];
      d.summary.verdict = { word: bad, reasons: [bad, bad] };
      d.summary.digest = bad;
      d.histograms.forEach((h) => { h.title = h.note = bad; });
      d.rows.forEach((row) => { row[d.columns.indexOf("state")] = bad; });
    }), true],
    scene: [file, true],
    gaps: [changed(file, "gaps.html", (d) => d.rows.forEach((row, k) => { if (k % 7 === 3) for (let i = 1; i < row.length; ++i) if (typeof row[i] === "number") row[i] = null; })), true],
    all_gaps: [changed(file, "all_gaps.html", (d) => d.rows.forEach((row) => { for (let i = 1; i < row.length; ++i) if (typeof row[i] === "number") row[i] = null; })), false],
    one_row: [changed(file, "one_row.html", (d) => { d.rows.length = 1; }), false],
    no_row: [changed(file, "no_row.html", (d) => { d.rows = []; }), false],
    nothing: [changed(file, "nothing.html", (d) => { for (const key of Object.keys(d)) delete d[key]; }), false],
  };
  for (const [name, [address, whole]] of Object.entries(pages)) {
    const page = await open(browser, address);
    await sound(page);
    assert.equal(await page.locator("img").count(), 0, name);
    if (whole) await allDrawn(page);
    if (name === "scene") assert.equal(await page.textContent("h1"), bad);
    if (name === "no_row") assert.match(await page.textContent(".empty"), /^No tick was recorded/);
    await page.context().close();
  }
});
