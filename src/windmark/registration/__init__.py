"""Which spot is which marker, and where the camera was: pose from unlabelled spots."""
