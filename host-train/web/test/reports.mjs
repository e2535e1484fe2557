#!/usr/bin/env node
// Checks reports in Chromium: that of `predict` against `elunar hillshade`, and other pages with a relief.
//
//   reports.mjs PAGE ELUNAR PICTURES [REPORT.html ...]   folder of the page (its example is used), the native program, folder for screenshots
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { copyFileSync, mkdirSync, mkdtempSync, rmSync, statSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { basename, join } from "node:path";
import { chromium } from "./chromium.mjs";
import { serve } from "./server.mjs";
import { fits, set, shadeDifference, watched } from "./watched.mjs";

const [page, elunar, pictures, ...reports] = process.argv.slice(2);
const MOST_BYTES = 3e6;
const work = mkdtempSync(join(tmpdir(), "elunar-report-test-"));
mkdirSync(pictures, { recursive: true });
const server = await serve(work);
const browser = await chromium(process.env.CHROMIUM ?? "chromium");
const shown = "document.getElementById('terrain').dataset.shown !== undefined";
const open = (name, size) => watched(browser, `${server.origin}/${name}`, size, shown);

/** A page on two widths: it fits, it has a profile, its relief follows the light, nothing goes wrong. Returns its bytes. */
async function looked(name) {
  for (const [width, dark] of [[1280, false], [390, true]]) {
    const opened = await open(name, { width, height: 844, dark });
    await fits(opened, width);
    writeFileSync(join(pictures, `${basename(name, ".html")}-${width}.png`), await opened.picture(width === 390 ? undefined : 1800));
    const drawn = "document.getElementById('relief').toDataURL()";
    const before = await opened.evaluate(drawn);
    await opened.evaluate(set("azimuth", 200));
    assert.notEqual(await opened.evaluate(drawn), before, `${name}: another light expected to change the relief`);
    assert.ok(await opened.evaluate("document.getElementById('profile').profile.length > 20"), `${name}: a profile expected`);
    const scenes = await opened.evaluate("document.getElementById('scene')?.options.length ?? 1");
    if (scenes > 1) {
      await opened.evaluate(set("scene", scenes - 1));
      await opened.until(`document.getElementById('terrain').dataset.shown === "${scenes - 1}"`, 20);
    }
    assert.deepEqual(opened.faults, [], name);
    await opened.close();
  }
  return statSync(join(work, name)).size;
}

try {
  for (const name of ["example_image.tif", "example_coarse.tif"]) copyFileSync(join(page, name), join(work, name));
  const inputs = ["--image", "example_image.tif", "--coarse", "example_coarse.tif", "--model", "ground"];
  execFileSync(elunar, ["predict", ...inputs, "--uncertainty", "errors.tif", "--report", "predict.html", "-o", "dtm.tif"], { cwd: work, stdio: "pipe" });
  const opened = await open("predict.html", { width: 1280, height: 900 });
  const shades = [];
  for (const light of [[315, 45], [90, 20], [200, 60]]) shades.push(await shadeDifference(opened, elunar, join(work, "dtm.tif"), light));
  shades.forEach((difference) => assert.ok(difference < 3, `the relief expected as the hillshade, found ${difference} grey values apart`));
  assert.ok(await opened.evaluate("document.getElementById('profile').profile.every(({ sigma }) => sigma > 0)"), "expected errors along the profile");
  await opened.close();
  console.log(`report_shade_difference: ${shades.map((difference) => difference.toFixed(2)).join(" ")}`);
  reports.forEach((report) => copyFileSync(report, join(work, basename(report))));
  for (const name of ["predict.html", ...reports.map((report) => basename(report))]) {
    const bytes = await looked(name);
    assert.ok(bytes < MOST_BYTES, `${name}: less than ${MOST_BYTES} bytes expected, ${bytes} found`);
    console.log(`${name}: ${bytes} bytes`);
  }
} finally {
  await browser.close();
  server.close();
  rmSync(work, { recursive: true, force: true });
}
