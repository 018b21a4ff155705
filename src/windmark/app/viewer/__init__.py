"""`windmark view`: a page on this computer that shows a run, names and excludes spots, and runs it again."""
