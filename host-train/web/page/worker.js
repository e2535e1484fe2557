// Runs a program in a thread of its own, so that the page stays awake. One job a worker.

import { folder } from "./files.js";
import { run } from "./wasi.js";

onmessage = ({ data: { module, commands, files, take } }) => {
  try {
    const all = folder(files);
    let ended = { code: 0, out: "" };
    const outs = [];
    for (const args of commands) {
      ended = run(module, ["elunar-web", ...args], all, (line) => postMessage({ line }));
      outs.push(ended.out);
      if (ended.code !== 0) break;
    }
    const taken = Object.fromEntries(take.filter((name) => all.has(name)).map((name) => [name, all.get(name).bytes.slice()]));
    postMessage({ code: ended.code, outs, files: taken }, Object.values(taken).map((bytes) => bytes.buffer));
  } catch (error) {
    postMessage({ line: `ERROR: ${error.message ?? error}` });
    postMessage({ code: 70, outs: [], files: {} });
  }
};
