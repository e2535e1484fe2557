#!/usr/bin/env node
// Checks the page in Chromium against the program on this machine.
//
//   page.mjs PAGE ELUNAR ELUNAR_WEB [PICTURES]      folder of the page (host-train/web/build.sh), the two native programs, folder for screenshots
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { copyFileSync, mkdirSync, mkdtempSync, readFileSync, rmSync, statSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { basename, join } from "node:path";
import { pathToFileURL } from "node:url";
import { chromium } from "./chromium.mjs";
import { serve } from "./server.mjs";
import { click, fits, set, shadeDifference, watched } from "./watched.mjs";

const [page, elunar, web, pictures = join(page, "../page-pictures")] = process.argv.slice(2);
const [{ parse }, { between }] = await Promise.all(["maps.js", "samples.js"].map((name) => import(pathToFileURL(join(page, name)))));
const MOST = { program_bytes: 1e6, page_bytes: 7e6, example_bytes: 3e5 };
const work = mkdtempSync(join(tmpdir(), "elunar-page-test-"));
mkdirSync(pictures, { recursive: true });
const server = await serve(page);
const browser = await chromium(process.env.CHROMIUM ?? "chromium");

const open = (search, size) => watched(browser, `${server.origin}/${search}`, size, "document.getElementById('image-sun').ariaValueNow !== null");

const done = "document.getElementById('status').textContent.startsWith('done')";
const base64 = async (page, name) => Buffer.from(await page.evaluate(`(async () => {
  const bytes = new Uint8Array(await (await fetch(document.querySelector('a[download="${name}"]').href)).arrayBuffer());
  let text = ""; for (let i = 0; i < bytes.length; i += 32768) text += String.fromCharCode(...bytes.subarray(i, i + 32768));
  return btoa(text); })()`), "base64");

/** Runs the command that the page shows, on this machine; returns the folder with its files. */
async function natively(opened) {
  for (const name of ["example_image.tif", "example_coarse.tif", "nano.eld"]) copyFileSync(join(page, name), join(work, name));
  const words = (await opened.evaluate("document.getElementById('command').textContent")).split(" ").slice(1);
  execFileSync(elunar, words, { cwd: work, stdio: "pipe" });
  return words;
}

/** The whole way with the example. */
async function example(opened) {
  const start = Date.now();
  await opened.evaluate(click("example"));
  await opened.until(done);
  const seconds = (Date.now() - start) / 1000;
  const words = await natively(opened);
  for (const name of ["dtm.tif", "errors.tif", "dtm_hillshade.png"]) {
    assert.ok((await base64(opened, name)).equals(readFileSync(join(work, name))), `${name}: the bytes of \`elunar predict\` expected`);
  }
  const shades = [];
  for (const [azimuth, elevation] of [[315, 45], [90, 20], [200, 60]]) shades.push(await shadeDifference(opened, elunar, join(work, "dtm.tif"), [azimuth, elevation]));
  shades.forEach((difference) => assert.ok(difference < 3, `the relief expected as the hillshade, found ${difference} grey values apart`));
  return { seconds, words, shades };
}

/** Gives files to an input. */
async function give(opened, id, paths) {
  const { root } = await opened.call("DOM.getDocument");
  const { nodeId } = await opened.call("DOM.querySelector", { nodeId: root.nodeId, selector: `#${id}` });
  await opened.call("DOM.setFileInputFiles", { nodeId, files: paths });
  await opened.until(`document.querySelector("#drop-${id} output").textContent.includes(${JSON.stringify(basename(paths[0]))})`);
}

/** The scene of the golden flight tile, as a user's own files, with its truth. */
async function own(opened) {
  execFileSync(elunar, ["synth", "--out", "own", "--rows", "256", "--cols", "320", "--seed", "6", "--kind", "highland"], { cwd: work, stdio: "pipe" });
  const file = (what) => join(work, "own", `scene_0000_${what}.tif`);
  for (const what of ["image", "coarse", "truth"]) await give(opened, what, [file(what)]);
  await opened.evaluate(`document.getElementById("status").textContent = ""; ${click("predict")}`);
  await opened.until(done);
  for (const what of ["image", "coarse"]) copyFileSync(file(what), join(work, basename(file(what))));
  await natively(opened);
  assert.ok((await base64(opened, "dtm.tif")).equals(readFileSync(join(work, "dtm.tif"))), "the bytes of `elunar predict` expected");
  const scored = execFileSync(elunar, ["evaluate", "--json", "--dtm", "dtm.tif", "--truth", file("truth")], { cwd: work, stdio: ["ignore", "pipe", "pipe"] });
  const [{ rmse_m }] = JSON.parse(scored).candidates;
  const worst = await opened.evaluate("Math.max(...document.getElementById('profile').profile.map(({ height, truth }) => Math.abs(height - truth)))");
  assert.ok(worst > 0 && worst < 10 * rmse_m, `the truth along the profile expected, found it ${worst} m away`);
  assert.equal(await opened.evaluate("document.getElementById('slot-2').options.length"), 4);
}

/** The profile by two clicks. Returns its number of points. */
async function profile(opened, words) {
  const inputs = words.slice(1, words.indexOf("--model"));
  execFileSync(web, ["view", ...inputs, "--dtm", "dtm.tif", "--uncertainty", "errors.tif", "-o", "maps.bin"], { cwd: work, stdio: "pipe" });
  const maps = parse(new Uint8Array(readFileSync(join(work, "maps.bin"))));
  const box = await opened.evaluate("(({ x, y, width, height }) => ({ x, y, width, height }))((document.getElementById('relief').scrollIntoView(), document.getElementById('relief').getBoundingClientRect()))");
  for (const [x, y] of [[0.2, 0.3], [0.7, 0.8]]) {
    const at = { x: box.x + x * box.width, y: box.y + y * box.height, button: "left", clickCount: 1 };
    await opened.call("Input.dispatchMouseEvent", { ...at, type: "mousePressed" });
    await opened.call("Input.dispatchMouseEvent", { ...at, type: "mouseReleased" });
  }
  const points = await opened.until("(p => p.length > 20 && Math.abs(p[0].col / p.at(-1).col - 0.2 / 0.7) < 0.02 && p)(document.getElementById('profile').profile)", 10);
  for (const { col, row, height, sigma, coarse } of points) {
    for (const [found, map] of [[height, maps.heights], [sigma, maps.sigma], [coarse, maps.coarse]]) {
      const expected = between(map, maps.cols, maps.rows, col, row);
      assert.ok(Object.is(found, expected) || Math.abs(found - expected) < 1e-6 * Math.max(1, Math.abs(expected)), `${found} at ${col}, ${row}: ${expected} expected`);
    }
  }
  return points.length;
}

/** The profile by keys. */
async function keys(opened) {
  const key = (name) => opened.call("Input.dispatchKeyEvent", { type: "keyDown", key: name });
  await opened.evaluate("document.getElementById('relief').focus()");
  for (const name of ["ArrowUp", "Enter", "ArrowLeft", "ArrowLeft", "Enter"]) await key(name);
  await opened.until("(p => p[0].col - p.at(-1).col > 1 && p[0].row === p.at(-1).row)(document.getElementById('profile').profile)", 10);
}

/** Errors are words; a job can be stopped. */
async function refusals(opened) {
  const broken = join(work, "broken.tif");
  writeFileSync(broken, "no raster");
  await give(opened, "coarse", [broken]);
  await opened.evaluate(click("predict"));
  const said = await opened.until("document.getElementById('errors').textContent");
  assert.match(said, /broken\.tif/);
  await opened.evaluate(click("example"));
  await opened.until("!document.getElementById('cancel').disabled");
  await opened.evaluate(click("cancel"));
  await opened.until("document.getElementById('errors').textContent.startsWith('Stopped')", 10);
  await opened.until("!document.getElementById('example').disabled", 10);
}

async function pictureOf(opened, name) {
  for (const [id, value] of [["divide", 0.333], ["divide-2", 0.667], ["tint", true], ["azimuth", 125], ["elevation", 28]]) await opened.evaluate(set(id, value));
  writeFileSync(join(pictures, name), await opened.picture());
}

const figures = {};
try {
  const wide = { width: 1280, height: 900 };
  const opened = await open("", wide);
  const { seconds, words, shades } = await example(opened);
  figures.example_s = seconds;
  figures.shade_difference = shades.map((difference) => difference.toFixed(2)).join(" ");
  figures.profile_points = await profile(opened, words);
  await fits(opened, 1280);
  await pictureOf(opened, "page-1280.png");
  writeFileSync(join(pictures, "page.png"), await opened.picture(1640, 0.5)); // that of the README
  for (const [id, value] of [["tilt", 55], ["turn", 25], ["exaggeration", 2], ["hazards", true]]) await opened.evaluate(set(id, value));
  writeFileSync(join(pictures, "page-1280-tilted.png"), await opened.picture());
  await keys(opened);
  await own(opened);
  await refusals(opened);
  assert.deepEqual(opened.faults, []);
  await opened.close();

  const narrow = await open("", { width: 390, height: 844, dark: true });
  await narrow.evaluate(click("example"));
  await narrow.until(done);
  await fits(narrow, 390);
  await pictureOf(narrow, "page-390-dark.png");
  assert.deepEqual(narrow.faults, []);
  await narrow.close();

  const plain = await open("?canvas", wide);
  const { shades: drawn } = await example(plain);
  figures.shade_difference_canvas = drawn.map((difference) => difference.toFixed(2)).join(" ");
  assert.match(await plain.evaluate("document.getElementById('view-text').textContent"), /drawn by canvas/);
  assert.deepEqual(plain.faults, []);
  await plain.close();

  figures.page_bytes = Object.values(server.sent).reduce((sum, bytes) => sum + bytes, 0);
  figures.program_bytes = Math.max(...["elunar.wasm.gz", "elunar-simd128.wasm.gz"].map((name) => statSync(join(page, name)).size));
  figures.example_bytes = ["example_image.tif", "example_coarse.tif"].reduce((sum, name) => sum + statSync(join(page, name)).size, 0);
  Object.entries(MOST).forEach(([name, most]) => assert.ok(figures[name] < most, `${name}: less than ${most} expected, ${figures[name]} found`));
} finally {
  await browser.close();
  server.close();
  rmSync(work, { recursive: true, force: true });
}
Object.entries(figures).forEach(([name, value]) => console.log(`${name}: ${value}`));
