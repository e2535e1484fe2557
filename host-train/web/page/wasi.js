// The system calls of a program for WASI (preview 1) that works on files in memory. It has no network, no folders, no threads.

import { MemoryFile } from "./files.js";

const [OK, BADF, EXIST, INVAL, NOENT, NOTDIR, NOTSUP] = [0, 8, 20, 28, 44, 54, 58];
const [CHARACTERS, FOLDER, REGULAR] = [2, 3, 4];
const [CREATE, ONLY_FOLDER, EXCLUSIVE, TRUNCATE] = [1, 2, 4, 8];
const APPEND = 1;
const ALL_RIGHTS = 0xffff_ffff_ffff_ffffn;
const ROOTS = new Map([[3, "/"], [4, "."]]); // the folder under its two names

class Exit extends Error {
  constructor(code) {
    super(`exit ${code}`);
    this.code = code;
  }
}

/**
 * Runs a compiled program to its end.
 * @param module the WebAssembly.Module
 * @param args its command line, with its name
 * @param files a folder (files.js); the program changes it
 * @param say is given each line of standard error
 * @returns {{code: number, out: string}} exit code and standard output
 */
export function run(module, args, files, say) {
  const text = { encode: new TextEncoder(), decode: new TextDecoder() };
  const opened = new Map(); // by descriptor: {file, at, append}; the folder has no file
  const times = new WeakMap(); // by file: nanoseconds of the last change
  const written = { 1: "", 2: "" };
  let memory, next = 5;

  const view = () => new DataView(memory.buffer);
  const part = (at, length) => new Uint8Array(memory.buffer, at, length);
  const now = () => BigInt(Math.round((performance.timeOrigin + performance.now()) * 1e6));
  const name = (at, length) =>
    text.decode.decode(part(at, length).slice()).split("/").filter((word) => word !== "" && word !== ".").join("/");
  const set = (at, ...words) => words.forEach((word, i) => view().setUint32(at + 4 * i, word, true));

  function wrote(fd, bytes) {
    const lines = (written[fd] + text.decode.decode(bytes.slice(), { stream: false })).split("\n");
    if (fd === 1) {
      written[1] = lines.join("\n");
    } else {
      written[2] = lines.pop();
      lines.forEach(say);
    }
  }

  /** Calls `act` for every buffer of a list until one is not filled; returns the sum of what it says. */
  function buffers(list, count, act) {
    let sum = 0;
    for (let i = 0; i < count; i++) {
      const [at, length] = [view().getUint32(list + 8 * i, true), view().getUint32(list + 8 * i + 4, true)];
      const done = act(part(at, length), sum);
      sum += done;
      if (done < length) break;
    }
    return sum;
  }

  function stat(at, kind, file) {
    part(at, 64).fill(0);
    const of = view();
    of.setUint8(at + 16, kind);
    of.setBigUint64(at + 24, 1n, true);
    of.setBigUint64(at + 32, BigInt(file?.length ?? 0), true);
    [40, 48, 56].forEach((offset) => of.setBigUint64(at + offset, (file && times.get(file)) ?? 0n, true));
    return OK;
  }

  function strings(list, pointers, buffer) {
    for (const word of list) {
      const bytes = text.encode.encode(word + "\0");
      set(pointers, buffer);
      part(buffer, bytes.length).set(bytes);
      pointers += 4;
      buffer += bytes.length;
    }
    return OK;
  }

  function sizes(list, count, length) {
    set(count, list.length);
    set(length, list.reduce((sum, word) => sum + text.encode.encode(word).length + 1, 0));
    return OK;
  }

  function write(fd, list, count, at, result) {
    if (fd === 1 || fd === 2) {
      set(result, buffers(list, count, (bytes) => (wrote(fd, bytes), bytes.length)));
      return OK;
    }
    const open = opened.get(fd);
    if (!open?.file) return BADF;
    const from = at ?? (open.append ? open.file.length : open.at);
    const sum = buffers(list, count, (bytes, before) => (open.file.write(from + before, bytes), bytes.length));
    if (at === undefined) open.at = from + sum;
    times.set(open.file, now());
    set(result, sum);
    return OK;
  }

  function read(fd, list, count, at, result) {
    const open = opened.get(fd);
    if (!open?.file) return fd === 0 ? (set(result, 0), OK) : BADF;
    const from = at ?? open.at;
    const sum = buffers(list, count, (to, before) => open.file.read(from + before, to));
    if (at === undefined) open.at = from + sum;
    set(result, sum);
    return OK;
  }

  const calls = {
    args_get: (pointers, buffer) => strings(args, pointers, buffer),
    args_sizes_get: (count, length) => sizes(args, count, length),
    environ_get: () => OK,
    environ_sizes_get: (count, length) => sizes([], count, length),
    clock_res_get: (_, at) => (view().setBigUint64(at, 1000n, true), OK),
    clock_time_get: (_, __, at) => (view().setBigUint64(at, now(), true), OK),
    random_get: (at, length) => {
      for (let i = 0; i < length; i += 65536) crypto.getRandomValues(part(at + i, Math.min(65536, length - i)));
      return OK;
    },
    sched_yield: () => OK,
    proc_exit: (code) => {
      throw new Exit(code);
    },
    // A program that has no threads waits for clocks alone; time does not pass for it.
    poll_oneoff: (waits, events, count, at) => {
      part(events, 32 * count).fill(0);
      for (let i = 0; i < count; i++) part(events + 32 * i, 8).set(part(waits + 48 * i, 8));
      set(at, count);
      return OK;
    },

    fd_prestat_get: (fd, at) => (ROOTS.has(fd) ? (set(at, 0, 1), OK) : BADF),
    fd_prestat_dir_name: (fd, at, length) => (part(at, length).set(text.encode.encode(ROOTS.get(fd))), OK),
    fd_fdstat_get: (fd, at) => {
      if (fd > 4 && !opened.has(fd)) return BADF;
      part(at, 24).fill(0);
      view().setUint8(at, fd < 3 ? CHARACTERS : opened.get(fd)?.file ? REGULAR : FOLDER);
      view().setUint16(at + 2, opened.get(fd)?.append ? APPEND : 0, true);
      [8, 16].forEach((offset) => view().setBigUint64(at + offset, ALL_RIGHTS, true));
      return OK;
    },
    fd_fdstat_set_flags: (fd, flags) => (opened.has(fd) ? ((opened.get(fd).append = flags & APPEND), OK) : BADF),
    fd_filestat_get: (fd, at) => {
      const file = opened.get(fd)?.file;
      return file ? stat(at, REGULAR, file) : stat(at, fd < 3 ? CHARACTERS : FOLDER);
    },
    fd_filestat_set_size: (fd, size) => (opened.get(fd)?.file ? (opened.get(fd).file.resize(Number(size)), OK) : BADF),
    fd_filestat_set_times: () => OK,
    fd_sync: () => OK,
    fd_datasync: () => OK,
    fd_close: (fd) => (opened.delete(fd) ? OK : BADF),
    fd_read: (fd, list, count, result) => read(fd, list, count, undefined, result),
    fd_pread: (fd, list, count, at, result) => read(fd, list, count, Number(at), result),
    fd_write: (fd, list, count, result) => write(fd, list, count, undefined, result),
    fd_pwrite: (fd, list, count, at, result) => write(fd, list, count, Number(at), result),
    fd_seek: (fd, by, from, at) => {
      const open = opened.get(fd);
      if (!open?.file) return BADF;
      const to = [0, open.at, open.file.length][from] + Number(by);
      if (!(to >= 0)) return INVAL;
      open.at = to;
      view().setBigUint64(at, BigInt(to), true);
      return OK;
    },
    fd_tell: (fd, at) => (opened.has(fd) ? (view().setBigUint64(at, BigInt(opened.get(fd).at), true), OK) : BADF),
    fd_readdir: (_, buffer, length, cookie, used) => {
      let at = 0;
      [...files.keys()].slice(Number(cookie)).every((key, i) => {
        const bytes = text.encode.encode(key);
        const entry = new Uint8Array(24 + bytes.length);
        const head = new DataView(entry.buffer);
        head.setBigUint64(0, cookie + BigInt(i) + 1n, true);
        head.setUint32(16, bytes.length, true);
        head.setUint8(20, REGULAR);
        entry.set(bytes, 24);
        const room = entry.subarray(0, length - at);
        part(buffer + at, room.length).set(room);
        at += room.length;
        return at < length;
      });
      set(used, at);
      return OK;
    },

    path_open: (_, __, at, length, how, rights, ___, flags, result) => {
      const path = name(at, length);
      if (path === "") {
        if (how & ~ONLY_FOLDER) return EXIST;
        opened.set(next, {});
        set(result, next++);
        return OK;
      }
      if (how & ONLY_FOLDER) return files.has(path) ? NOTDIR : NOENT;
      if (files.has(path) && how & CREATE && how & EXCLUSIVE) return EXIST;
      if (!files.has(path)) {
        if (!(how & CREATE)) return NOENT;
        files.set(path, new MemoryFile());
        times.set(files.get(path), now());
      }
      const file = files.get(path);
      if (how & TRUNCATE) file.resize(0);
      opened.set(next, { file, at: 0, append: flags & APPEND });
      set(result, next++);
      return OK;
    },
    path_filestat_get: (_, __, at, length, result) => {
      const path = name(at, length);
      if (path === "") return stat(result, FOLDER);
      return files.has(path) ? stat(result, REGULAR, files.get(path)) : NOENT;
    },
    path_filestat_set_times: () => OK,
    path_link: (_, __, at, length, ___, to, toLength) => {
      const [from, path] = [name(at, length), name(to, toLength)];
      if (!files.has(from)) return NOENT;
      if (files.has(path)) return EXIST;
      files.set(path, files.get(from));
      return OK;
    },
    path_readlink: (_, at, length) => (files.has(name(at, length)) || name(at, length) === "" ? INVAL : NOENT),
    path_rename: (_, at, length, __, to, toLength) => {
      const [from, path] = [name(at, length), name(to, toLength)];
      if (!files.has(from)) return NOENT;
      const file = files.get(from);
      files.delete(from);
      files.set(path, file);
      return OK;
    },
    path_unlink_file: (_, at, length) => (files.delete(name(at, length)) ? OK : NOENT),
  };
  // What else a program may ask for is not supported.
  const asked = WebAssembly.Module.imports(module).map(({ name }) => [name, calls[name] ?? (() => NOTSUP)]);
  const instance = new WebAssembly.Instance(module, { wasi_snapshot_preview1: Object.fromEntries(asked) });
  memory = instance.exports.memory;
  let code = 0;
  try {
    instance.exports._start();
  } catch (end) {
    if (!(end instanceof Exit)) {
      if (written[2]) say(written[2]);
      throw Object.assign(end, { out: written[1] });
    }
    code = end.code;
  }
  if (written[2]) say(written[2]);
  return { code, out: written[1] };
}
