"""What comes of one raw mosaic: layers, photographs beside those of a full resolution, and false polarization."""
