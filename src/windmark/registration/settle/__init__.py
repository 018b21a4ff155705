"""One settle: labels, pose, cameras and a smooth deformation that agree with each other, for any number of cameras."""
