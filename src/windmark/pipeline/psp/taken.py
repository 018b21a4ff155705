"""A picture of a point as it was read and corrected."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.generic]


@dataclass(frozen=True, eq=False)
class Taken:
    """A picture of a camera.

    Parameters
    ----------
    name : its file's
    image : grey levels; None where it cannot be used
    light, variance : (H, W), NaN where a pixel cannot be used
    lasting : (H, W) part of the variance that is the same error in all pictures of the camera
    why : it cannot be used, "" where it can
    content : see `same_picture.content_of`
    copy : it is the same picture as another one of its kind, and does not count
    key : the number that pairs it with those of other cameras (`deform.names.key_of_file`)
    """

    name: str
    image: Image | None
    light: Array = field(default_factory=lambda: np.zeros((0, 0)))
    variance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    lasting: Array | float = 0.0
    why: str = ""
    content: bytes = b""
    copy: bool = False
    key: str = ""


def said(kind: str, camera: str, picture: Taken) -> str:
    """A picture in words."""
    return f"{kind} picture {picture.name} of {camera}"
