"""Seeded mutations of good files: bytes, text, JSON, archives and headers of weights."""

import io
import json
import re
import zipfile
from pathlib import Path

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
EXTREME = [
    *(b"0", b"-1", b"1", b"1e400", b"-1e400", b"9" * 400, b"9" * 5000, b"NaN", b"Infinity"),
    *(b"1e-320", b"2147483648", b"9223372036854775807", b"18446744073709551616", b"1e9", b"0.5"),
    *(b"true", b"null", b"[]", b"{}", b'""', b'"x"', b"", b"-"),
]
"""What takes the place of a number in a text."""
ODD = [
    *(None, True, False, 0, -1, 1e9, 1e308, 10**400, 2**63, 0.5, float("nan"), float("inf")),
    *("", "x", "../../x", "a/b", "\0", "x" * 300, "\ud800", "é\n\x1b[31m"),
    *([], [0], [[]], [None], ["x"], {}, {"x": 0}, {"": {}}),
]
"""What takes the place of a value in JSON."""


def mutated(path: Path, data: bytes, rng) -> bytes:
    """Return the content of a file after one to three mutations that suit its kind."""
    kinds = [of_bytes, of_bytes]
    if path.suffix in (".json", ".yaml", ".log"):
        kinds += [of_text]
    if path.suffix == ".json":
        kinds += [of_json, of_json]
    if path.suffix in (".npz", ".pt"):
        kinds = [of_bytes, of_archive, of_archive]
    if path.suffix == ".safetensors":
        kinds = [of_bytes, of_header, of_header]
    for _ in range(rng.choice((1, 1, 2, 3))):
        try:
            data = rng.choice(kinds)(data, rng)
        except Exception:
            # Too broken already to be mutated in that way.
            data = of_bytes(data, rng)
    return data


def of_bytes(data: bytes, rng) -> bytes:
    """Flip, cut, remove, repeat, swap, insert bytes, or replace a number by an extreme one."""
    if not data:
        return rng.randbytes(rng.randrange(20))
    at, length = rng.randrange(len(data)), rng.choice((1, 2, 4, 8, 30, 200))
    piece = data[at : at + length]
    other = rng.randrange(len(data))
    kind = rng.randrange(7)
    if kind == 0:
        changed = bytearray(data)
        for _ in range(rng.randrange(1, 9)):
            changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        return bytes(changed)
    if kind == 1:
        return data[:at]
    if kind == 2:
        return data[:at] + data[at + length :]
    if kind == 3:
        return data[:at] + piece * rng.choice((2, 3, 50)) + data[at + length :]
    if kind == 4:
        changed = bytearray(data)
        changed[at : at + length], changed[other : other + length] = (
            data[other : other + length],
            piece,
        )
        return bytes(changed)
    if kind == 5:
        return data[:at] + rng.randbytes(length) + data[at:]
    extreme = rng.choice((b"\0", b"\xff", b"\x7f", b"\x80")) * rng.choice((1, 2, 4, 8))
    return data[:at] + extreme + data[at + len(extreme) :]


def of_text(data: bytes, rng) -> bytes:
    """Replace a number by an extreme one, or swap two words."""
    numbers = list(NUMBER.finditer(data))
    if numbers and rng.random() < 0.7:
        found = rng.choice(numbers)
        return data[: found.start()] + rng.choice(EXTREME) + data[found.end() :]
    words = data.split(b" ")
    i, j = rng.randrange(len(words)), rng.randrange(len(words))
    words[i], words[j] = words[j], words[i]
    return b" ".join(words)


def of_json(data: bytes, rng) -> bytes:
    """Replace, remove, repeat or rename a value somewhere in a JSON text."""
    root = [json.loads(data)]
    place, key = root, 0
    while isinstance(place[key], dict | list) and place[key] and rng.random() < 0.85:
        place = place[key]
        key = rng.choice([*place]) if isinstance(place, dict) else rng.randrange(len(place))
    kind = rng.randrange(6)
    if kind == 0 and place is not root:
        del place[key]
    elif kind == 1 and isinstance(place, list) and place is not root:
        place *= rng.choice((0, 2, 3))
    elif kind == 2 and isinstance(place, dict):
        place[rng.choice(("", "x", "kind", "index"))] = place.pop(key)
    else:
        place[key] = rng.choice(ODD)
    return json.dumps(root[0]).encode()


def of_archive(data: bytes, rng) -> bytes:
    """Mutate a member of a zip archive, so that its checksum is right."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {entry.filename: archive.read(entry) for entry in archive.infolist()}
        stored = {entry.compress_type for entry in archive.infolist()} == {zipfile.ZIP_STORED}
    name = rng.choice(list(members))
    head, rest = members[name][:200], members[name][200:]
    kind = rng.randrange(5)
    if kind == 0:
        del members[name]
    elif kind == 1:
        members[rng.choice(("x", "x.npy", "../x.npy", name + "/y.npy"))] = members.pop(name)
    elif kind == 2:
        members[name] = rng.choice(list(members.values()))
    elif kind == 3:
        members[name] = of_text(head, rng)[: len(head)].ljust(len(head)) + rest
    else:
        members[name] = of_bytes(head, rng) + rest
    out = io.BytesIO()
    with zipfile.ZipFile(
        out, "w", zipfile.ZIP_STORED if stored else zipfile.ZIP_DEFLATED
    ) as packed:
        for member, content in members.items():
            packed.writestr(member, content)
    return out.getvalue()


def of_header(data: bytes, rng) -> bytes:
    """Mutate the JSON header of a safetensors file, or JSON texts inside it."""
    length = int.from_bytes(data[:8], "little")
    header, rest = data[8 : 8 + length], data[8 + length :]
    told = json.loads(header)
    inner = rng.choice(("config", "facts", None))
    if inner is None or inner not in told.get("__metadata__", {}):
        header = of_json(header, rng)
    else:
        told["__metadata__"][inner] = of_json(told["__metadata__"][inner].encode(), rng).decode()
        header = json.dumps(told).encode()
    return len(header).to_bytes(8, "little") + header + rest
