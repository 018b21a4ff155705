"""Pictures as one grey level per pixel, and what must be known of these where values are taken of them."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.io.colour import APART, check_channel, check_mosaic, from_mosaic, made_of_saturated, to_grey
from windmark.io.errors import FileError
from windmark.io.images import ONLY, with_mosaic
from windmark.io.recordings.picture import Frame
from windmark.io.text import Pathlike
from windmark.options.detection import CHANNEL

Image = NDArray[Any]


def read_grey(
    path: Pathlike | Frame, *, page: int | Literal["only"] = ONLY, channel: str = CHANNEL.default,
    bayer: str | None = None,
) -> Image:  # fmt: skip
    """Read an image as one grey level per pixel: (H, W), linear in what the file says.

    Parameters
    ----------
    path, page : see `read_image`; or a picture of an open recording
    channel : "grey", "red", "green" or "blue", see `to_grey`
    bayer : pattern of a raw colour mosaic, "RGGB" and its like, see `from_mosaic`; None takes what the file says,
        which is none but for recordings of colour cameras that say so

    Raises
    ------
    FileError
        As `read_image`; also where the file has not the colours that are asked for.
    """
    return _grey_and_raw(path, page, channel, bayer)[0]


class Levels(NamedTuple):
    """A grey picture (H, W) and its pixels.

    Parameters
    ----------
    grey : see `read_grey`
    mixed : (H, W) which were made of saturated ones, see `colour.made_of_saturated`; None where none was
    apart : the noise of pixels that are so far apart is independent
    """

    grey: Image
    mixed: NDArray[np.bool_] | None
    apart: int


def read_levels(
    path: Pathlike | Frame, *, page: int | Literal["only"] = ONLY, channel: str = CHANNEL.default,
    bayer: str | None = None,
) -> Levels:  # fmt: skip
    """`read_grey`, and what must be known of its pixels where values are taken of them."""
    grey, raw, bayer = _grey_and_raw(path, page, channel, bayer)
    return Levels(grey, made_of_saturated(raw, channel, bayer), 1 if bayer is None else APART)


def _grey_and_raw(
    path: Pathlike | Frame, page: int | Literal["only"], channel: str, bayer: str | None
) -> tuple[Image, Image, str | None]:
    """The grey picture, the stored one, and the pattern of the mosaic that this is."""
    check_channel(channel)
    if bayer is not None:
        check_mosaic(bayer)
    picture, said = (path.read(), path.frames.bayer) if isinstance(path, Frame) else with_mosaic(path, page)
    path, bayer = str(path), bayer or said
    if bayer is not None and (picture.ndim != 2 or min(picture.shape) < 2):
        raise FileError(path, f"the shape is {picture.shape}; expected (H, W), the mosaic of a colour sensor, as bayer")
    if channel != "grey" and bayer is None and (picture.ndim == 2 or picture.shape[2] < 3):
        raise FileError(path, f"a picture without colours; expected colours to take {channel} from")
    grey = to_grey(picture, channel=channel) if bayer is None else from_mosaic(picture, bayer, channel=channel)
    return grey, picture, bayer
