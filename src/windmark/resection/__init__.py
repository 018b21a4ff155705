"""Image to model surface and back: pixel maps, visibility, virtual images, values on nodes."""
