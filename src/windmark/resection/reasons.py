"""Why a camera does not see a point: codes and their names."""

REASONS = ("visible", "blanked", "lens", "outside", "facing_away", "oblique", "hidden")
"""What a `NodeView.reason` code means; of several reasons the first in this order is given.

blanked: marked unused in the grid, or in no triangle; lens: beyond the radius at which the lens model
is one to one; outside: outside the image or behind the camera; oblique: beyond ``max_obliquity_deg``.
"""
VISIBLE, BLANKED, LENS, OUTSIDE, FACING_AWAY, OBLIQUE, HIDDEN = range(len(REASONS))
