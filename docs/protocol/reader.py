#!/usr/bin/env python3
"""Reads a recorded Lodestream session. Written from docs/protocol.md and docs/formats.md alone.

    python3 docs/protocol/reader.py RECORDING.json            prints messages and blobs as JSON
    python3 docs/protocol/reader.py RECORDING.json --dump     prints the bytes with their meaning

A recording is JSON. Over QUIC: {"transport": "quic", "streams": [{"from": "server", "number": 3, "bytes": HEX}]}, one
entry per stream; over WebSocket: {"transport": "websocket", "from_client": HEX, "from_server": HEX}, all bytes of the
TCP connection. Only Python's standard library is needed. Anything that contradicts the page ends the program.
"""

import base64
import hashlib
import json
import math
import struct
import sys

CLIENT_TAGS = {1: "Hello", 2: "Want", 3: "Cancel", 0x84: "SetView", 5: "WantScenePages", 6: "Ping", 7: "Bye",
               0x88: "Token"}
SERVER_TAGS = {0x41: "Welcome", 0x42: "ScenePage", 0x43: "Refused", 0xC4: "BasesSent", 0xC5: "Done",
               0x46: "Pong", 0x47: "Close", 0x48: "Piece", 0x49: "RefusedMany", 0xCA: "PunctualLights",
               0xCB: "Parts", 0xCC: "Animations"}
REFUSED = ["NotFound", "Unreadable", "QueueFull", "TooLong", "OutOfRange"]
CLOSE_CODES = ["Normal", "ShuttingDown", "Version", "NoSuchScene", "Protocol", "Limit", "Timeout", "Busy", "Lost",
               "Unauthorised"]
STAMPS = ["ridge", "valley", "crater", "plateau", "river bed"]
# Kinds of blobs that are no part of an asset.
SCENE_BLOBS = {4: "terrain_directory_page", 5: "height_overrides", 6: "punctual_light_directory_page",
               7: "punctual_light_page", 8: "part_directory_page", 9: "part_page", 12: "animation"}
MAX_BODY, MAX_PIECE, MAX_BLOB = 65536, 16384, 1 << 26
ZSTD = bytes.fromhex("28b52ffd")


class Broken(Exception):
    """What was read contradicts the page."""


def ensure(holds, why):
    if not holds:
        raise Broken(why)


class Bytes:
    """A cursor over bytes that records where each field is."""

    def __init__(self, data, at=0, end=None, notes=None):
        self.data, self.at = data, at
        self.end = len(data) if end is None else end
        self.notes = [] if notes is None else notes

    def take(self, count):
        ensure(self.at + count <= self.end, f"the bytes end early, at {self.at} of {self.end}")
        taken = self.data[self.at:self.at + count]
        self.at += count
        return taken

    def left(self):
        return self.end - self.at

    def part(self, count):
        """A cursor over the next `count` bytes, which this one skips."""
        part = Bytes(self.data, self.at, self.at + count, self.notes)
        self.take(count)
        return part

    def finish(self, what):
        ensure(self.left() == 0, f"{self.left()} bytes are left over behind {what}")

    def note(self, name, read, show=None):
        """Reads with `read` and records the bytes under a name."""
        start = self.at
        value = read()
        self.notes.append((start, self.at, f"{name}: {show(value) if show else value}" if name else show(value)))
        return value

    # Values of messages.
    def u8(self):
        return self.take(1)[0]

    def fixed(self, count):
        return int.from_bytes(self.take(count), "little")

    def integer(self, width):
        first = self.u8()
        if first <= 250:
            return first
        count, least = {251: (2, 251), 252: (4, 1 << 16), 253: (8, 1 << 32)}.get(first, (9, 0))
        ensure(count <= width, f"an integer of {width} bytes begins with {first}")
        value = self.fixed(count)
        ensure(value >= least, f"{value} takes {count} bytes")
        return value

    def u16(self):
        return self.integer(2)

    def u32(self):
        return self.integer(4)

    def u64(self):
        return self.integer(8)

    def i32(self):
        return unzigzag(self.u32())

    def f32(self):
        return struct.unpack("<f", self.take(4))[0]

    def f64(self):
        return struct.unpack("<d", self.take(8))[0]

    def flag(self):
        value = self.u8()
        ensure(value <= 1, f"a bool or option of {value}")
        return value == 1

    def text(self):
        return self.take(self.u64()).decode("utf-8")

    def leb128(self):
        value = shift = 0
        while True:
            byte = self.u8()
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value


def unzigzag(code):
    return code >> 1 ^ -(code & 1)


def nearest(number):
    """The nearest integer, halves away from zero; 0 beyond 2^53."""
    if not abs(number) <= 1 << 53:
        return 0
    whole = math.floor(abs(number))
    return int(math.copysign(whole + (abs(number) - whole >= 0.5), number))


