"""Runs: folder, environments, model, training and cloning."""
