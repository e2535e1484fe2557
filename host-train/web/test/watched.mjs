// A page that is watched: what it asks for, what goes wrong in it, and what it draws.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { dirname, join } from "node:path";

/** Opens a page and watches it: no request leaves its server, nothing goes wrong in it. It is there when `ready` is true. */
export async function watched(browser, url, size, ready) {
  const faults = [];
  const { origin } = new URL(url);
  const opened = await browser.open(url, size, ({ method, params }) => {
    if (method === "Network.requestWillBeSent" && !/^(blob|data):/.test(params.request.url) && !params.request.url.startsWith(origin + "/")) {
      faults.push(`a request to ${params.request.url}`);
    }
    if (method === "Network.loadingFailed" && !params.canceled) faults.push(`loading: ${params.errorText}`);
    if (method === "Runtime.exceptionThrown") faults.push(params.exceptionDetails.exception?.description ?? params.exceptionDetails.text);
    if (method === "Runtime.consoleAPICalled" && ["error", "warning"].includes(params.type)) faults.push(JSON.stringify(params.args));
    if (method === "Log.entryAdded" && params.entry.level === "error" && !params.entry.url?.endsWith("/favicon.ico")) faults.push(params.entry.text);
  });
  await opened.until(`document.readyState === "complete" && ${ready}`, 30);
  return { ...opened, faults };
}

/** The script that clicks an element. */
export const click = (id) => `document.getElementById(${JSON.stringify(id)}).click()`;

/** The script that sets a control. */
export const set = (id, value) =>
  `(() => { const e = document.getElementById(${JSON.stringify(id)}); e.type === "checkbox" ? (e.checked = ${value}) : (e.value = ${value}); e.dispatchEvent(new Event("input")); })()`;

/** Nothing is wider than the page. */
export async function fits(opened, width) {
  const found = await opened.evaluate("document.scrollingElement.scrollWidth");
  assert.ok(found <= width, `a page of ${width} px expected, ${found} found`);
}

/** Compares the canvas, one pixel of the DTM each, with `elunar hillshade`. Returns the mean difference in grey values. */
export async function shadeDifference(opened, elunar, dtm, [azimuth, elevation]) {
  const shade = join(dirname(dtm), "shade.png");
  execFileSync(elunar, ["hillshade", dtm, "-o", shade, "--azimuth", `${azimuth}`, "--altitude", `${elevation}`], { stdio: "pipe" });
  const plain = [["divide", 0], ["divide-2", 0], ["tint", false], ["tilt", 0], ["turn", 0], ["exaggeration", 1], ["azimuth", azimuth], ["elevation", elevation]];
  for (const [id, value] of plain) await opened.evaluate(set(id, value));
  await opened.evaluate("document.getElementById('hazards')?.checked && document.getElementById('hazards').click()");
  return opened.evaluate(`(async () => {
    const bytes = Uint8Array.from(atob("${readFileSync(shade).toString("base64")}"), (c) => c.charCodeAt(0));
    const truth = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const grey = (picture, cols, rows) => {
      const context = new OffscreenCanvas(cols, rows).getContext("2d", { willReadFrequently: true });
      context.drawImage(picture, 0, 0);
      return context.getImageData(0, 0, cols, rows).data;
    };
    const canvas = document.getElementById("relief");
    const [cols, rows] = [truth.width, truth.height];
    const factor = canvas.width / cols;
    const [expected, found] = [grey(truth, cols, rows), grey(canvas, canvas.width, canvas.height)];
    let [sum, count] = [0, 0];
    for (let row = 2; row < rows - 2; row++) for (let col = 2; col < cols - 2; col++) {
      const e = expected[4 * (row * cols + col)];
      if (e === 0) continue;
      // The mean over the pixels of the canvas that one pixel of the DTM covers.
      let f = 0;
      for (let r = 0; r < factor; r++) for (let c = 0; c < factor; c++) f += found[4 * ((row * factor + r) * canvas.width + col * factor + c)];
      sum += Math.abs(f / factor ** 2 - e);
      count++;
    }
    return count > cols * rows / 2 ? sum / count : NaN;
  })()`);
}
