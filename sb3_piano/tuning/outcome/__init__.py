"""What comes out of a study: the best settings, a table of its trials, a report."""
