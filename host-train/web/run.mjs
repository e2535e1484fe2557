#!/usr/bin/env node
// Runs a program for WASI with the page's system calls:  run.mjs [--folder DIR] PROGRAM.wasm [ARGUMENT...]
// Its files are those of the folder; what it writes is written there at its end. Without a folder it has no files.
import { mkdirSync, readFileSync, readdirSync, statSync, writeFileSync } from "node:fs";
import { basename, join } from "node:path";
import { webcrypto } from "node:crypto";
import { folder } from "./page/files.js";
import { run } from "./page/wasi.js";

globalThis.crypto ??= webcrypto;
const words = process.argv.slice(2);
const place = words[0] === "--folder" ? words.splice(0, 2)[1] : undefined;
const names = place ? readdirSync(place).filter((name) => statSync(join(place, name)).isFile()) : [];
const files = folder(Object.fromEntries(names.map((name) => [name, new Uint8Array(readFileSync(join(place, name)))])));
const before = new Map([...files].map(([name, file]) => [name, file.bytes.slice()]));
const [program, ...rest] = words;
const module = new WebAssembly.Module(readFileSync(program));
let code, out;
try {
  ({ code, out } = run(module, [basename(program), ...rest], files, (line) => process.stderr.write(line + "\n")));
} catch (trap) {
  [code, out] = [134, trap.out ?? ""];
  process.stderr.write(`${trap.stack}\n`);
}
process.stdout.write(out);
if (place) {
  mkdirSync(place, { recursive: true });
  for (const [name, { bytes }] of files) {
    if (!before.has(name) || Buffer.compare(before.get(name), bytes) !== 0) writeFileSync(join(place, name), bytes);
  }
}
process.exitCode = code;
