"""What the samples of a raw mosaic tell of a flat pane, beside its cells."""
