"""Files: images, markers, cameras, grids and results. The only place where conventions are converted."""
