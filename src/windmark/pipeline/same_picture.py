"""Is a picture one that was there before: told by its grey levels, whatever its file is called."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.generic]


def content_of(image: Image) -> bytes:
    """A print of a picture (H, W): the same for the same grey levels, in whatever file; noise makes others differ."""
    whole = np.ascontiguousarray(image)
    return hashlib.blake2b(f"{whole.shape} {whole.dtype.str}".encode() + whole.tobytes(), digest_size=16).digest()


def first_of(contents: Sequence[bytes]) -> list[int]:
    """Of each content the number of the first one that is the same: its own where there is none before."""
    first: dict[bytes, int] = {}
    return [first.setdefault(content, k) for k, content in enumerate(contents)]
