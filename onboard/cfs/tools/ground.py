#!/usr/bin/env python3
"""A small ground station for ELUNAR_APP, over CI_LAB (commands) and TO_LAB (telemetry) of a cFS that runs on a host.

    ground.py watch                                 prints events and housekeeping until it is stopped
    ground.py noop | reset | self-test              sends a command, then prints events for a while
    ground.py scrub BYTES
    ground.py tile IMAGE COARSE OUT [AZIMUTH ELEVATION]     paths aboard (/cf/...); degrees; without them the Sun is unknown
    ground.py trial IMAGE COARSE OUT                good and bad commands, and a tile; one line for each check; fails if one fails
    ground.py decode HEX                            prints the fields of a housekeeping packet

The fields of housekeeping come from default_elunar_app_msgdefs.h, message ids from default_elunar_app_msgids.h, both in ../config: give the
mission's own files by --msgdefs and --msgids. Numbers are those of a little-endian processor (--big-endian: of the other kind).
"""
import argparse
import math
import os
import re
import socket
import struct
import sys
import time

CONFIG = os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "config")
STATES = "DOWN WANTS_MODEL SELF_TEST IDLE TILE READY FAILED CHECK".split()
CODES = {"noop": 0, "reset": 1, "self-test": 2, "tile": 3, "scrub": 4}
TO_LAB_ENABLE = 6
PATH_BYTES = 64
MESSAGE_BYTES = 122  # CFE_MISSION_EVS_MAX_MESSAGE_LENGTH


def fail(what):
    sys.exit(f"ERROR: {what}")


def text_of(path):
    try:
        with open(path, encoding="ascii") as file:
            return file.read()
    except OSError as error:
        fail(f"{path}: {error.strerror}")


def fields(path):
    """Returns names and struct formats of ELUNAR_APP_HkTlm_Payload_t."""
    found = re.search(r"typedef struct \{([^}]*)\} ELUNAR_APP_HkTlm_Payload_t;", text_of(path))
    if not found:
        fail(f"{path}: expected ELUNAR_APP_HkTlm_Payload_t, found none")
    kinds = {"8": "B", "16": "H", "32": "I", "64": "Q"}
    lines = re.findall(r"^ *uint(8|16|32|64) +(\w+)(?:\[(\d+)\])?;", found.group(1), re.M)
    return [(name, kinds[bits] if not length else length + "s") for bits, name, length in lines]


def ids(path):
    found = dict(re.findall(r"^#define ELUNAR_APP_(\w+)_MID +(0x[0-9A-Fa-f]+)", text_of(path), re.M))
    missing = [name for name in ("CMD", "HK_TLM") if name not in found]
    if missing:
        fail(f"{path}: expected ELUNAR_APP_{missing[0]}_MID as a number, found none")
    return {name: int(value, 16) for name, value in found.items()}


def decode(packet, order, layout):
    """Returns housekeeping as a dictionary. The payload is at the end: headers differ between versions of cFE."""
    form = order + "".join(kind for _, kind in layout)
    bytes_ = struct.calcsize(form)
    if not bytes_ + 12 <= len(packet) <= bytes_ + 20:
        fail(f"housekeeping: expected {bytes_} bytes and a header of 12 to 20, found {len(packet)} bytes")
    return dict(zip((name for name, _ in layout), struct.unpack(form, packet[-bytes_:])))


