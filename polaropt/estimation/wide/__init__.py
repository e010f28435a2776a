"""A pane before a wide lens, or a bent one: incidence and azimuth change over the frame."""
