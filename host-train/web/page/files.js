// Files in memory, in one folder.

/** One file: bytes that grow at their end. */
export class MemoryFile {
  constructor(bytes = new Uint8Array(0)) {
    this.room = bytes;
    this.length = bytes.length;
  }

  /** The bytes. */
  get bytes() {
    return this.room.subarray(0, this.length);
  }

  /** Makes the file so long; what is new is zero. */
  resize(length) {
    if (length > this.room.length) {
      const room = new Uint8Array(Math.max(length, 2 * this.room.length));
      room.set(this.bytes);
      this.room = room;
    } else if (length < this.length) {
      this.room.fill(0, length, this.length);
    }
    this.length = length;
  }

  /** Copies bytes into `to` from a place on; returns how many there were. */
  read(at, to) {
    const found = this.bytes.subarray(at, at + to.length);
    to.set(found);
    return found.length;
  }

  /** Writes bytes at a place. */
  write(at, from) {
    if (at + from.length > this.length) this.resize(at + from.length);
    this.room.set(from, at);
  }
}

/** Makes a folder, a map of names to files, of names and bytes. */
export function folder(contents) {
  return new Map(Object.entries(contents).map(([name, bytes]) => [name, new MemoryFile(bytes)]));
}
