"""Settings of runs, and the YAML files that they are read from."""
