"""Where a verdict changes: every threshold with its meaning. Guarded by ``benchmarks/verdicts.py`` (planted faults, and
clean jobs that must not be doubted).
"""

from __future__ import annotations

PLACE_PX = 0.1
"""Error of a place in the picture, 1 sigma per coordinate, from which it matters: on a gradient of 1 % per pixel it is
0.003 in Cp at Mach 0.8, and a tenth of a degree of twist."""
NOISE_TIMES = 1.0
"""Misfit over the spots' own sigma from which more than half of the squared residuals is no noise."""
BLUR_COSTS = 2.0
"""A blur that makes the best possible sigma of a disc's centre so many times that of a sharp picture."""
SHARP_PX = 0.7
"""Blur (1 sigma) of a sharp picture: that of a good lens and a pixel."""
SATURATED = 0.005
"""Part of the pixels at the highest level of an integer picture."""
SATURATED_NODES = 0.02
"""Part of the nodes that a picture shows which have no value for that reason."""
GROSS = 5.0
"""Residual of a marker over the misfit of the others, 1 sigma per coordinate, from which it is none of theirs: of a
hundred right ones in a picture one in 3,000 pictures has such a one, and of many pictures the middle one counts."""
MISSING = 1 / 3
"""Part of the markers that must be in view, from which missing ones are no accident."""
FEW = 6
"""Markers from which a wrong one among them can be told from a wrong pose: twelve numbers for six unknowns."""
LAMP_LIGHTS = 1 / 4
"""Part of what the cameras show of the model, below which a lamp is on the wrong side of it: it lights half of any
body, so half of what cameras all round it show, and more of what those on its own side do."""
FAR_POINTS = 1 / 2
"""Part of a list's points that are not on the surface, from which the list is of another unit or frame."""
CONFIRM = 3
"""Markers at their places from which a given pose is confirmed: six numbers for its six unknowns."""
HARDLY_SEEN = 0.01
"""Part of the grid's nodes that a given pose has in view, below which its unit or its frame is asked first: half of
them face the camera, and no picture is taken for a hundredth of a model."""
GRID_BESIDE = 5e-4
"""Part of its size by which a grid stands beside its markers: half a pixel of a thousand across it."""
SPREAD = 3.0
"""Times that the surface's places are less sure than the markers' own: the markers are on one side."""
ANGLE_DEG = 0.1
"""1 sigma of an angle of a pose that was asked for by itself (no grid)."""
PATTERN_NATS = 6.0
"""Lead of a pattern over scatter in explaining what is left."""
LENS_NATS = 10.0
"""The same of another lens beside a table of markers, which is off in patterns of its own: a focal length 1 % off leads
by 20 and more, a real plate whose table is off by 5 to 7 (`benchmarks/verdict_lens.py`)."""
LENS_EDGE = 0.003
"""1 sigma of a lens that was calibrated elsewhere: shift of the picture's corner over its distance from the centre."""
FOCAL_OFF = 0.01
"""1 sigma of the focal length (as part of itself) and of the principal point (of the picture's width) of that lens."""
LEFT_OUT = 0.1
"""Part of the marks of a network, or of its pictures where that is more than one, that were left out."""
HALVES = 2.0
"""Two halves of the pictures that differ by so many times what their covariances say."""
MAP = 2.0
"""Mean residuals of the cells of a sensor over what noise would give."""
SIGMA0 = 2.0**0.5
"""As `deformation.Deformation.fits` has it: more than half of the squared residuals is no noise."""
FOCAL = 0.01
"""Relative 1 sigma of a focal length that was to be found."""
LOST = 0.02
"""Part of frames or points without a result that is no accident."""
SOME = 0.1
"""Part of the frames in which something must be found before it is said of the whole."""
APART = 6.0
"""Typical difference of two cameras in their stated sigmas: an error of four sigmas that one of them has everywhere."""
CONTRADICTED = 0.01
"""Part of the nodes that two cameras see on which they contradict each other."""
COVERED = 0.5
"""Part of the surface's nodes that a reduction is of."""
WIND_OFF, WIND_OFF_SIGMAS = 0.2, 6.0
"""Wind-off frames that differ by so large a part of what all frames show, and by so many sigma, are not all of it."""
REFERENCE_AREA = (0.02, 5.0)
"""Of the two larger sides of the model's box: reference areas lie far within, and another unit changes them by 100."""
REFERENCE_CHORD = (0.003, 3.0)
"""Of the largest side of the model's box."""
REFERENCE_SPAN = (0.01, 10.0)
"""The same of the span: a missile's is its diameter, a half model's twice what the grid has of it."""
REFERENCE_AREA_TIMES = 10.0
"""A reference area over chord times span: at most about 1, less for half models and where the chord is a body's length;
the nearest two units, of one of the three, make 25 of it."""
MOMENT_POINT = (5e-4, 10.0)
"""Distance of the moment point from the origin, of the model's size, below which it is meant to be the origin (Cm does
not tell it from that), and from the model, beyond which it is none of this model's."""
MOMENT_AWAY = 0.01
"""The same in another unit, in which it is a place of the model that is not the origin."""
WALL_LENGTH = 1e-3
"""Of the model's size, over which no wall conducts so little that its temperature is another one."""
OTHER_UNIT = 100.0
"""Times by which a unit is larger from which numbers that are right in it are next to nothing in the other one: they
tell it by themselves, inches or centimetres in a project in millimetres do not."""
LAMP = (0.25, 100.0)
"""Distance of a lamp from the model, of the model's size: nearer it lights a part of it, farther it is the sun."""
TEMPERATURE = 0.02
"""1 sigma of a temperature as part of it (6 K at 300 K), from which a map tells little."""
BOUND_TIMES = 2.0
"""Errors of centres over the least that pictures allow, from which three quarters of their square are the method's."""
STUDY_REST_PX = 0.02
"""Errors of virtual markers beyond the bound that no noise explains: 11 x 11 sub-pixels leave 0.002 to 0.005 px, edges
without blur 0.003 to 0.012 px (radii of 1.5 to 8 px); with 33 x 33 sub-pixels and blur the template is within 1.2 times
the bound."""
LEFT_OUT_TIMES = 3.0
"""RMS of what is left out of a fit over that of what is in it, from which it follows single rows."""
BEYOND = 0.1
"""Part of a calibrated range beyond its ends that a law may be used in."""
SCATTER, SCATTER_TIMES = 0.01, 3.0
"""Part of the light by which a typical node differs from picture to picture beyond noise, and such scatter over noise:
of pictures of one state lamps are evened out and noise is left; 1 % is 0.03 in Cp at Mach 0.8."""
FIT_CONTRADICTED = 5.0
"""Sigmas by which a fit to taps may move the paint's own pressure, or its slope, where both are right."""
FLICKER = 0.05
"""Relative standard deviation of the light from picture to picture that no lamp has, unless it fails."""
MODEL_M = (0.005, 200.0)
"""Size of a model in metres: less is a grain, more no tunnel holds."""
