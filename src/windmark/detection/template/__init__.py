"""The template fit: centres of discs at the Cramer-Rao bound, their covariances, and what tells a disc from dirt."""
