"""Two pictures and a few matches made by hand: their geometry and, with cameras, the other matches."""

from windmark.pipeline.clicked_pair.clicks import SNAP_PX, Clicks, read_clicks
from windmark.pipeline.clicked_pair.lines import lines_of, relabelled
from windmark.pipeline.clicked_pair.result import ClickedPair
from windmark.pipeline.clicked_pair.solve import clicked_pair

__all__ = ["SNAP_PX", "ClickedPair", "Clicks", "clicked_pair", "lines_of", "read_clicks", "relabelled"]
