"""A run: its folder, what it is built of, training and cloning."""