class Ground:
    def __init__(self, options):
        self.order = ">" if options.big_endian else "<"
        self.layout = fields(options.msgdefs)
        self.ids = ids(options.msgids)
        self.options = options
        self.hk = {}
        self.events = []
        self.start = time.time()
        self.out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.inn = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.inn.bind(("0.0.0.0", options.telemetry_port))
        except OSError as error:
            fail(f"port {options.telemetry_port} for telemetry: {error.strerror}")
        self.inn.settimeout(0.2)

    def send(self, mid, code, payload=b""):
        packet = bytearray(struct.pack(">HHHBB", mid, 0xC000, len(payload) + 1, code, 0) + payload)
        check = 0xFF
        for byte in packet:
            check ^= byte
        packet[7] = check
        self.out.sendto(bytes(packet), (self.options.host, self.options.command_port))

    def command(self, name, payload=b""):
        self.send(self.ids["CMD"], CODES[name] if name in CODES else int(name), payload)

    def tile(self, image, coarse, output, azimuth=math.nan, elevation=math.nan):
        paths = b"".join(path.encode().ljust(PATH_BYTES, b"\0") for path in (image, coarse, output))
        numbers = (self.options.pixel_m, self.options.coarse_px, azimuth, elevation)
        self.command("tile", paths + struct.pack(self.order + "4f", *numbers))

    def enable(self):
        self.send(self.options.to_lab_mid, TO_LAB_ENABLE, self.options.telemetry_host.encode().ljust(16, b"\0"))

    def take(self, packet):
        mid = struct.unpack(">H", packet[:2])[0]
        if mid == self.ids["HK_TLM"]:
            self.hk = decode(packet, self.order, self.layout)
            if self.options.command == "watch":
                self.say("HK  " + " ".join(self.shown()))
        elif mid == self.options.evs_mid and len(packet) > 12 + 32 + MESSAGE_BYTES:
            # name of the application, id, type, spacecraft, processor, then the message and two spare bytes
            body = packet[-(32 + MESSAGE_BYTES + 2):]
            name = body[:20].split(b"\0")[0].decode("ascii", "replace")
            number, kind = struct.unpack(self.order + "HH", body[20:24])
            message = body[32:32 + MESSAGE_BYTES].split(b"\0")[0].decode("ascii", "replace")
            if name == "ELUNAR_APP" or self.options.all_events:
                self.events.append((name, number, message))
                self.say(f"EVS {name} {number} type {kind}: {message}")

    def shown(self):
        for name, value in self.hk.items():
            if name == "State":
                yield f"State {STATES[value] if value < len(STATES) else value}"
            elif name == "ModelCrc" or name.startswith("Last"):
                yield f"{name} {value:#010x}"
            elif not isinstance(value, bytes):
                yield f"{name} {value}"

    def say(self, what):
        print(f"{time.time() - self.start:8.2f} {what}", flush=True)

    def listen(self, seconds, until=lambda: False):
        """Takes packets; returns whether the condition came true in time."""
        end = time.time() + seconds
        asked = 0 if not self.hk else math.inf
        while not until() and time.time() < end:
            # TO_LAB may have started after this program.
            if not self.hk and time.time() > asked + 2:
                self.enable()
                asked = time.time()
            try:
                self.take(self.inn.recv(65536))
            except socket.timeout:
                pass
        return until()

    def state(self):
        return STATES[self.hk["State"]] if self.hk.get("State", 99) < len(STATES) else None


