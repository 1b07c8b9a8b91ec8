// A picture of a page as the documents show it. usage: screenshot.js PAGE PICTURE.png [light|dark] [WIDTHxHEIGHT] [ROW]
// WIDTHxHEIGHT: the window, of which the picture shows all; ROW: of the log, where the mechanism stands.
"use strict";

const { launch, open, frames } = require("./browser");

(async () => {
  const [page, picture, colorScheme = "light", size = "1440x1160", row] = process.argv.slice(2);
  const [width, height] = size.split("x").map(Number);
  if (!picture || !(width > 0 && height > 0)) {
    console.error("usage: screenshot.js PAGE PICTURE.png [light|dark] [WIDTHxHEIGHT] [ROW]");
    process.exit(2);
  }
  const browser = await launch(), shown = await open(browser, page, { colorScheme, width, height });
  if (row) await shown.$eval("#scrub", (scrub, at) => { scrub.value = at; scrub.dispatchEvent(new Event("input")); }, row);
  await frames(shown);
  await shown.screenshot({ path: picture });
  await browser.close();
  for (const trouble of shown.troubles) console.error(trouble);
  process.exit(shown.troubles.length ? 1 : 0);
})();
