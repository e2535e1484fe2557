// Chromium by its DevTools protocol, over pipes.
import { spawn } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

/** Starts Chromium without a window; returns {open, close}. */
export function chromium(program) {
  const home = mkdtempSync(join(tmpdir(), "elunar-page-"));
  // WebGL is computed on the processor, so that every machine has it.
  const flags = ["--headless=new", "--no-sandbox", "--remote-debugging-pipe", `--user-data-dir=${home}`, "--no-first-run",
    "--disable-background-networking", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars", "--disable-dev-shm-usage"];
  const child = spawn(program, [...flags, "about:blank"], { stdio: ["ignore", "ignore", "ignore", "pipe", "pipe"] });
  const [ask, answer] = [child.stdio[3], child.stdio[4]];
  const waiting = new Map();
  const listeners = new Set();
  let [next, rest] = [1, Buffer.alloc(0)];
  const ended = new Promise((resolve) => child.once("exit", resolve));
  child.once("exit", (code) => waiting.forEach(({ reject }) => reject(new Error(`${program} ended with ${code}`))));
  answer.on("data", (bytes) => {
    rest = Buffer.concat([rest, bytes]);
    for (let end = rest.indexOf(0); end >= 0; end = rest.indexOf(0)) {
      const message = JSON.parse(rest.subarray(0, end).toString());
      rest = rest.subarray(end + 1);
      const call = waiting.get(message.id);
      waiting.delete(message.id);
      if (!call) listeners.forEach((hear) => hear(message));
      else if (message.error) call.reject(new Error(`${call.method}: ${message.error.message}`));
      else call.resolve(message.result);
    }
  });
  const send = (method, params = {}, sessionId) => new Promise((resolve, reject) => {
    waiting.set(next, { resolve, reject, method });
    ask.write(JSON.stringify({ id: next++, method, params, sessionId }) + "\0");
  });

  return {
    /** Opens a page of this size. `heard` gets every event of it. */
    async open(url, { width, height, dark = false }, heard) {
      const { targetId } = await send("Target.createTarget", { url: "about:blank" });
      const { sessionId } = await send("Target.attachToTarget", { targetId, flatten: true });
      const call = (method, params) => send(method, params, sessionId);
      listeners.add((event) => event.sessionId === sessionId && heard(event));
      await Promise.all(["Page", "Runtime", "Network", "Log", "DOM"].map((domain) => call(`${domain}.enable`)));
      await call("Emulation.setDeviceMetricsOverride", { width, height, deviceScaleFactor: 1, mobile: width < 500 });
      await call("Emulation.setEmulatedMedia", { features: [{ name: "prefers-color-scheme", value: dark ? "dark" : "light" }] });
      await call("Page.navigate", { url });
      const evaluate = async (expression) => {
        const { result, exceptionDetails } = await call("Runtime.evaluate", { expression, awaitPromise: true, returnByValue: true });
        if (exceptionDetails) throw new Error(exceptionDetails.exception?.description ?? exceptionDetails.text);
        return result.value;
      };
      /** Waits until an expression is true. */
      const until = async (expression, seconds = 120) => {
        for (const end = Date.now() + 1000 * seconds; Date.now() < end; await new Promise((wake) => setTimeout(wake, 50))) {
          const found = await evaluate(expression).catch(() => undefined);
          if (found) return found;
        }
        const said = await evaluate("document.body.innerText.slice(0, 800)");
        throw new Error(`${expression} expected within ${seconds} s, found:\n${said}`);
      };
      /** A picture of the whole page, or of its top. */
      const picture = async (top, scale = 1) => {
        const { cssContentSize } = await call("Page.getLayoutMetrics");
        const clip = { x: 0, y: 0, width, height: top ?? cssContentSize.height, scale };
        const { data } = await call("Page.captureScreenshot", { format: "png", captureBeyondViewport: true, clip });
        return Buffer.from(data, "base64");
      };
      return { call, evaluate, until, picture, close: () => send("Target.closeTarget", { targetId }) };
    },
    async close() {
      await send("Browser.close").catch(() => child.kill());
      await ended;
      rmSync(home, { recursive: true, force: true, maxRetries: 5, retryDelay: 200 });
    },
  };
}
