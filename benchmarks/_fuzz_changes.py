"""How files are damaged: bytes flipped, numbers that cannot be, parts cut, doubled or blanked, other text."""

from __future__ import annotations

import re

import numpy as np

_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_NUMBERS = (b"0", b"-1", b"99999999999", b"nan", b"inf", b"1e999", b"-7.5", b"4000000000*1", b"\xc2\xb2", b"1" * 5000,
            b"2147483647", b"0x10", b"1_0")  # fmt: skip
_BETWEEN = (b"\xff\xfe\x00", "ä".encode("latin-1"), b"\0" * 40, b'"', b"<", b"[" * 2000, b"x" * 70000, b"\r", b"#",
            "λ".encode("utf-16"), b"\n\n", b"%s%n", b"../", b"\x1b[31m", b" " * 20000, b"(" * 20000,
            b"_" * 20000, b"a=" * 10000, b"\t," * 10000)  # fmt: skip


def changed(data: bytes, rng: np.random.Generator) -> bytes:
    """One of the ways in which files are damaged."""
    if not data:
        return rng.bytes(20)
    size, near = len(data), min(len(data), 4200) if rng.random() < 0.7 else len(data)  # headers decide more than values
    way = int(rng.integers(10))
    if way >= 7:
        return (_other_number, _inserted, _other_text)[way - 7](data, rng, near)
    values = bytearray(data)
    if way == 0:
        return bytes(values[: rng.integers(size)])
    if way == 1:
        for place in rng.integers(near, size=rng.integers(1, 9)):
            values[place] ^= 1 << rng.integers(8)
    elif way == 2:
        for place in rng.integers(near, size=rng.integers(1, 4)):
            values[place] = (0, 255, 127, 128, 1, 10)[rng.integers(6)]
    elif way == 3:  # a number grown or emptied, wherever it may begin
        place, width = int(rng.integers(near)), int(rng.choice([2, 4, 8]))
        values[place : place + width] = (b"\xff" * 8, b"\0" * 8, b"\xff\xff\xff\x7f" * 2, b"\0\0\0\x40" * 2)[
            rng.integers(4)
        ][:width]
    elif way == 4:
        a, b = sorted(int(k) for k in rng.integers(size, size=2))
        values[a:b] = values[a:b] * 2 if rng.random() < 0.5 else b""
    elif way == 5:
        a = int(rng.integers(near))
        values[a : a + rng.integers(1, 64)] = rng.bytes(int(rng.integers(1, 64)))
    else:  # a NaN, an infinity or a huge real, wherever it may begin
        place, real = int(rng.integers(near)), (np.nan, np.inf, -1e300, 1e-310)[rng.integers(4)]
        kind = ("<f4", ">f4", "<f8", ">f8")[rng.integers(4)]
        with np.errstate(over="ignore", under="ignore"):
            content = np.array(real).astype(kind).tobytes()
        values[place : place + len(content)] = content
    return bytes(values)


def _other_number(data: bytes, rng: np.random.Generator, near: int) -> bytes:
    """A number written in the file replaced by one that it cannot be."""
    found = list(_NUMBER.finditer(data[:near]))
    if not found:
        return data[: near // 2]
    one = found[rng.integers(len(found))]
    return data[: one.start()] + _NUMBERS[rng.integers(len(_NUMBERS))] + data[one.end() :]


def _inserted(data: bytes, rng: np.random.Generator, near: int) -> bytes:
    place = int(rng.integers(near))
    return data[:place] + _BETWEEN[rng.integers(len(_BETWEEN))] + data[place:]


def _other_text(data: bytes, rng: np.random.Generator, near: int) -> bytes:
    """Another encoding, other line ends, lines in disorder or double, or nothing."""
    lines = data.split(b"\n")
    a, b = (int(k) for k in rng.integers(len(lines), size=2))
    way = int(rng.integers(5))
    if way == 0:
        return (b"", b" \n", data.decode("latin-1").encode("utf-16"), b"\xef\xbb\xbf" + data)[rng.integers(4)]
    if way == 1:
        return data.replace(b"\n", b"\r" if rng.random() < 0.5 else b"\r\n")
    if way == 2:
        lines[a], lines[b] = lines[b], lines[a]
    elif way == 3:
        lines[a:a] = lines[b : b + int(rng.integers(1, 20))]
    else:
        del lines[a : a + int(rng.integers(1, 4))]
    return b"\n".join(lines)
