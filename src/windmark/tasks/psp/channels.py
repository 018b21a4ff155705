"""Other colours of a paint: a channel that does not answer to pressure takes off what light and motion did."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from windmark.paint import NodeField, combined
from windmark.tasks.psp.ratios import MergedRatio

COLUMNS = 3
"""Of a channel's shared errors; a point's field has 30, and what else it is formed of needs them, too."""
REFERENCE = "reference channel"
"""The cause of the reference channel's errors: wherever its ratio is used, they are the same."""


def as_one_cause(field_: NodeField, cause: str, most: int = COLUMNS, *, keep: str = "") -> NodeField:
    """The field with its shared errors as one cause: ``cause:1`` ... along their principal axes over the nodes.

    Every channel has pictures of its own: its registrations' errors are not those of another one, though both have the
    same names. What is left out beyond ``most`` columns counts as noise. Columns of the cause ``keep`` stay.
    """
    stays = np.array([name.split(":")[0] == keep for name in field_.names], bool)
    columns = np.where(field_.known[:, None], field_.modes[:, ~stays], 0.0)
    _, axes = np.linalg.eigh(columns.T @ columns)
    turned = columns @ axes[:, ::-1]
    new = turned[:, :most]
    names = [n for n, stay in zip(field_.names, stays, strict=True) if stay]
    names += [f"{cause}:{k + 1}" for k in range(new.shape[1])]
    white = field_.white + (turned[:, most:] ** 2).sum(axis=1)
    return NodeField(
        field_.value, white, np.column_stack([field_.modes[:, stays], new]), tuple(names), field_.unit
    )  # fmt: skip


def two_colours(paint: MergedRatio, reference: MergedRatio) -> MergedRatio:
    """The ratio of a two-colour paint: that of the channel that answers to pressure over that of the other one.

    See `paint.form_ratio`, of which this is the form for ratios: light that the model moves in, and lamps that grow
    dim, are in both: a flicker that nothing says is taken as 0. What each camera shows by itself stays that of the
    first channel.
    """
    off = as_one_cause(reference.ratio, REFERENCE)
    good = (paint.ratio.value > 0) & (off.value > 0)
    a, b = (np.where(good, f.value, np.nan) for f in (paint.ratio, off))
    slopes = [np.where(good, s, 0.0) for s in (1 / b, -a / b**2)]
    ratio = combined(a / b, [(paint.ratio, slopes[0]), (off, slopes[1])])
    flicker = float(np.nan_to_num(paint.flicker))
    return replace(paint, ratio=ratio, flicker=flicker, left_out={**paint.left_out, **reference.left_out},
                   scatter=(*paint.scatter, *reference.scatter))  # fmt: skip