def trial(ground, image, coarse, output):
    """Commands that must work and commands that must be refused, each with the event that it must give."""
    failures = []

    def check(what, done):
        ground.say(("ok      " if done else "FAILED  ") + what)
        if not done:
            failures.append(what)

    def gives(what, number, seconds=5):
        at = len(ground.events)
        return check(f"{what}: event {number}",
                     ground.listen(seconds, lambda: any(e[:2] == ("ELUNAR_APP", number) for e in ground.events[at:])))

    sun = (189.488525, 25.614722)
    limit = ground.options.seconds
    check("housekeeping comes", ground.listen(20, lambda: bool(ground.hk)))
    if failures:
        return failures
    check("idle after the self test", ground.listen(limit, lambda: ground.state() == "IDLE"))
    for what, number, code, payload in [
            ("NOOP", 2, "noop", b""), ("NOOP too long", 6, "noop", b"1234"), ("unknown code", 5, "77", b""),
            ("SCRUB of 65537 bytes", 6, "scrub", struct.pack(ground.order + "I", 65537))]:
        ground.command(code, payload)
        gives(what, number)
    ground.tile("/cf/none.f32", coarse, output, *sun)
    gives("no such image", 9)
    ground.tile(image, coarse, output, sun[0], 89.0)
    gives("Sun too high", 16)
    before = dict(ground.hk)
    ground.tile(image, coarse, output, *sun)
    gives("tile", 12)
    ground.command("self-test")
    gives("self test while busy", 15)
    gives("heights", 13, limit)
    check("housekeeping counts the tile",
          ground.listen(10, lambda: ground.hk.get("TilesWritten") == before.get("TilesWritten", 0) + 1))
    ground.tile(image, coarse, output + "2")
    gives("tile without a Sun", 13, limit)
    ground.command("self-test")
    gives("self test", 18, limit)
    check("housekeeping counts commands", ground.listen(10, lambda: ground.hk.get("CommandErrorCounter", 0) >= 6))
    ground.command("reset")
    gives("reset", 3)
    check("counters are 0", ground.listen(10, lambda: ground.hk["CommandCounter"] + ground.hk["CommandErrorCounter"] == 0))
    ground.say("HK  " + " ".join(ground.shown()))
    return failures


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=["watch", "trial", "decode", *CODES])
    parser.add_argument("rest", nargs="*")
    parser.add_argument("--host", default="127.0.0.1", help="where cFS runs")
    parser.add_argument("--telemetry-host", default="127.0.0.1", help="where this program runs, as TO_LAB sees it")
    parser.add_argument("--command-port", type=int, default=1234)
    parser.add_argument("--telemetry-port", type=int, default=1235)
    parser.add_argument("--to-lab-mid", type=lambda text: int(text, 0), default=0x1880)
    parser.add_argument("--evs-mid", type=lambda text: int(text, 0), default=0x0808)
    parser.add_argument("--msgdefs", default=os.path.join(CONFIG, "default_elunar_app_msgdefs.h"))
    parser.add_argument("--msgids", default=os.path.join(CONFIG, "default_elunar_app_msgids.h"))
    parser.add_argument("--pixel-m", type=float, default=2.0, help="ground size of a pixel")
    parser.add_argument("--coarse-px", type=float, default=29.61, help="side of a pixel of the coarse DTM, in pixels of the image")
    parser.add_argument("--big-endian", action="store_true")
    parser.add_argument("--all-events", action="store_true", help="those of other applications, too")
    parser.add_argument("--seconds", type=float, default=150, help="how long a tile or self test may take")
    options = parser.parse_args()
    counts = {"scrub": (1,), "tile": (3, 5), "trial": (3,), "decode": (1,)}.get(options.command, (0,))
    if len(options.rest) not in counts:
        parser.error(f"{options.command}: expected {' or '.join(map(str, counts))} arguments, found {len(options.rest)}")
    numbers = {"scrub": options.rest, "tile": options.rest[3:]}.get(options.command, [])
    try:
        options.numbers = [int(text) if options.command == "scrub" else float(text) for text in numbers]
    except ValueError as error:
        parser.error(f"{options.command}: {error}")
    if options.command == "scrub" and not 0 <= options.numbers[0] < 2**32:
        parser.error(f"scrub: expected 0 to {2**32 - 1} bytes, found {options.numbers[0]}")
    return options


def main():
    options = arguments()
    if options.command == "decode":
        try:
            packet = bytes.fromhex(options.rest[0])
        except ValueError:
            fail("decode: expected hexadecimal digits")
        for name, value in decode(packet, ">" if options.big_endian else "<", fields(options.msgdefs)).items():
            print(name, value if isinstance(value, int) else value.hex())
        return
    ground = Ground(options)
    if options.command == "trial":
        failures = trial(ground, *options.rest)
        sys.exit(f"ERROR: {len(failures)} checks failed" if failures else 0)
    try:
        if options.command != "watch":
            ground.listen(10, lambda: bool(ground.hk))
        if options.command == "scrub":
            ground.command("scrub", struct.pack(ground.order + "I", *options.numbers))
        elif options.command == "tile":
            ground.tile(*options.rest[:3], *options.numbers)
        elif options.command != "watch":
            ground.command(options.command)
        ground.listen(math.inf if options.command == "watch" else 5)
    except KeyboardInterrupt:
        pass
    if ground.hk:
        ground.say("HK  " + " ".join(ground.shown()))
    else:
        fail(f"no housekeeping on port {options.telemetry_port}: is cFS running, and does TO_LAB send {ground.ids['HK_TLM']:#06x}?")


if __name__ == "__main__":
    main()
