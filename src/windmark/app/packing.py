"""Arrays and their meaning as one short text for a page: whole numbers, differences, byte planes, gzip, base 85.

The page's ``unpack.js`` is the other half. What a reader sees of a number is decided here: coordinates are rounded to a
65,535th of the model, values to a part of their sigma, sigmas to 1 %; of many fields more coarsely, see `Fineness`.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

STEPS = 65_535
"""Steps of a coordinate over the size of the model."""
MOST_LEVELS = 1 << 22
"""A field is rounded no finer than this part of its range."""
_DIGITS = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%()*+-;=>?@^_`{|}~.,:"
"""Of base 85: nothing that could end or open anything in HTML."""
_LAGS = (1, 2, 3, 6)
"""What a number may be the difference to: the one before, or that of the corner or the triangle pair before."""


@dataclass(frozen=True)
class Fineness:
    """How finely a field is told.

    Parameters
    ----------
    sigma_part : a value is rounded to this part of its median sigma
    levels : but no coarser than this part of its range, which colours need
    sigma_step : a sigma is rounded to the next power of this
    digits : of a sigma that are worth printing
    """

    sigma_part: float
    levels: int
    sigma_step: float
    digits: int


FINE = Fineness(0.25, 1024, 1.02, 2)
"""The rounding has 7 % of the noise's size: 0.3 % of both together."""
COARSE = Fineness(0.5, 96, 1.33, 1)
"""For a report of many pictures: the rounding has 14 % of the noise's size, 1 % of both together."""


@dataclass
class Packed:
    """A document of nested lists and dicts, in which arrays are kept apart as bytes."""

    chunks: list[bytes] = field(default_factory=list)
    length: int = 0

    def ints(self, values: ArrayLike) -> dict[str, Any]:
        """Whole numbers below 2^31 in size, any shape, exactly."""
        flat = np.asarray(values, dtype=np.int64).ravel()
        if flat.size and max(-int(flat.min()), int(flat.max())) >= 1 << 31:
            raise DataError("ints: numbers must be below 2^31 in size")
        times, lag, rest = _differences(flat)
        folded = ((rest << 1) ^ (rest >> 63)).astype(np.uint64)
        planes = max(1, (int(folded.max(initial=0)).bit_length() + 7) // 8)
        columns = folded.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :planes]
        return {"n": len(flat), "times": times, "lag": lag, "planes": planes, "at": self._put(columns.T.tobytes())}

    def rounded(self, values: ArrayLike, step: float, offset: float = 0.0) -> dict[str, Any]:
        """Numbers rounded to ``offset`` plus a multiple of ``step``; NaN kept."""
        flat = np.asarray(values, dtype=float).ravel()
        good = np.isfinite(flat)
        codes = np.zeros(len(flat), dtype=np.int64)
        codes[good] = np.rint((flat[good] - offset) / step).astype(np.int64)
        return {"step": step, "offset": offset, "codes": self.ints(_held(codes, good)), **self._gaps(good)}

    def field(self, values: ArrayLike, sigma: ArrayLike | None = None, fineness: Fineness = FINE) -> dict[str, Any]:
        """Values (V,) rounded to what their ``sigma`` (V,) earns, or to a 4,096th of their range without."""
        flat = np.asarray(values, dtype=float)
        good = flat[np.isfinite(flat)]
        span = float(np.ptp(good)) if good.size else 0.0
        step = span / 4096 or 1.0
        if sigma is not None and span > 0:
            known = np.asarray(sigma, dtype=float)
            known = known[np.isfinite(known) & (known > 0)]
            if known.size:
                step = float(np.clip(fineness.sigma_part * np.median(known), span / MOST_LEVELS,
                                     span / fineness.levels))  # fmt: skip
        return self.rounded(flat, step, float(good.min()) if good.size else 0.0)

    def sigmas(self, sigma: ArrayLike, fineness: Fineness = FINE) -> dict[str, Any]:
        """Standard deviations (V,), as finely as wanted relative to themselves; 0 and NaN kept."""
        flat = np.asarray(sigma, dtype=float)
        good, some = np.isfinite(flat), np.isfinite(flat) & (flat > 0)
        least = float(flat[some].min()) if some.any() else 1.0
        codes = np.zeros(len(flat), dtype=np.int64)
        codes[some] = 1 + np.rint(np.log(flat[some] / least) / np.log(fineness.sigma_step)).astype(np.int64)
        return {
            "least": least, "ratio": fineness.sigma_step, "digits": fineness.digits,
            "codes": self.ints(_held(codes, good)), **self._gaps(good),
        }  # fmt: skip

    def text(self, document: dict[str, Any]) -> str:
        """The document, in which what the methods gave stands for its arrays."""
        return packed_text(json.dumps(document, separators=(",", ":"), allow_nan=False).encode(), b"".join(self.chunks))

    def _put(self, content: bytes) -> int:
        at = self.length
        self.chunks.append(content)
        self.length += len(content)
        return at

    def _gaps(self, good: NDArray[np.bool_]) -> dict[str, Any]:
        """Where there is no value, as bits; nothing where all have one."""
        return {} if good.all() else {"known": self._put(np.packbits(good, bitorder="little").tobytes())}


