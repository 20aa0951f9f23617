"""Where studies are kept, and how trials of dead workers are found in there."""
