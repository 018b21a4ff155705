"""Is a picture one that was there before: told by its grey levels, whatever its file is called."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.generic]


def content_of(image: Image) -> bytes:
    """A print of a picture (H, W): the same for the same grey levels, in whatever file; noise makes others differ."""
    whole = np.ascontiguousarray(image)
    return hashlib.blake2b(f"{whole.shape} {whole.dtype.str}".encode() + whole.tobytes(), digest_size=16).digest()


def shown_by(image: Image) -> bytes:
    """`content_of` a picture that shows something; b"" where all its pixels are alike, which tells no two apart."""
    grey = np.asarray(image)
    return content_of(grey) if (grey != grey[:1, :1]).any() else b""


def first_of(contents: Sequence[bytes]) -> list[int]:
    """Of each content the number of the first one that is the same: its own where there is none before."""
    first: dict[bytes, int] = {}
    return [first.setdefault(content, k) for k, content in enumerate(contents)]


def copies_among(pictures: Iterable[tuple[str, bytes]]) -> list[tuple[str, str]]:
    """Name of each picture that is an earlier one, and that one's, from names and `shown_by` of all."""
    first: dict[bytes, str] = {}
    found = [(name, first.setdefault(content, name)) for name, content in pictures if content]
    return [(name, of) for name, of in found if name != of]


def copy_words(of: str) -> str:
    """What is to be said of a picture that is another one."""
    return f"is the same picture as {of}, pixel by pixel: two exposures differ by their noise, one of them is not here"
