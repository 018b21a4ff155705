"""The rules of the room: every number the judge decides by, what it means, and the benchmark that guards it.

All evidence is in nats: a lead of 10 is odds of 22,000 to 1. What the user may change comes as `Limits`.
"""

from __future__ import annotations

import math

MISFIT = 4.0
"""The residuals' sigma times this must fit into the neighbourhood of the search, or another labelling would fit, too
(`matching_refusals`)."""
SAME_SHARE = 0.6
"""Two solutions are one only if more than this share of the pairs is."""
AS_MANY = 0.65
"""A labelling that is shifted on a board beyond its table explains at least this part of the spots (`attacks`: board).
"""
SHIFTED = 0.75
"""Where nothing says that the board goes on beyond its table, a shift that explains at least this part is named."""
NO_CHANCE = 10.0
"""Nats against chance at which some spots beyond the table are the board's (`attacks`: board)."""
DOUBLED = math.sqrt(3.0)
"""Spots may be twice as bad as they say: an excess of so many of their sigma (`pose_covariance`)."""
LOOSE = 1.8
"""A misfit of so many sigma of the spots is loose: it may hide a labelling that is right in parts only."""
MISSED = math.log(5.0)
"""Nats that a loose labelling needs more for each missing marker, as if four of five were seen (`matching_refusals`:
another wing)."""
SPARSE = 40.0
"""Nats that it needs more where half of the markers in view are missing."""
FADE = 0.2
"""Without clutter that fades in from half of the markers to this part below ..."""
HALF = 5.6
"""... and is so much for every pair where half are missing: half of a large model has much evidence, but the pairs of
another table of the same kind are worth 2 to 3 nats each (`matching_refusals`, `matching_rig`: another wing)."""
PRICE = 50.0
"""Nats by which `Limits.score` is higher than the odds it stands for, as it leaves out what the pose's freedom costs
(about 45): the odds of few spots, which have that price in them, need so much less, 10 nats (`attacks`: sparse)."""
CLUTTER = 6.0
"""So many spots for each marker are clutter."""
ONE_WRONG = 40.0
"""So much (nats) below the best a solution cannot owe to one wrong pair."""
FEW = 16
"""With so few pairs each is left out once: a single wrong one can open the gates for itself (`matching_refusals`)."""
UNHELD = 3.0
"""A pair whose place the others leave open by so many sigmas of its residual, misfit included (nine tenths of it its
own), may be another one: its spot is tried with the neighbouring markers (`attacks`: one pair)."""
FOREIGN = 7.0
"""Such a pair, and one that a model is bent for alone, must be so much (nats, 1,100 to 1) likelier than a foreign spot,
by what the others become without it; or the answer may hang on one (`attacks`: one pair)."""
COPY_NFA = -5.0
"""A second copy of the model leads chance by the margin, and has no larger a false-alarm number (`attacks`: copies)."""
MOVED = 5.0
"""Another camera matters where it moves the pose by so many of its stated sigmas (root of chi-square)."""
SLIGHT, SLIGHT_PX = 3.0, 0.5
"""A camera that is off by less than so many times what a check must show, and leaves less than so much (px, 1 sigma per
coordinate) beyond the noise, is slightly wrong, as calibrations are: the pose is given with what another camera would
make of it in its sigma (`tests/real`)."""
SHARPER = 0.7
"""The mirrored table is the answer only where it leaves less than this part of the misfit: else either is wrong by
something else, and which is the less wrong says little (`attacks`: real boards with labels)."""
BENT_LEAD = 5.0
"""Nats by which a rigid model is likelier than a bent one before the picture, and a bent one than another camera: a
random table error looks a little bent (`matching_bent`, `pose_covariance`)."""
DOUBT = 3.0
"""Nats that another camera or a bent model must promise to first order before they are tried (one picture in 50)."""
UNFOUND = 0.6
"""Below this part of the markers in view they are tried in any case: what they would bring into its gate is not seen
in the residuals."""
BENT_MOST = (0.7, 0.35)
"""A bent model must label so many of the markers that any camera has in view: in clutter or with free focal lengths,
and everywhere (`matching_bent`)."""
SYMMETRIC = 5.0
"""A lead of so many sigma of itself is no chance, where a table made symmetric fits better (`attacks`: rough tables).
"""
CHECKED = {
    "focal length": 0.01, "aspect": 0.005, "principal point": 0.01, "lens": 0.005, "place in the rig": 0.01,
    "bending": 0.01,
}  # fmt: skip
"""A given camera counts as checked by a picture that would show such an error: parts of the focal length and of the
aspect, and of the image's diagonal; radians by which a camera of a rig is turned, or the root of a bent model against a
straight one (`attacks`: wrong cameras, rig, bent)."""
