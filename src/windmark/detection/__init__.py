"""Find markers in an image: the paper's SPOT detector."""
