"""What made the shipped network, its results and its pages. Nothing else needs it."""