def packed_text(head: bytes, rest: bytes) -> str:
    """A document's head (JSON) and what follows it as text: length, head and rest by gzip in base 85.

    Noise has no repetitions that are worth to be looked for: `zlib.Z_FILTERED` packs it 10 % tighter; level 9 is 0.4 %
    smaller than 6 and takes a twentieth of the whole report longer.
    """
    whole = np.array([len(head)], dtype="<u4").tobytes() + head + rest
    packer = zlib.compressobj(6, zlib.DEFLATED, 31, 9, zlib.Z_FILTERED)
    content = packer.compress(whole) + packer.flush()
    padded = content + bytes(-len(content) % 4)
    number = np.frombuffer(padded, dtype=">u4").astype(np.uint64)
    digits = np.stack([number // np.uint64(85**k) % np.uint64(85) for k in (4, 3, 2, 1, 0)], axis=1)
    return f"{len(content)}|" + np.frombuffer(_DIGITS, dtype=np.uint8)[digits.ravel()].tobytes().decode("ascii")


def coordinates(packed: Packed, xyz: Array, size: float) -> list[dict[str, Any]]:
    """Columns of coordinates (V, 3) in steps of a 65,535th of ``size``, from the lowest."""
    step = (size if size > 0 else 1.0) / STEPS
    return [packed.rounded(column, step, float(np.nanmin(column)) if np.isfinite(column).any() else 0.0)
            for column in xyz.T]  # fmt: skip


def _held(codes: Ints, good: NDArray[np.bool_]) -> Ints:
    """Codes with those of gaps replaced by the last before: nothing new to say there."""
    if good.all() or not good.any():
        return codes
    last = np.maximum.accumulate(np.where(good, np.arange(len(codes)), -1))
    return np.where(last >= 0, codes[np.maximum(last, 0)], codes[int(np.argmax(good))])


def _differences(flat: Ints) -> tuple[int, int, Ints]:
    """How often and to which earlier number differences are taken, and these: what leaves the smallest numbers."""
    best = (0, 1, flat)
    least = _weight(flat)
    for lag in _LAGS:
        rest = flat
        for times in (1, 2):
            rest = np.concatenate([rest[:lag], rest[lag:] - rest[:-lag]])
            weight = _weight(rest)
            if weight < least:
                best, least = (times, lag, rest), weight
    return best


def _weight(rest: Ints) -> float:
    """About the bits that numbers take; of many a part is looked at."""
    return float(np.log2(1.0 + np.abs(rest[:: max(1, len(rest) // 30_000)])).mean()) if len(rest) else 0.0
