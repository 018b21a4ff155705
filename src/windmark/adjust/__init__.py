"""The one adjustment: non-linear least squares whose jobs differ only in what is free."""
