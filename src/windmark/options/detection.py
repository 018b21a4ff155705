"""Options of how markers are found."""

from __future__ import annotations

from typing import Literal, get_args

from windmark.options.option import Option

Polarity = Literal["dark", "bright"]
PolarityOrAuto = Literal["auto", "dark", "bright"]
Refine = Literal["bowl", "template"]
Photometry = Literal["multiplicative", "additive"]
Channel = Literal["grey", "red", "green", "blue"]
Bayer = Literal["RGGB", "BGGR", "GRBG", "GBRG"]

RADIUS_PX: Option[None] = Option(
    "radius_px", None, "Marker radius in pixels; several times for a range.", "px", least=1.0, most=1000.0,
    flag="--radius", otherwise="found in the image",
)  # fmt: skip
POLARITY: Option[Polarity] = Option(
    "polarity", "dark", "dark (markers on paint) or bright (warm ones in infrared).", choices=get_args(Polarity)
)
POLARITY_OR_AUTO: Option[PolarityOrAuto] = Option(
    "polarity", "auto",
    "dark (markers on paint), bright (warm ones in infrared), or auto: bright where dark ones are not there.",
    choices=get_args(PolarityOrAuto),
)  # fmt: skip
MERIT_MAX = Option("merit_max", 0.7, "Largest merit of a marker; 0 is a perfect inverse top-hat.", above=0.0)
REFINE: Option[Refine] = Option(
    "refine", "template", "bowl (the paper's centre) or template (fit of a blurred ellipse).",
    choices=get_args(Refine),
)  # fmt: skip
PHOTOMETRY: Option[None] = Option(
    "photometry", None, "Of the template: multiplicative or additive.", choices=get_args(Photometry),
    otherwise="by polarity",
)  # fmt: skip
MIN_QUALITY = Option(
    "min_quality", 12.0, "Smallest depth of a marker by the noise and by its merit: the worse the shape, the more it "
    "must stand out.", least=0.0,
    flag=None,
)  # fmt: skip
SEARCH_PX = Option(
    "search_px", 2.5, "How far off the expected places may be, along each axis.", "px", least=0.0, most=64.0
)
CHANNEL: Option[Channel] = Option(
    "channel", "grey", "Of colour pictures: grey (0.3 R + 0.6 G + 0.1 B), red, green, blue.",
    choices=get_args(Channel),
)  # fmt: skip
BAYER: Option[None] = Option(
    "bayer", None, "The picture is a colour sensor's raw mosaic: RGGB, BGGR, GRBG or GBRG.",
    choices=get_args(Bayer), otherwise="no mosaic",
)  # fmt: skip

OPTIONS = (
    RADIUS_PX, POLARITY, POLARITY_OR_AUTO, MERIT_MAX, REFINE, PHOTOMETRY, MIN_QUALITY, SEARCH_PX, CHANNEL, BAYER,
)  # fmt: skip
