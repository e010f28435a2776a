"""Files: their formats, what a camera wrote into them, and how results are written."""
