"""Before the test: can a layout of markers be identified from anywhere, what would help, where will poses be weak.

A virtual campaign answers it: seeded views from all directions, spots with hidden markers, false spots and noise, and
`registration.register` on each, as it will be used.
"""

from windmark.tasks.marker_check.advice import Change, Proposal
from windmark.tasks.marker_check.campaign import Campaign, run_campaign
from windmark.tasks.marker_check.check import MarkerCheck, check_markers
from windmark.tasks.marker_check.settings import CheckSettings
from windmark.tasks.marker_check.stage import Stage

__all__ = ["Campaign", "Change", "CheckSettings", "MarkerCheck", "Proposal", "Stage", "check_markers", "run_campaign"]
