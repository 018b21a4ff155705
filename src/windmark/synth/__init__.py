"""The virtual wind tunnel: images with exactly known truth."""
