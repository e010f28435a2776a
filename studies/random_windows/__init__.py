"""Study: random scenes over everything that a window, its light and a camera may do."""