def unfolded(u, v):
    """A unit vector from its octahedral coordinates."""
    x, y = u / 32767.5 - 1, v / 32767.5 - 1
    z = 1 - abs(x) - abs(y)
    if z < 0:
        x, y = (1 - abs(y)) * (-1 if x < 0 else 1), (1 - abs(x)) * (-1 if y < 0 else 1)
    length = math.sqrt(x * x + y * y + z * z)
    return list(struct.unpack("<3f", struct.pack("<3f", x / length, y / length, z / length)))


def floats(read, count):
    return lambda: [read() for _ in range(count)]


def rounded(value):
    if isinstance(value, list):
        return ", ".join(rounded(x) for x in value)
    return f"{value:.6g}"


class Reader:
    """Reads fields of messages and records each; `b` is the cursor."""

    def __init__(self, cursor):
        self.b = cursor

    def f(self, name, read, show=None):
        return self.b.note(name, read, show)

    def numbers(self, name, read, count):
        return self.f(name, floats(read, count), rounded)

    def number(self, name, read):
        return self.f(name, read, rounded)

    def fingerprint(self, name="fingerprint"):
        return self.f(name, lambda: self.b.take(16).hex(), lambda _: "16 bytes")

    def option(self, name, read):
        there = self.f(name, self.b.flag, lambda there: "there" if there else "none")
        return read() if there else None

    def vec(self, name, read, most):
        count = self.f(name, self.b.u64, lambda n: f"{n} of them")
        ensure(count <= most, f"{count} {name}, at most {most}")
        return [read() for _ in range(count)]

    # Blob ids.
    def blob_id(self, name="id"):
        return self.f(name, self.read_id, show_id)

    def read_id(self):
        number, kind = self.b.u32(), self.b.u32()
        if kind in SCENE_BLOBS:
            return {SCENE_BLOBS[kind]: number}
        blob = {"asset": number}
        if kind == 0:
            blob["base"] = True
        elif kind == 1:
            blob["page"] = self.b.u32()
        elif kind == 2:
            blob["chunk"] = self.b.u32()
        elif kind == 3:
            blob["texture"], blob["level"] = self.b.u16(), self.b.u8()
        elif kind == 10:
            blob["texture_regions"] = True
        elif kind == 11:
            blob["texture"], blob["level"], blob["tile"] = self.b.u16(), self.b.u8(), self.b.u16()
        else:
            raise Broken(f"a blob id of kind {kind}")
        return blob

    # From the client.
    def hello(self):
        return {
            "version_min": self.f("version_min", self.b.u16),
            "version_max": self.f("version_max", self.b.u16),
            "scene": self.f("scene", self.b.text, repr),
            "view": self.option("view", self.view),
            "max_blob_bytes": self.f("max_blob_bytes", self.b.u32),
            "budget_bytes": self.f("budget_bytes", self.b.u64),
            "fingerprint": self.fingerprint(),
            "have": self.vec("have", self.blob_id, 4096),
        }

    def view(self):
        return {
            "eye": self.numbers("eye", self.b.f64, 3),
            "rotation": self.numbers("rotation", self.b.f32, 4),
            "fov_y": self.number("fov_y", self.b.f32),
            "viewport_px": self.f("viewport_px", floats(self.b.u32, 2)),
            "target_px": self.number("target_px", self.b.f32),
        }

    def token(self):
        token = self.f("token", self.b.text, lambda text: f"{len(text)} characters")
        ensure(len(token.encode()) <= 8192, "a token that is too long")
        return token

    def want(self):
        return {
            "id": self.blob_id(),
            "priority": self.f("priority", self.b.u32),
            "offset": self.f("offset", self.b.u32),
            "end": self.option("end", lambda: self.f("end", self.b.u32)),
        }

    # From the server.
    def welcome(self):
        return {
            "version": self.f("version", self.b.u16),
            "session": self.f("session", self.b.u64),
            "rate_bits_per_s": self.f("rate_bits_per_s", self.b.u64),
            "idle_timeout_ms": self.f("idle_timeout_ms", self.b.u32),
            "scene": self.header(),
        }

    def header(self):
        return {
            "name": self.f("name", self.b.text, repr),
            "fingerprint": self.fingerprint(),
            "asset_count": self.f("asset_count", self.b.u32),
            "instance_count": self.f("instance_count", self.b.u32),
            "page_count": self.f("page_count", self.b.u32),
            "light": {
                "direction": self.numbers("light.direction", self.b.f32, 3),
                "color": self.numbers("light.color", self.b.f32, 3),
                "ambient": self.numbers("light.ambient", self.b.f32, 3),
            },
            "background": self.numbers("background", self.b.f32, 3),
            "terrain": self.option("terrain", self.terrain),
            "camera": {
                "eye": self.numbers("camera.eye", self.b.f64, 3),
                "target": self.numbers("camera.target", self.b.f64, 3),
                "up": self.numbers("camera.up", self.b.f32, 3),
                "fov_y": self.number("camera.fov_y", self.b.f32),
            },
            "root_slope": self.f("root_slope", self.b.f32),
        }

    def terrain(self):
        b = self.b
        seed = self.f("seed", lambda: b.fixed(8))
        levels = self.f("n, erosion level", b.u8)
        extent = self.f("e, distribution", b.u8)
        ensure(extent >> 6 == 0, "unknown flags of a terrain")
        entry = {
            "seed": seed,
            "finest_level": levels & 15,
            "erosion_level": levels >> 4,
            "extent_log2": extent & 31,
            "gaussian": extent >> 5 == 1,
            "amplitude": self.f("amplitude", lambda: b.fixed(4)),
            "roughness": self.f("roughness", lambda: b.fixed(2)),
            "base": self.f("base", lambda: struct.unpack("<i", b.take(4))[0]),
            "passes": self.f("passes", b.u8),
            "talus": self.f("talus", lambda: b.fixed(2)),
            "spike_limit": self.f("spike limit", b.u8),
            "unit": self.number("unit", b.f32),
            "height_unit": self.number("height_unit", b.f32),
            "zones": self.numbers("zones", b.f32, 3),
        }
        length = self.f("stamps", b.u64, lambda n: f"{n} bytes")
        entry["stamps"] = Reader(b.part(length)).stamps() if length else []
        patches = self.f("patches, water", b.u32)
        entry["patches"] = patches & 0x7FFFFFFF
        if patches >> 31:
            entry["water"] = {
                "level": self.number("water.level", b.f32),
                "clarity": self.number("water.clarity", b.f32),
            }
        return entry

    def stamps(self):
        stamps = [self.stamp() for _ in range(self.f("stamps", self.b.leb128))]
        self.b.finish("the stamps")
        return stamps

    def stamp(self):
        b = self.b
        head = self.f("stamp", b.u8)
        kind = head & ~8
        ensure(kind < len(STAMPS), f"a stamp of kind {kind}")
        count = self.f("positions", b.leb128) if kind == 4 else 2 if kind < 2 else 1
        line, last = [], [0, 0]
        for _ in range(count):
            last = self.f("position", lambda: [x + unzigzag(b.leb128()) for x in last])
            line.append(last)
        stamp = {"kind": STAMPS[kind], "fixed": head & 8 != 0, "line": line}
        stamp["length"] = self.f("length", b.leb128)
        stamp["height"] = self.f("height", lambda: unzigzag(b.leb128()))
        if kind == 2:
            stamp["rim"] = self.f("rim", lambda: unzigzag(b.leb128()))
        if kind == 3:
            stamp["falloff"] = self.f("falloff", b.leb128)
        return stamp

    def page(self):
        return {
            "page": self.f("page", self.b.u32),
            "first_asset": self.f("first_asset", self.b.u32),
            "first_instance": self.f("first_instance", self.b.u32),
            "assets": self.vec("assets", self.asset, 64),
            "instances": self.instances(64),
            "first_proxy": self.f("first_proxy", self.b.u32),
            "proxies": self.vec("proxies", self.proxy, 64),
        }

    def proxy(self):
        found = {
            "asset": self.f("asset", self.b.u32),
            "parent": self.f("parent", self.b.u32),
            "first_instance": self.f("first_instance", self.b.u32),
            "instance_count": self.f("instance_count", self.b.u32),
            "child_count": self.f("child_count", self.b.u32),
            "error": self.number("error", self.b.f32),
        }
        ensure(found["instance_count"] > 0 and found["error"] >= 0, "a proxy for nothing, or its error is below 0")
        return found

    def asset(self):
        flags = self.f("flags", self.b.u8)
        ensure(flags < 4, f"unknown flags of an asset: {flags}")
        short = flags & 1
        found = {
            "name": self.f("name", self.b.text, repr),
            "fingerprint": self.fingerprint(),
            "origin": self.numbers("origin", self.b.f32 if short else self.b.f64, 3),
            "center": self.numbers("sphere's centre", self.b.f32, 3),
            "radius": self.number("its radius", self.b.f32),
            "root_error": self.number("root_error", self.b.f32),
            "base_bytes": self.f("base_bytes", self.b.u32),
            "chunk_count": self.f("chunk_count", self.b.u32),
        }
        if flags & 2:
            count = self.f("shared", self.b.u8)
            ensure(1 <= count <= 32, f"{count} shared textures")
            found["shared"] = [self.shared_texture() for _ in range(count)]
        return found

    def shared_texture(self):
        return {
            "texture": self.f("texture", self.b.u16),
            "asset": self.f("asset", self.b.u32),
            "of": self.f("of", self.b.u16),
        }

    def instances(self, most):
        before = {"asset": 0, "translation": [0.0] * 3, "rotation": [0.0, 0.0, 0.0, 1.0], "scale": 1.0}
        found, exponent = [], 0
        count = self.f("instances", self.b.u64)
        ensure(count <= most, f"{count} instances")
        for _ in range(count):
            flags = self.f("flags", self.b.u8)
            ensure(flags < 64, f"unknown flags of an instance: {flags}")
            before = dict(before)
            if flags & 4:
                before["asset"] = self.f("asset", self.b.u32)
            form = flags & 3
            if form >= 2:
                before["translation"] = self.numbers("translation", self.b.f64 if form == 3 else self.b.f32, 3)
            else:
                if form == 1:
                    exponent = self.f("exponent", lambda: (self.b.u8() ^ 128) - 128)
                steps = [nearest(x * 2.0**-exponent) for x in before["translation"]]
                steps = [from_ + self.f("steps", lambda: unzigzag(self.b.leb128())) for from_ in steps]
                ensure(all(abs(number) <= 1 << 53 for number in steps), "a translation of too many steps")
                before["translation"] = [number * 2.0**exponent for number in steps]
            turn = flags >> 3 & 3
            if turn == 1:
                before["rotation"] = [0.0, 0.0, 0.0, 1.0]
            elif turn == 2:
                y, w = self.numbers("rotation about y", self.b.f32, 2)
                before["rotation"] = [0.0, y, 0.0, w]
            elif turn == 3:
                before["rotation"] = self.numbers("rotation", self.b.f32, 4)
            if flags & 32:
                before["scale"] = self.number("scale", self.b.f32)
            found.append(before)
        return found

    def named(self, name, names):
        def read():
            number = self.b.u32()
            ensure(number < len(names), f"a {name} of {number}")
            return names[number]
        return self.f(name, read)

    # Blobs.
    def base(self):
        b = self.b
        version = self.f("version", b.u8)
        ensure(version == 5, f"a base mesh of format version {version}")
        bits = self.f("position bits", b.u8)
        kinds = self.f("kinds", b.u8)
        levels = self.f("level_count", b.u8)
        shifts = self.f("shifts", lambda: list(b.take(1 + (levels + 1) // 2)))
        origin = self.numbers("origin", b.f64, 3)
        step = self.number("step", b.f64)
        uv_bits = [kinds & 31]
        if uv_bits == [31]:
            uv_bits = self.f("uv bits", lambda: list(b.take(2)))
            ensure(uv_bits[1] > 0, "two sets of texture coordinates, the second without bits")
        ensure(max(uv_bits) <= 16, f"texture coordinates of {uv_bits} bits")
        for _ in filter(None, uv_bits):
            self.numbers("uv origin", b.f64, 2)
            self.numbers("uv step", b.f64, 2)
        falls = [shifts[1 + k // 2] >> 4 * (k % 2) & 15 for k in range(levels)]
        base = {
            "position_bits": bits & 31,
            "codec": {0: "range", 128: "zstd", 192: "axis-aligned"}[bits & 192],
            "uv_bits": uv_bits[0],
            "colors": kinds & 64 != 0,
            "normals": kinds & 128 != 0,
            "level_count": levels,
            "shifts": [(shifts[0] >> 4) - sum(falls[:k]) for k in range(levels + 1)],
            "origin": origin,
            "step": step,
            "center": self.numbers("sphere's centre", b.f32, 3),
            "radius": self.number("its radius", b.f32),
            "diagonal": self.number("diagonal", b.f32),
            "geometric_error": self.number("geometric_error", b.f32),
            "chunk_count": self.f("chunk_count", b.leb128),
            "material_count": self.f("material_count", b.leb128),
            "part_count": self.f("part_count", b.leb128) if kinds & 32 else 1,
            "vertices": self.f("vertices", b.leb128),
            "wedges": self.f("wedges", b.leb128),
            "faces": self.f("faces", b.leb128),
        }
        length = self.f("description", b.leb128, lambda n: f"{n} bytes")
        base["description"] = Reader(b.part(length)).description()
        self.f("mesh", lambda: b.take(b.left()), lambda mesh: f"{len(mesh)} bytes, range-coded")
        return base

    def description(self):
        description = {
            "name": self.f("name", self.b.text, repr),
            "materials": self.vec("materials", self.material, 4096),
            "textures": self.vec("textures", self.texture, 4096),
        }
        self.b.finish("the description")
        return description

    def material(self):
        b = self.b
        flags = self.f("flags", b.u8)
        material = {
            "name": self.f("name", b.text, repr),
            "base_color": self.f("base_color", lambda: [b.fixed(2) for _ in range(4)]),
            "roughness": self.f("roughness", b.u8),
        }
        if flags & 1:
            material["base_color_texture"] = self.f("base_color_texture", b.u16)
        if flags & 2:
            material["height_texture"] = self.f("height_texture", b.u16)
            material["relief_depth"] = self.number("relief_depth", b.f32)
        if flags & 4:
            material["metallic"] = self.f("metallic", b.u8)
        if flags & 8:
            material["emission"] = [self.number("emission", b.f32) for _ in range(3)]
        if flags & 16:
            material["surface_texture"] = self.f("surface_texture", b.u16)
        if flags & 32:
            material["normal_texture"] = self.f("normal_texture", b.u16)
            material["normal_scale"] = self.number("normal_scale", b.f32)
        if flags & 64:
            material["emission_texture"] = self.f("emission_texture", b.u16)
        if flags & 128:
            second = self.f("second", b.u8)
            alpha, u, v = second & 3, second >> 3 & 3, second >> 5 & 3
            third = self.f("third", b.u8) if alpha == 3 else alpha
            ensure(third & 3 < 3 and third < 64 and u < 3 and v < 3, f"unknown flags of a material: {second}, {third}")
            alpha = third & 3
            wraps = ["repeat", "clamp", "mirror"]
            material["alpha"] = ["opaque", "mask", "blend"][alpha]
            material["unlit"] = bool(second & 4)
            material["flat"] = bool(second & 128)
            material["wrap"] = [wraps[u], wraps[v]]
            if alpha == 1:
                material["cutoff"] = self.f("cutoff", b.u8)
            if third & 4:
                material["specular"] = self.f("specular", lambda: [b.u8() for _ in range(4)])
            if third & 8:
                material["clear_coat"] = self.f("clear_coat", lambda: [b.u8() for _ in range(2)])
            if third & 16:
                material["transmission"] = self.f("transmission", b.u8)
            if third & 32:
                second_uv = self.f("second_uv", b.u8)
                ensure(0 < second_uv < 32, f"unknown flags of a material: {second_uv}")
                material["second_uv"] = second_uv & 15
                if second_uv & 16:
                    material["occlusion_texture"] = self.f("occlusion_texture", b.u16)
        return material

    def texture(self):
        def level():
            return {
                "width": self.f("width", self.b.u32),
                "height": self.f("height", self.b.u32),
                "bytes": self.f("bytes", self.b.u32),
                "format": self.named("format", ["jpeg", "png", "webp"]),
            }
        return {
            "kind": self.named("kind", ["color", "height", "normal", "surface"]),
            "width": self.f("width", self.b.u32),
            "height": self.f("height", self.b.u32),
            "planes": self.f("planes", self.b.u8),
            "mean": self.option("mean", lambda: self.f("sRGB", lambda: list(self.b.take(3)))),
            "uv_per_unit": self.number("uv_per_unit", self.b.f32),
            "levels": self.vec("levels", level, 16),
        }

    def refused(self):
        return {"id": self.blob_id(), "reason": self.named("reason", REFUSED)}

    def patch(self):
        return self.f("patch", lambda: [self.b.i32(), self.b.i32(), self.b.u32(), self.b.u32()])

    def directory(self):
        patches = self.vec("patches", self.patch, 1024)
        self.b.finish("the directory")
        return patches

    # Punctual lights.
    def punctual_lights(self):
        count = self.f("count", self.b.u32)
        ensure(1 <= count <= 1 << 18, f"{count} punctual_lights")
        first = self.b.part(self.f("first", self.b.u64, lambda n: f"{n} bytes"))
        if count <= 16:
            held = Reader(first).punctual_light_page()
            ensure(len(held) == count, f"{len(held)} punctual_lights of {count}")
        elif count <= 1024:
            held = Reader(first).punctual_light_directory()
            ensure(len(held) == (count + 63) // 64, f"{len(held)} pages of {count} punctual_lights")
        else:
            held = None
        first.finish("what is said of punctual_lights")
        return {"count": count, "first": held}

    def punctual_light_directory(self):
        def listed():
            return {
                "center": self.numbers("center", self.b.f32, 3),
                "radius": self.number("radius", self.b.f32),
                "intensity": self.number("intensity", self.b.f32),
                "bytes": self.f("bytes", self.b.u32),
            }
        pages = self.vec("pages", listed, 256)
        self.b.finish("the directory of punctual_lights")
        return pages

    def punctual_light_page(self):
        b = self.b
        version = self.f("version", b.u8)
        ensure(version == 1, f"a page of punctual_lights of format version {version}")
        exponent = self.f("exponent", lambda: struct.unpack("<b", b.take(1))[0])
        origin = self.numbers("origin", b.f64, 3)
        at, light, reach, cone, punctual_lights = [0, 0, 0], None, None, None, []
        for _ in range(self.f("count", b.u8, lambda n: f"{n} of them")):
            flags = self.f("flags", b.u8)
            ensure(flags < 16 and flags & 9 != 8, f"unknown flags of a punctual_light: {flags}")
            at = self.f("steps", lambda: [x + unzigzag(b.leb128()) for x in at])
            if not flags & 2:
                light = self.f("colour", lambda: list(b.take(3))), self.number("brightest", self.half)
            if not flags & 4:
                reach = self.number("range", self.half)
            if flags & 1 and not flags & 8:
                direction = self.f("direction", lambda: [b.fixed(2), b.fixed(2)])
                cone = direction, self.f("inner, outer", lambda: [b.fixed(2), b.fixed(2)])
            ensure(light and 255 in light[0] and reach, "a punctual_light that is like one before it, which there is not")
            punctual_light = {"position": [origin[i] + at[i] * 2.0 ** exponent for i in range(3)], "colour": light[0]}
            punctual_light["brightest"], punctual_light["range"] = light[1], reach
            if flags & 1:
                ensure(cone and cone[1][0] <= cone[1][1] > 0, "a cone that is none")
                punctual_light["direction"], punctual_light["angles"] = unfolded(*cone[0]), cone[1]
            punctual_lights.append(punctual_light)
        self.b.finish("the punctual_lights")
        return punctual_lights

    # What parts are called.
    def parts(self):
        count = self.f("records", self.b.u32)
        ensure(1 <= count <= 1 << 24, f"{count} records of parts")
        return count

    def part_directory(self):
        def run():
            return [self.f(name, self.b.u32) for name in ("instances", "parts", "first")]
        runs = self.vec("runs", run, 1024)
        ensure(all(instances and parts for instances, parts, _ in runs), "an instance without parts")
        self.b.finish("the directory of parts")
        return runs

    def part_page(self):
        version = self.f("version", self.b.u8)
        ensure(version in (1, 2), f"a page of parts of format version {version}")
        places = [[place[name] for name in ("translation", "rotation", "scale")] for place in self.instances(256)] if version == 2 else []
        records, before = [], [b"", b"", b""]
        while self.b.left():
            before = [self.f(name, lambda: self.continued(text, most)) for name, text, most in
                      zip(("name", "path", "extras"), before, (255, 1024, 4096))]
            place = places[len(records)] if len(records) < len(places) else [[0.0] * 3, [0.0, 0.0, 0.0, 1.0], 1.0]
            records.append([text.decode("utf-8") for text in before] + place)
        ensure(1 <= len(records) <= 256, f"{len(records)} records on a page")
        ensure(len(places) in (0, len(records)), f"{len(places)} placements of {len(records)} records")
        return records

    def continued(self, before, most):
        shared, rest = self.b.u32(), self.b.u32()
        ensure(shared <= len(before) and shared + rest <= most, "a text that does not continue the one before it")
        return bytes(before[:shared]) + bytes(self.b.take(rest))

    # Animated models.
    def animations(self):
        count = self.f("models", self.b.u32)
        ensure(1 <= count <= 1 << 12, f"{count} animated models")
        return count

    def animation(self):
        b = self.b
        version = self.f("version", b.u8)
        ensure(version == 2, f"an animated model of format version {version}")
        whole = [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]
        def node():
            parent = self.option("parent", lambda: self.f("node", b.u32))
            return [parent, self.formed("to the parent", whole), self.formed("translation", [0, 0, 0]),
                    self.formed("rotation", [0, 0, 0, 1]), self.formed("scale", [1, 1, 1])]
        def part():
            return [self.f("node", b.u32), self.formed("to the node", whole), self.formed("from the model", whole)]
        def joint():
            return [self.option("node", lambda: self.f("node", b.u32)), self.formed("to the node", whole)]
        def values(name):
            return self.f(name, lambda: [b.f32() for _ in range(b.u64())], lambda n: f"{len(n)} numbers")
        def channel():
            return [self.f("node", b.u32), self.named("property", ["translation", "rotation", "scale"]),
                    self.named("interpolation", ["linear", "step", "cubicspline"]), self.f("timeline", b.u32),
                    values("values")]
        def clip():
            return [self.f("name", b.text, repr), self.vec("channels", channel, 1 << 16)]
        model = {"nodes": self.vec("nodes", node, 1 << 16), "parts": self.vec("parts", part, 1 << 16)}
        instances = lambda: self.vec("instances", lambda: self.f("instance", b.u32), 1 << 16)
        model["skins"] = self.vec("skins", lambda: self.vec("joints", joint, 256), 1 << 16)
        model["places"] = self.vec("places", instances, 1 << 16)
        model["timelines"] = self.vec("timelines", lambda: values("times"), 1 << 16)
        model["clips"] = self.vec("clips", clip, 1 << 10)
        b.finish("the animated model")
        return model

    def formed(self, name, usual):
        """Numbers that are as usual, in f32, or in f64."""
        form = self.f("form", self.b.u8)
        ensure(form <= 2, f"numbers of form {form}")
        read = self.b.f32 if form == 1 else self.b.f64
        return self.numbers(name, read, len(usual)) if form else [float(number) for number in usual]

    def half(self):
        """Bits 30 to 15 of an f32."""
        return struct.unpack("<f", struct.pack("<I", self.b.fixed(2) << 15))[0]


def show_id(blob):
    if blob.get("base"):
        return f"base mesh of asset {blob['asset']}"
    parts = " ".join(f"{key} {value}" for key, value in blob.items() if key != "asset")
    return f"{parts} of asset {blob['asset']}" if "asset" in blob else parts.replace("_", " ")


def read_body(name, r):
    """The body of a message other than Piece."""
    b = r.b
    read = {
        "Hello": r.hello,
        "Want": lambda: r.vec("requests", r.want, 1024),
        "Cancel": lambda: r.vec("ids", r.blob_id, 1024),
        "SetView": r.view,
        "WantScenePages": lambda: r.vec("pages", lambda: r.f("page", b.u32), 256),
        "Ping": lambda: r.f("number", b.u32),
        "Bye": lambda: None,
        "Token": r.token,
        "Welcome": r.welcome,
        "ScenePage": r.page,
        "Refused": r.refused,
        "RefusedMany": lambda: r.vec("refusals", r.refused, 1024),
        "PunctualLights": r.punctual_lights,
        "Parts": r.parts,
        "Animations": r.animations,
        "BasesSent": lambda: None,
        "Done": lambda: None,
        "Pong": lambda: r.f("number", b.u32),
        "Close": lambda: {"code": r.named("code", CLOSE_CODES), "reason": r.f("reason", b.text, repr)},
    }
    return read[name]()


def read_length(b):
    """A variable-length integer of QUIC."""
    first = b.u8()
    rest = b.take((1 << (first >> 6)) - 1)
    return int.from_bytes(bytes([first & 63]) + rest, "big")


def read_frame(b, tags):
    """A frame as (name, value), or None for one to skip."""
    tag = b.note("tag", b.u8, lambda tag: tags.get(tag, "unknown"))
    length = b.note("length", lambda: read_length(b))
    ensure(length <= MAX_BODY, f"a message of {length} bytes")
    body = b.part(length)
    if tag not in tags:
        ensure(tag & 0x80, f"unknown message {tag:#04x}")
        return None
    r = Reader(body)
    if tags[tag] == "Piece":
        head = body.part(body.note("head", body.u8, lambda n: f"{n} bytes"))
        h = Reader(head)
        piece = {"id": h.blob_id(), "offset": h.f("offset", head.u32), "total": h.f("total", head.u32)}
        piece["end"] = piece["total"] - h.f("behind", head.u32)
        head.finish("the head of a piece")
        piece["bytes"] = body.note("piece", lambda: body.take(body.left()), lambda taken: f"{len(taken)} bytes")
        count = len(piece["bytes"])
        ensure(piece["total"] <= MAX_BLOB and piece["end"] <= piece["total"], "a blob that is too long")
        ensure(count <= MAX_PIECE and (count or piece["total"] == 0), "an empty piece, or one too long")
        ensure(piece["offset"] + count <= piece["end"], "a piece beyond its run")
        return "Piece", piece
    value = read_body(tags[tag], r)
    body.finish(tags[tag])
    return tags[tag], value


class Session:
    """The messages of both sides, and the blobs."""

    def __init__(self):
        self.said = {"client": [], "server": []}
        self.blobs = []
        self.runs = {}

    def frames(self, side, b):
        tags = CLIENT_TAGS if side == "client" else SERVER_TAGS
        while b.left():
            self.frame(side, read_frame(b, tags))

    def page(self, b):
        """A page's stream, after its first byte."""
        frame = read_frame(b, SERVER_TAGS)
        ensure(frame is not None and frame[0] == "ScenePage" and not b.left(), "a page stream of something else")
        self.frame("server", frame)

    def frame(self, side, frame):
        if frame is None:
            return
        name, value = frame
        first = {"client": "Hello", "server": "Welcome"}[side]
        earlier = [name for name, _ in self.said[side] if name != "Token"]
        ensure((name == first) != bool(earlier) or name in ("Close", "Ping", "Bye", "Token"), f"{name} behind {earlier}")
        if name == "Piece":
            self.piece(value)
        else:
            self.said[side].append([name, value])

    def piece(self, piece):
        key = json.dumps(piece["id"])
        run = self.runs.setdefault(key, {**piece, "bytes": b""})
        ensure(run["offset"] + len(run["bytes"]) == piece["offset"], f"a gap in {show_id(piece['id'])}")
        ensure((run["end"], run["total"]) == (piece["end"], piece["total"]), "a run that changes its end")
        run["bytes"] += piece["bytes"]
        if run["offset"] + len(run["bytes"]) == run["end"]:
            self.run(self.runs.pop(key), None)

    def stream(self, b):
        """A blob's stream, after its first byte."""
        length = b.note("head", b.u8, lambda n: f"{n} bytes")
        ensure(length <= 26, f"a head of {length} bytes")
        head = b.part(length)
        h = Reader(head)
        run = {"id": h.blob_id(), "total": h.f("total", head.u32), "offset": h.f("offset", head.u32)}
        run["end"] = run["total"] - h.f("behind", head.u32)
        head.finish("the head of a stream")
        ensure(run["total"] <= MAX_BLOB, "a blob that is too long")
        ensure(run["offset"] < run["end"] or run["total"] == 0, "an empty run")
        ensure(b.left() == run["end"] - run["offset"], f"{b.left()} bytes in a run to {run['end']}")
        run["bytes"] = b.data[b.at:b.end]
        self.run(run, b)

    def run(self, run, cursor):
        data = run.pop("bytes")
        run["bytes"] = data.hex()
        whole = run["offset"] == 0 and run["end"] == run["total"]
        b = cursor or Bytes(data)
        if whole and run["id"].get("base") and not data.startswith(ZSTD):
            run["contents"] = Reader(b).base()
        elif whole and "terrain_directory_page" in run["id"]:
            run["contents"] = Reader(b).directory()
        elif whole and "punctual_light_directory_page" in run["id"]:
            run["contents"] = Reader(b).punctual_light_directory()
        elif whole and "punctual_light_page" in run["id"]:
            run["contents"] = Reader(b).punctual_light_page()
        elif whole and "part_directory_page" in run["id"]:
            run["contents"] = Reader(b).part_directory()
        elif whole and "part_page" in run["id"]:
            run["contents"] = Reader(b).part_page()
        elif whole and "animation" in run["id"]:
            run["contents"] = Reader(b).animation()
        elif b.left():
            b.note("blob", lambda: b.take(b.left()), lambda taken: f"{len(taken)} bytes")
        self.blobs.append(run)

    def outcome(self):
        ensure(not self.runs, "a run that does not end")
        return {"client": self.said["client"], "server": self.said["server"], "blobs": self.blobs}


def read_quic(recording):
    """Returns the session, and for each stream its title, bytes and notes."""
    session, parts = Session(), []
    for stream in recording["streams"]:
        b = Bytes(bytes.fromhex(stream["bytes"]))
        side = stream["from"]
        kind = b.note("kind", b.u8, lambda kind: {0: "control", 1: "blob", 2: "page"}.get(kind, "unknown"))
        ensure(kind == 0 or (kind in (1, 2) and side == "server"), f"a stream of kind {kind} from the {side}")
        if kind == 0:
            session.frames(side, b)
        elif kind == 1:
            session.stream(b)
        else:
            session.page(b)
        parts.append((f"stream {stream['number']}, from the {side}", b.data, b.notes))
    return session, parts


def read_websocket(recording):
    """The same over WebSocket, with notes for the frames in its messages."""
    session, parts = Session(), []
    heads = {}
    for side in ("client", "server"):
        data = bytes.fromhex(recording[f"from_{side}"])
        head, _, rest = data.partition(b"\r\n\r\n")
        heads[side] = head.decode("ascii").split("\r\n")
        for message in websocket_messages(rest, masked=side == "client"):
            b = Bytes(message)
            session.frame(side, read_frame(b, CLIENT_TAGS if side == "client" else SERVER_TAGS))
            b.finish("a frame")
            parts.append((f"message from the {side}", message, b.notes))
    check_upgrade(heads["client"], heads["server"])
    return session, parts


def fields(head):
    return {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in head[1:])}


def check_upgrade(request, answer):
    asked, answered = fields(request), fields(answer)
    ensure(request[0].split()[0] == "GET" and asked["sec-websocket-version"] == "13", "no upgrade asked for")
    ensure(answer[0].split()[1] == "101", f"the server answers {answer[0]}")
    magic = asked["sec-websocket-key"] + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
    key = base64.b64encode(hashlib.sha1(magic.encode()).digest()).decode()
    ensure(answered["sec-websocket-accept"] == key, "the upgrade's key is wrong")
    ensure(answered.get("sec-websocket-protocol", "lodestream.2") == "lodestream.2", "another subprotocol")


def websocket_messages(data, masked):
    """Binary messages of a WebSocket's bytes (RFC 6455 §5.2), up to a close frame."""
    b, messages, parts = Bytes(data), [], []
    while b.left():
        first, second = b.u8(), b.u8()
        opcode, length = first & 15, second & 127
        if length >= 126:
            length = int.from_bytes(b.take(2 if length == 126 else 8), "big")
        ensure((second >= 128) == masked, "a frame that is masked, or is not, on the wrong side")
        mask = b.take(4) if masked else bytes(4)
        payload = bytes(x ^ mask[i % 4] for i, x in enumerate(b.take(length)))
        if opcode == 8:
            return messages
        ensure(opcode in (0, 2, 9, 10), f"a frame of kind {opcode}")
        if opcode in (0, 2):
            parts.append(payload)
            if first & 128:
                messages.append(b"".join(parts))
                parts = []
    return messages


def dump(parts):
    """Bytes with their meaning, at most sixteen per line."""
    lines = []
    for title, data, notes in parts:
        lines.append(title)
        for start, end, meaning in notes:
            for at in range(start, max(end, start + 1), 16):
                row = data[at:min(at + 16, end)].hex(" ")
                lines.append(f"{at:04x}  {row:<47}  {meaning if at == start else ''}".rstrip())
        lines.append("")
    return "\n".join(lines).rstrip("\n")


def main(arguments):
    with open(arguments[0], encoding="utf-8") as file:
        recording = json.load(file)
    read = {"quic": read_quic, "websocket": read_websocket}[recording["transport"]]
    session, parts = read(recording)
    print(dump(parts) if "--dump" in arguments else json.dumps(session.outcome(), indent=1))


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except Broken as why:
        sys.exit(f"not as docs/protocol.md says: {why}")
