"""Two pictures and a few matches made by hand: their geometry and, with cameras, the other matches."""

from windmark.tasks.clicked_pair.clicks import SNAP_PX, Clicks
from windmark.tasks.clicked_pair.lines import lines_of, relabelled
from windmark.tasks.clicked_pair.places import places
from windmark.tasks.clicked_pair.result import ClickedPair
from windmark.tasks.clicked_pair.solve import clicked_pair

__all__ = ["SNAP_PX", "ClickedPair", "Clicks", "clicked_pair", "lines_of", "places", "relabelled"]
