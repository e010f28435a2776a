"""What each term of the learned networks' loss is worth: trainings without each, and what networks reach alone."""
