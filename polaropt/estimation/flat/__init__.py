"""A flat pane seen from far: one incidence, one azimuth, one ghost shift."""
