"""What was tuned in reports on new meshes.  None of these was varied."""

#: Cells with smaller angles, in degrees, are warned of.
SHARP = 10.0
#: Relative difference from the predicted number of cells that is warned of.
EXCESS = 0.25
#: Relative change of the area or volume that is warned of, of meshes and surfaces and of images.
CHANGE, CHANGE_OF_IMAGE = 0.01, 0.02
#: Share of the requested elements that are missing, below which cells are rather too small.
TOO_COARSE = 0.1
