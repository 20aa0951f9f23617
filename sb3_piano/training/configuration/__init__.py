"""Settings of runs, and their YAML files."""
